"""How the stars of one picture are smeared: a camera that turns during the exposure moves all of them alike.

At a place r from the picture's middle a star is spread along s = a + b J r, J a quarter turn: a shift, and a roll about
the boresight. With x + i y for a vector its second moments differ along and across by q = s^2, so that a and b follow
from the bright stars, and the faint ones need not show how long they are. s is a 1-sigma length, signed either way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Flags, Matrix, Stack, Vector

Plane = NDArray[np.complex128]

FEWEST, FEWEST_ROLLED = 6, 10
"""Bright stars that tell a smear; and one with a roll: half as many again as its three numbers need, and more."""
MOST_TOLD = 100
"""Bright stars that are asked: more would not make the smear any surer, and each is compared with each."""
SMEARED = 0.1
"""Least difference of the moments along and across, of their sum, under a window as wide as a star. A streak below is
shorter than two radii, and a round window's covariance still right to some per cent."""
LONG = 0.25
"""The same of stars that are not alike: twice the median that noise alone makes at a flux of ten sigma."""
AGREEING, NEAR_SMEAR = 0.75, 0.5
"""Share of the bright stars that must show the common smear, to this part of it. Two fields on one detector do not."""
ROLL_GAIN = 0.8
"""Most of the shift's misfit that is left with a roll: chance takes off less than a sixth, for three numbers of 20."""
FULLEST = 0.8
"""Moment under a window, of the window's own, that is believed in one pass: the shape grows twofold in each."""
APART_PX, TRAIL_PX, TRAIL_WIDTH_PX = 24.0, 48.0, 3.0
"""Peaks nearer are of one star; elongated ones farther in line with each other, up to so far, are of a trail or a
column, which tell nothing of the stars."""
LONGEST_PX = 8.0
"""Largest 1-sigma length of a window: a streak of 22 px fits, whose stamp is twice as wide as the widest round star's.
Longer ones break up into peaks that stay apart."""
ROUNDS = 15


@dataclass(frozen=True)
class Smear:
    """A picture's common smear.

    Attributes
    ----------
    shift, roll : complex, float
        a, px, and b; see the module.
    middle : (2,)
        Where r is zero, column and row.
    radius_px : float
        1-sigma radius of a star across its smear.
    alike : bool
        Whether all stars are smeared so. Else most are longer than wide, but not alike, as in two fields on one
        detector: then nothing but `alike` counts.
    """

    shift: complex
    roll: float
    middle: Vector
    radius_px: float
    alike: bool

    def along(self, places: Matrix) -> Plane:
        """The length s, px, of stars at columns and rows (n, 2)."""
        z = _plane(places - self.middle)
        s: Plane = self.shift + 1j * self.roll * z
        return s

    def stretch(self, places: Matrix, window_px: float) -> tuple[Stack, Stack]:
        """Matrices (n, 2, 2) that make round stars as long as these; of a window as long as LONGEST_PX at most.

        And the covariance (n, 2, 2), px^2, of a centre somewhere along what is longer than that.
        """
        s = self.along(places)
        longer = np.hypot(1.0, np.abs(s) / self.radius_px)
        most = max(1.0, LONGEST_PX / window_px)
        t = np.exp(1j * np.angle(s))
        t = np.stack([t.real, t.imag], axis=-1)
        both = t[:, :, None] * t[:, None, :]
        left = np.maximum(longer**2 - most**2, 0.0) * self.radius_px**2
        return np.eye(2) + (np.minimum(longer, most) - 1.0)[:, None, None] * both, left[:, None, None] * both


def pooled(
    places: Matrix, shapes: Stack, elongated: Matrix, share: float, middle: Vector, window_px: float
) -> Smear | None:
    """The common smear of a picture's stars, or None: too few, or most of them round.

    Parameters
    ----------
    places, shapes : (n, 2), (n, 2, 2)
        Column and row, and second moments px^2, of the bright stars, brightest first.
    elongated : (k, 2)
        Column and row of all that is longer than wide.
    share : float
        Of the bright stars that are handed in: those lost under a window of the wrong shape are not alike.
    middle : (2,)
        Column and row of the picture's middle.
    window_px : float
        Of a round star.
    """
    q = _difference(shapes)
    told = np.arange(min(len(places), MOST_TOLD))
    told = told[~_beside_brighter(places[told])]
    told = told[~_in_line(places[told], q[told], elongated)]
    if len(told) < FEWEST:
        return None
    q, z = q[told], _plane(places[told] - middle)
    across = 0.5 * (np.trace(shapes[told], axis1=1, axis2=2) - np.abs(q))
    radius2 = max(float(np.median(across)), 1e-6)

    def lean(longer: float) -> float:
        narrow, wide = (1.0 / (1.0 / m + 1.0 / max(window_px**2, radius2)) for m in (radius2, radius2 + longer))
        return (wide - narrow) / (wide + narrow)

    shift, roll = _fitted(z, q)
    s2 = (shift + 1j * roll * z) ** 2
    usual = float(np.median(np.abs(s2)))
    agreeing = np.abs(q - s2) < NEAR_SMEAR * np.maximum(np.abs(s2), usual)
    alike = lean(usual) > SMEARED and share * np.mean(agreeing) >= AGREEING
    if not alike and lean(float(np.median(np.abs(q)))) < LONG:
        return None
    return Smear(shift, roll, middle, float(np.sqrt(radius2)), bool(alike))


