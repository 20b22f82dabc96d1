"""Rays, their three numbers, and range, azimuth and elevation, of complex arguments too: for `engine="filterpy"`."""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.navigation.reference.motion import cross

ALL = [0, 1, 2]
"""Beacons whose three numbers are meant; two of them: the one number of a pair."""


def unit(vectors: Matrix) -> Matrix:
    """Vectors (..., 3) to length one."""
    out: Matrix = vectors / np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
    return out


def numbers_of(rays: Matrix, seen: list[int]) -> Matrix:
    """(g1, g2, g3) of unit rays (..., 3, 3) to A, B and C, or the squared chord of two of them, (..., k)."""
    first, second = rays[..., seen[0], :], rays[..., seen[1], :]
    apart = first - second
    chord = (apart * apart).sum(axis=-1)
    if len(seen) == 2:
        alone: Matrix = chord[..., None]
        return alone
    third = rays[..., 2, :]
    out: Matrix = np.stack([chord, (third * apart).sum(axis=-1), (third * cross(first, second)).sum(axis=-1)], axis=-1)
    return out


def cosine(a: Vector, b: Vector) -> float:
    """Of the angle between two vectors."""
    return float(a @ b / math.sqrt((a @ a) * (b @ b)))


def turn_of(seen: Matrix, known: Matrix) -> Matrix:
    """The rotation (3, 3) from the axes of known rays to A and B, (3, 3), to those of the seen ones, by triads."""

    def triad(rays: Matrix) -> Matrix:
        apart, both = rays[0] - rays[1], rays[0] + rays[1]
        first, third = unit(apart), unit(np.cross(apart, both))
        return np.stack([first, np.cross(third, first), third])

    out: Matrix = triad(seen).T @ triad(known)
    return out


def to_angles(p: Vector) -> Matrix:
    """Derivative (3, 3) of range, azimuth and elevation by the position p, docking frame."""
    x, y, z = p
    h, r = math.hypot(x, y), math.sqrt(p @ p)
    return np.array([p / r, [-y / h**2, x / h**2, 0.0], [x * z / (h * r**2), y * z / (h * r**2), -h / r**2]])


def angles_between(p: Vector, q: Vector) -> Vector:
    """(Range, azimuth, elevation) of p minus that of q, the angles within half a turn."""

    def of(v: Vector) -> tuple[float, float, float]:
        return float(np.linalg.norm(v)), math.atan2(v[1], v[0]), math.atan2(-v[2], math.hypot(v[0], v[1]))

    (r, az, el), (s, other_az, other_el) = of(p), of(q)
    turn = 2.0 * math.pi
    return np.array([r - s, math.remainder(az - other_az, turn), math.remainder(el - other_el, turn)])
