"""The patent's statements that can be measured apart from any frame: its angle, its false quadruples, its detector."""

import math

import numpy as np

from relnav.arrays import Matrix
from relnav.sensors.dual_field.fold import cross_field_cos, patent_cross_angles
from relnav.sensors.dual_field.four_primaries import build_four_sky, primaries
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

WIDE_TOLERANCE_RAD = math.radians(60.0 / 3600.0)
HALF_MIRROR_MAG = 0.75


def _round_field(rng: np.random.Generator, count: int, width_rad: float) -> Matrix:
    """Directions (n, 3) spread evenly over a round field about +z."""
    z = 1.0 - rng.random(count) * (1.0 - math.cos(0.5 * width_rad))
    angle, r = 2.0 * math.pi * rng.random(count), np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def cross_angle_error(sensor: StarSensor, width_rad: float, pairs: int, seed: int) -> float:
    """Median error, rad, of the nearer of 90 deg -+ a against the true angle of stars in different fields."""
    fold = sensor.fold.matrix
    if fold is None:
        raise ValueError("a sensor of one field has no angle across fields")
    rng = np.random.default_rng(seed)
    u, w = _round_field(rng, pairs, width_rad), _round_field(rng, pairs, width_rad)
    true = np.arccos(cross_field_cos(u, w, fold))
    less, more = patent_cross_angles(np.arccos(np.clip(np.einsum("ij,ij->i", u, w), -1.0, 1.0)))
    return float(np.median(np.minimum(np.abs(true - less), np.abs(true - more))))


def spurious_quadruples(sensor: StarSensor, frames: int, seed: int) -> float:
    """Quadruples of stars that four false spots fit by chance, mean of a frame, at a tolerance of four sigma of a pair.

    Counted at a wide tolerance and carried down with its fifth power: eight unknowns of four spots less three of the
    attitude.
    """
    fold, camera, limits = sensor.fold.matrix, sensor.camera, sensor.identification
    if fold is None:
        raise ValueError("the patent's method is for two fields")
    width = 2.0 * SkyConditions().field_radius_rad
    part = slice(0, int(np.searchsorted(sensor.catalogue.hp_mag, limits.faintest_star_mag, side="right")))
    sky = build_four_sky(sensor.catalogue.directions(limits.epoch_jyear, stars=part), sensor.catalogue.hip[part], width)
    rng = np.random.default_rng(seed)
    found = sum(len(primaries(_round_field(rng, 4, width), sky, fold, WIDE_TOLERANCE_RAD)) for _ in range(frames))
    tolerance = 4.0 * math.sqrt(2.0) * camera.spot_noise_px / camera.focal_length_px
    return found / frames * (tolerance / WIDE_TOLERANCE_RAD) ** 5


def detector_use(sensor: StarSensor, width_rad: float, frames: int, seed: int) -> float:
    """Mean stars of two fields behind a half mirror over those of one field of the same lens."""
    rng = np.random.default_rng(seed)
    faintest = SkyConditions().faintest_mag
    counts = []
    for depth, fields in ((faintest, 2.0), (faintest + HALF_MIRROR_MAG, 1.0)):
        simulator = StarFieldSimulator(sensor, SkyConditions(faintest_mag=depth))
        look = rng.normal(size=(frames, 3))
        look /= np.linalg.norm(look, axis=1, keepdims=True)
        inside = look @ simulator.directions.T > math.cos(0.5 * width_rad)
        counts.append(fields * float(np.mean(np.sum(inside, axis=1))))
    return counts[0] / counts[1]
