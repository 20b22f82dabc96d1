"""How a real detector misplaces spots: pin-cushion, tilt, and a smooth figure of its own.

    measured = true + P t |t|^2 / h^2 + (tilt of the surface) + F(t),      h = half the detector

The tilt of a plane detector behind a lens is a perspective map, to first order T (t_x^2, t_x t_y) / h^2 and the like,
and a shear. F is a Gaussian random field of covariance exp(-d^2 / (2 l^2)), as a sum of random waves: its length l
says how fine it is.
"""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix

WAVES = 200


@dataclass(frozen=True)
class Distortion:
    """A detector's distortion, drawn from a seed; lengths are at the edge of the detector.

    Attributes
    ----------
    half_width_m : float
        Half of the detector.
    pin_cushion_m : float
        Outward, in the middle of an edge.
    tilt_m : (2,)
        Keystone by a tilt about y and about x, in the middle of an edge.
    figure_sigma_m, figure_length_m : float
        1-sigma of the smooth figure, and its length l.
    seed : int
        Of the figure.
    """

    half_width_m: float
    pin_cushion_m: float = 0.0
    tilt_m: tuple[float, float] = (0.0, 0.0)
    figure_sigma_m: float = 0.0
    figure_length_m: float = math.inf
    seed: int = 0

    def error(self, true_m: Matrix) -> Matrix:
        """Measured minus true position (..., 2) m of spots at (..., 2) m."""
        t = np.asarray(true_m, dtype=np.float64) / self.half_width_m
        out: Matrix = self.pin_cushion_m * t * (t**2).sum(axis=-1, keepdims=True)
        out = out + (self.tilt_m[0] * t[..., :1] + self.tilt_m[1] * t[..., 1:]) * t
        rng = np.random.default_rng(self.seed)
        for axis in range(2):
            k = rng.normal(size=(2, WAVES)) * self.half_width_m / self.figure_length_m
            phase = rng.uniform(0.0, 2.0 * math.pi, WAVES)
            figure = np.cos(t @ k + phase).sum(axis=-1) * math.sqrt(2.0 / WAVES)
            out[..., axis] += self.figure_sigma_m * figure
        return out

    def apply(self, true_m: Matrix) -> Matrix:
        """Where spots at (..., 2) m are measured."""
        measured: Matrix = np.asarray(true_m) + self.error(true_m)
        return measured


def typical_distortion(
    half_width_m: float, limit_m: float, inside_share: float = 0.75, length_m: float | None = None, seed: int = 0
) -> Distortion:
    """Pin-cushion, tilt and figure in equal parts, scaled so that the largest error of a coordinate is `limit_m`.

    "Inside 75 % of the area" is `inside_share`; the figure's length is that square's half width unless stated.
    """
    inside = half_width_m * math.sqrt(inside_share)
    rng = np.random.default_rng(seed)
    tilt = rng.normal(size=2)
    tilt /= np.linalg.norm(tilt)
    sign = 1.0 if rng.uniform() < 0.5 else -1.0
    length = inside if length_m is None else length_m
    unit = Distortion(half_width_m, sign, (float(tilt[0]), float(tilt[1])), 0.5, length, seed)
    line = np.linspace(-inside, inside, 41)
    largest = np.abs(unit.error(np.stack(np.meshgrid(line, line), axis=-1))).max()
    scale = float(limit_m / largest)
    return Distortion(
        half_width_m, sign * scale, (unit.tilt_m[0] * scale, unit.tilt_m[1] * scale), 0.5 * scale, length, seed
    )