def shapes_from(moments: Stack, window_px: float) -> Stack:
    """Second moments of stars from those under a Gaussian window: 1/m = 1/r^2 + 1/s^2 along each axis."""
    values, axes = np.linalg.eigh(moments)
    part = np.clip(values / window_px**2, 1e-3, FULLEST)
    shapes: Stack = np.einsum("nij,nj,nkj->nik", axes, window_px**2 * part / (1.0 - part), axes)
    return shapes


def _plane(vectors: Matrix) -> Plane:
    z: Plane = vectors[:, 0] + 1j * vectors[:, 1]
    return z


def _difference(shapes: Stack) -> Plane:
    """Moments along less across, at twice the angle: s^2 of a smear."""
    q: Plane = shapes[:, 0, 0] - shapes[:, 1, 1] + 2j * shapes[:, 0, 1]
    return q


def _beside_brighter(places: Matrix) -> Flags:
    """Which of the places, brightest first, are peaks of one before."""
    near = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) < APART_PX
    beside: Flags = np.any(np.tril(near, -1), axis=1)
    return beside


def _in_line(places: Matrix, q: Plane, elongated: Matrix) -> Flags:
    """Which of the places have another elongated one ahead or behind."""
    turned = _plane(places)[:, None] - _plane(elongated)[None]
    turned = turned * np.exp(-0.5j * np.angle(q))[:, None]
    ahead, aside = np.abs(turned.real), np.abs(turned.imag)
    in_line: Flags = np.any((ahead > APART_PX) & (ahead < TRAIL_PX) & (aside < TRAIL_WIDTH_PX), axis=1)
    return in_line


def _fitted(z: Plane, q: Plane) -> tuple[complex, float]:
    """Shift a and roll b of least sum of |q - (a + i b z)^2|, b = 0 unless it is less by far with a roll."""
    middle = complex(np.median(q.real), np.median(q.imag))
    best, cost = _descended(z, q, complex(np.sqrt(middle)), 0.0, rolled=False)
    if len(z) < FEWEST_ROLLED:
        return best
    scale = float(np.sqrt(np.mean(np.abs(z) ** 2)))
    unit = z / scale
    design, weight = np.stack([np.ones_like(unit), unit, unit**2], axis=-1), np.ones(len(z))
    for _ in range(ROUNDS):
        one, other, square = np.linalg.lstsq(design * weight[:, None], q * weight, rcond=None)[0]
        weight = _weights(q - design @ np.array([one, other, square]))
    a = complex(np.sqrt(one))
    b = float(np.sqrt(abs(square)))
    starts = [(complex(other / (2j * b)), b)] if b > 0.0 else []
    if abs(a) > 0.0:
        starts.append((a, float((other / (2j * a)).real)))
    for start in starts:
        found, misfit = _descended(unit, q, *start, rolled=True)
        if misfit < ROLL_GAIN * cost:
            best, cost = (found[0], found[1] / scale), misfit / ROLL_GAIN
    return best


def _weights(left: Plane) -> Vector:
    """Square roots of the weights that make least squares a sum of absolute values."""
    size = np.abs(left)
    weights: Vector = 1.0 / np.sqrt(np.maximum(size, 0.05 * np.median(size) + 1e-9))
    return weights


def _descended(z: Plane, q: Plane, a: complex, b: float, *, rolled: bool) -> tuple[tuple[complex, float], float]:
    """Gauss-Newton on q = (a + i b z)^2 with the weights of absolute values; and the mean misfit."""
    for _ in range(ROUNDS):
        s = a + 1j * b * z
        left = q - s**2
        columns = [2.0 * s, 2.0j * s] + ([2.0j * s * z] if rolled else [])
        rows = np.stack([np.concatenate([column.real, column.imag]) for column in columns], axis=-1)
        weight = np.tile(_weights(left), 2)
        step = np.linalg.lstsq(rows * weight[:, None], np.concatenate([left.real, left.imag]) * weight, rcond=None)[0]
        a, b = a + complex(step[0], step[1]), b + (float(step[2]) if rolled else 0.0)
    return (a, b), float(np.mean(np.abs(q - (a + 1j * b * z) ** 2)))
