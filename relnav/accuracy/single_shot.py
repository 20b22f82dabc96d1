"""What one image gives, by Monte Carlo: the paper's own figures from first principles."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.accuracy.statistics import ErrorStatistics, error_statistics
from relnav.arrays import Matrix, Vector
from relnav.geometry.pinhole import central_projection
from relnav.mission import Model
from relnav.sensors.three_beacon.fix import MEASURE_ROWS, measure_batch
from relnav.sensors.three_beacon.measure import PROJECTIONS

QUANTITIES = ("range", "azimuth", "elevation")


@dataclass(frozen=True)
class SingleShots:
    """Statistics of range (m), azimuth and elevation (rad) of single images from one place."""

    statistics: tuple[ErrorStatistics, ErrorStatistics, ErrorStatistics]
    failed: int


def pointed_camera(p: Vector) -> Matrix:
    """dcm_cam_from_dock of a camera at p (3,) that looks at O: right-handed, x level in the docking plane."""
    z = -p / np.linalg.norm(p)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def true_spots(model: Model, p: Vector, optics: str) -> Matrix:
    """Noise-free spots (beacons, 2) m of a camera at p (docking frame) that looks at O.

    optics: "real" is central projection; "parallel" puts every beacon at O's depth, as the paper's formulas assume.
    """
    c = (model.sensor.beacons_dock_m - p) @ pointed_camera(p).T
    image = central_projection(c) if optics == "real" else c[:, :2] / np.linalg.norm(p)
    spots: Matrix = model.sensor.focal_length_m * image
    return spots


def single_shots(
    model: Model,
    range_m: float,
    azimuth_rad: float,
    elevation_rad: float,
    *,
    projection: str,
    optics: str,
    draws: int,
    rng: np.random.Generator,
) -> SingleShots:
    """Errors of `draws` noisy images from one place, with the given closed form and optics."""
    sensor = model.sensor
    truth = np.array([range_m, azimuth_rad, elevation_rad])
    cos_el = math.cos(elevation_rad)
    p = range_m * np.array([cos_el * math.cos(azimuth_rad), cos_el * math.sin(azimuth_rad), -math.sin(elevation_rad)])
    spots = true_spots(model, p, optics)[:3] + rng.normal(size=(draws, 3, 2)) * sensor.spot_noise_m
    rae, covariance, status = np.empty((draws, 3)), np.empty((draws, 3, 3)), np.empty(draws, dtype=np.int64)
    measure_batch(
        spots,
        sensor.focal_length_m,
        math.inf,  # the field's edge is another matter
        math.inf,
        sensor.spot_noise_m,
        sensor.beacon_half_spacing_m,
        sensor.beacon_c_distance_m,
        PROJECTIONS[projection],
        rae,
        covariance,
        status,
        np.zeros((MEASURE_ROWS, 6)),
    )
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    statistics = [error_statistics(rae[:, i] - truth[i], sigma[:, i]) for i in range(3)]
    return SingleShots((statistics[0], statistics[1], statistics[2]), int(np.sum(status != 0)))
