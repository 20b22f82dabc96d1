"""Closed forms: the attitude accuracy that a number of stars in one field or two allows, and the patent's formula."""

import math

import numpy as np

from relnav.arrays import Vector


def attitude_sigma(stars_0: float, stars_1: float, field_width_rad: float, sigma_rad: float) -> Vector:
    """1-sigma about camera x, y, z, (3,) rad, of stars spread evenly over round fields looking along z and along x.

    From F = sum (I - w w^T) / sigma^2: with q = 1 - (1 + cos r + cos^2 r) / 3 the mean of sin^2 over a cap of
    half-angle r, a star counts 1 - q / 2 about an axis across its boresight and q about the boresight itself.
    """
    r = math.cos(0.5 * field_width_rad)
    q = 1.0 - (1.0 + r + r * r) / 3.0
    across, along = 1.0 - 0.5 * q, q
    weight = np.array(
        [
            stars_0 * across + stars_1 * along,
            (stars_0 + stars_1) * across,
            stars_0 * along + stars_1 * across,
        ]
    )
    sigma: Vector = sigma_rad / np.sqrt(weight)
    return sigma


def patent_roll_sigma(stars: float, field_width_rad: float, sigma_rad: float) -> float:
    """The patent's single-field roll accuracy as printed, 2 N^(-1/2) sigma tan(FOV), rad.

    Wrong: it falls as the field narrows, where the roll gets worse. The right form is
    sqrt 2 sigma / (sqrt N sin(FOV / 2)), which `attitude_sigma` approaches.
    """
    return 2.0 * sigma_rad * math.tan(field_width_rad) / math.sqrt(stars)
