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
    """The patent's single-field roll accuracy as our text of it shows it, 2 N^(-1/2) sigma tan(FOV), rad.

    Wrong: it falls as the field narrows, where the roll gets worse. The right form is
    sqrt 2 sigma / (sqrt N sin(FOV / 2)), which `attitude_sigma` approaches. The text has lost roots and fraction bars
    in its other formulas, so that this one may have had them: `patent_roll_readings`.
    """
    return 2.0 * sigma_rad * math.tan(field_width_rad) / math.sqrt(stars)


def patent_roll_readings(stars: float, field_width_rad: float, sigma_rad: float) -> dict[str, float]:
    """What the patent's roll formula gives (rad), read as the text shows it and with what it may have lost.

    The text's own sentence after it, pitch and yaw better than 1e-5 rad and roll about 1e-3, speaks for a fraction.
    """
    over = sigma_rad / (math.sqrt(stars) * math.tan(field_width_rad))
    return {
        "2 sigma tan(FOV) / sqrt(N), as the text shows it": patent_roll_sigma(stars, field_width_rad, sigma_rad),
        "2 sigma / (sqrt(N) tan(FOV)), with a fraction bar": 2.0 * over,
        "sqrt(2) sigma / (sqrt(N) tan(FOV)), with bar and root": math.sqrt(2.0) * over,
    }
