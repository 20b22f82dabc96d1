"""The shipped sensor and random crystals and directions."""

from dataclasses import replace

import numpy as np
import pytest

import relnav


@pytest.fixture(scope="session")
def model():
    return relnav.load_model("birefringent_sun")


@pytest.fixture(scope="session")
def sensor(model):
    return model.sensor


@pytest.fixture(scope="session")
def cone():
    """cone(half angle deg, count, seed) -> unit vectors (count, 3), even over the cone."""

    def of(half_angle_deg, count, seed=0):
        rng = np.random.default_rng(seed)
        z, turn = rng.uniform(np.cos(np.radians(half_angle_deg)), 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
        return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)

    return of


@pytest.fixture(scope="session")
def crystals(sensor):
    """crystals(count, seed) -> sensors with optic axes anywhere."""

    def of(count, seed=0):
        rng = np.random.default_rng(seed)
        return [
            replace(sensor, axis_polar_rad=float(np.arccos(rng.random())), axis_azimuth_rad=float(6.28 * rng.random()))
            for _ in range(count)
        ]

    return of


@pytest.fixture(scope="session")
def traced():
    """traced(sensor, s) -> spots (N, 2, 2) px, rows o, e, by other formulas than the package's.

    The extraordinary wave vector lies where the ellipsoid of its dispersion surface, |k|^2 / n_e^2 + b (k c)^2 = 1 with
    b = 1/n_o^2 - 1/n_e^2, has the transverse part of the light outside; the ray is the ellipsoid's normal there.
    """

    def of(sensor, s):
        n_o, n_e, depth = sensor.ordinary_index, sensor.extraordinary_index, sensor.crystal_thickness_m
        polar, azimuth = sensor.axis_polar_rad, sensor.axis_azimuth_rad
        c = np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
        across, b = s[:, :2], n_o**-2 - n_e**-2
        squared, along = np.sum(across**2, axis=1), across @ c[:2]
        ordinary = depth * across / np.sqrt(n_o**2 - squared)[:, None]
        two, one, none = n_e**-2 + b * c[2] ** 2, 2.0 * b * along * c[2], squared * n_e**-2 + b * along**2 - 1.0
        k = np.column_stack([across, (-one + np.sqrt(one**2 - 4.0 * two * none)) / (2.0 * two)])
        ray = k * n_e**-2 + b * (k @ c)[:, None] * c
        both = np.stack([ordinary, depth * ray[:, :2] / ray[:, 2:]], axis=1)
        return np.array(sensor.zero_spot_px) + both / sensor.pixel_pitch_m

    return of
