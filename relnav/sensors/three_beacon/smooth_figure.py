"""A detector's distortion as optics, fitted freely, and a smooth figure whose size and length the points tell.

    error = offset, scale, shear + pin-cushion t |t|^2 + tilt (T t) t + figure,    cov(figure) = s^2 exp(-d^2 / (2 l^2))

written in products of Legendre polynomials, orthonormal over the box of the points. Size s, length l and the points'
noise are those of greatest restricted likelihood, both axes together (Patterson and Thompson 1971; Rasmussen and
Williams 2006, sections 2.7 and 5.4). Given them the posterior mean is the best estimate there is, linear or not: no
other is within any bound more often (Anderson 1955). Its covariance says what it leaves.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.sensors.three_beacon.calibration import exponents

OPTICS = 9
"""Free terms of both axes together: three each, one of the pin-cushion, two of the tilt."""
OPTICS_ORDER = 3
LENGTHS = tuple(np.geomspace(0.2, 12.0, 15).tolist())
"""Tried for the figure, in half-widths: from finer than order 12 follows to what looks like optics."""
RATIOS = np.geomspace(1e-10, 1e4, 141)
"""Tried for noise^2 / s^2."""
NODES = 40
"""Of Gauss's quadrature along an axis."""


def legendre(u: Matrix, order: int) -> Matrix:
    """Products (n, p) of Legendre polynomials of both coordinates up to a total order, mean square 1 over the box."""
    i, j = np.array(exponents(order)).T
    first, second = (np.polynomial.legendre.legvander(u[:, axis], order) for axis in range(2))
    values: Matrix = first[:, i] * second[:, j] * np.sqrt((2.0 * i + 1.0) * (2.0 * j + 1.0))
    return values


@dataclass(frozen=True)
class Figure:
    """What points tell: 1-sigma of the figure and of a point, m, and the figure's length in (larger) half-widths."""

    size_m: float
    length: float
    noise_m: float


@dataclass(frozen=True)
class Box:
    """Where the points lie: centre and half-widths (2,) m."""

    center_m: Vector
    half_m: Vector

    @classmethod
    def around(cls, points_m: Matrix) -> "Box":
        """Of points (n, 2) m."""
        low, high = points_m.min(axis=0), points_m.max(axis=0)
        return cls(0.5 * (low + high), 0.5 * (high - low))

    def scaled(self, points_m: Matrix) -> Matrix:
        """Points (n, 2) m in half-widths from the centre."""
        u: Matrix = (points_m - self.center_m) / self.half_m
        return u

    def grid(self, side: int) -> Matrix:
        """A square grid (side^2, 2) to the edges, m."""
        line = np.linspace(-1.0, 1.0, side)
        points: Matrix = self.center_m + self.half_m * np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        return points

    def optics(self, order: int) -> Matrix:
        """The free terms (2 p, 9) as coefficients of both axes, the x axis first."""
        nodes, weights = np.polynomial.legendre.leggauss(OPTICS_ORDER + 1)
        u = np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
        x, y = ((self.center_m + self.half_m * u) / self.half_m.max()).T
        affine, other = np.column_stack([np.ones(len(u)), u]), np.zeros((len(u), 3))
        pin = x**2 + y**2
        fields = (
            np.column_stack([affine, other, x * pin, x * x, x * y]),
            np.column_stack([other, affine, y * pin, x * y, y * y]),
        )
        project = legendre(u, OPTICS_ORDER).T * (0.25 * np.outer(weights, weights).ravel())
        missing = np.zeros((len(exponents(order)) - len(project), OPTICS))
        return np.vstack([part for field in fields for part in (project @ field, missing)])

    def figure(self, length: float, order: int) -> Matrix:
        """Covariance (p, p) of an axis' coefficients of a figure of unit size."""
        first, second = (_along(length * float(self.half_m.max() / half), order) for half in self.half_m)
        i, j = np.array(exponents(order)).T
        out: Matrix = first[np.ix_(i, i)] * second[np.ix_(j, j)]
        return out


@lru_cache(maxsize=256)
def _along(length: float, order: int) -> Matrix:
    """Covariance of the Legendre coefficients of a unit figure along one axis of half-width 1."""
    x, weights = np.polynomial.legendre.leggauss(NODES)
    terms = np.polynomial.legendre.legvander(x, order) * np.sqrt(2.0 * np.arange(order + 1) + 1.0)
    terms *= 0.5 * weights[:, None]
    out: Matrix = terms.T @ np.exp(-0.5 * ((x[:, None] - x) / length) ** 2) @ terms
    return out


class _Normal:
    """Normal equations of both axes: Z'Z, and what is left of it when the optics X are fitted freely."""

    def __init__(self, box: Box, terms: Matrix, order: int) -> None:
        self.optics = box.optics(order)
        whole = _both(terms.T @ terms)
        cross = self.optics.T @ whole
        self.inverse = np.linalg.inv(cross @ self.optics)
        self.mistaken = self.inverse @ cross  # (9, 2 p): the optics that a coefficient is taken for
        self.left = whole - cross.T @ self.mistaken

    def gain(self, root: Matrix, ratio: float) -> Matrix:
        """Covariance (2 p, 2 p) of the coefficients over noise^2, for the figure's root and noise^2 / s^2."""
        free = root - self.optics @ (self.mistaken @ root)
        inner = root.T @ self.left @ root + ratio * np.eye(root.shape[1])
        out: Matrix = free @ np.linalg.solve(inner, free.T) + self.optics @ self.inverse @ self.optics.T
        return out


def _both(own: Matrix) -> Matrix:
    """Block diagonal of two."""
    out: Matrix = np.kron(np.eye(2), own).astype(np.float64)
    return out


def _root(variance: Matrix) -> Matrix:
    """R of variance = R R' of both axes; it may be singular."""
    values, vectors = np.linalg.eigh(variance)
    return _both(vectors * np.sqrt(np.maximum(values, 0.0)))


class Estimator:
    """The best estimator up to a total order, for points (n, 2) in half-widths of the box, a figure and a noise.

    `gain` (2 p, 2 p) times noise^2 is the covariance of the coefficients of both axes.
    """

    def __init__(self, box: Box, u: Matrix, order: int, figure: Figure) -> None:
        self.order, self.figure, self.terms = order, figure, legendre(u, order)
        variance = box.figure(figure.length, order)
        ratio = (figure.noise_m / figure.size_m) ** 2
        self.gain = _Normal(box, self.terms, order).gain(_root(variance), ratio)
        self.missed_m = figure.size_m * math.sqrt(max(0.0, 1.0 - float(np.trace(variance))))
        """1-sigma of the figure beyond the order, mean over the box."""
        self.fit_noise_m = figure.noise_m * math.sqrt(0.5 * float(np.trace(self.gain)))
        """1-sigma of what is wrong with the terms in use, mean over the box and the axes."""

    def coefficients(self, error_m: Matrix) -> Matrix:
        """Of the Legendre products, (p, 2), from errors (n, 2) at the points."""
        out: Matrix = (self.gain @ (self.terms.T @ error_m).T.ravel()).reshape(2, -1).T
        return out

    def leverage(self) -> Matrix:
        """Share (n, 2) that an error has in its own estimate; their sum is the number of terms in use."""
        p = self.terms.shape[1]
        own = (self.gain[:p, :p], self.gain[p:, p:])
        return np.stack([np.einsum("np,pq,nq->n", self.terms, block, self.terms) for block in own], axis=1)

    @property
    def residual_m(self) -> float:
        """1-sigma of what a correction leaves, mean over the box and the axes."""
        return math.hypot(self.fit_noise_m, self.missed_m)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the chi-square that has mean and variance of what an axis is left with."""
        p = self.terms.shape[1]
        own = (self.gain[:p, :p], self.gain[p:, p:])
        return float(np.mean([np.trace(block) ** 2 / (block**2).sum() for block in own]))

    def chance(self, target_m: float) -> float:
        """Probability that 3 rms of an axis over the box is within a target."""
        from scipy.special import chdtr

        nu = self.freedom
        return float(chdtr(nu, nu * (target_m / (3.0 * self.residual_m)) ** 2))


def most_likely(box: Box, u: Matrix, error_m: Matrix, order: int) -> Figure:
    """Size and length of the figure and noise of the points, from errors (n, 2) m at points (n, 2) in half-widths.

    Raises
    ------
    ValueError
        If the points do not tell the optics' terms apart.
    """
    terms = legendre(u, order)
    design = np.vstack([terms @ half for half in np.vsplit(box.optics(order), 2)])
    if np.linalg.cond(design) > 1e6:
        raise ValueError("the points do not tell shear, pin-cushion and tilt apart; spread them over the detector")
    y = error_m.T.ravel()
    y = y - design @ np.linalg.lstsq(design, y)[0]
    moments = (terms.T @ y.reshape(2, -1).T).T.ravel()
    normal, m, total = _Normal(box, terms, order), len(y) - OPTICS, float(y @ y)
    least, best = math.inf, Figure(0.0, 1.0, 0.0)
    for length in LENGTHS:
        root = _root(box.figure(length, order))
        values, vectors = np.linalg.eigh(root.T @ normal.left @ root)
        values = np.maximum(values, 0.0)[:, None] + RATIOS
        along = (vectors.T @ (root.T @ moments))[:, None]
        misfit = np.maximum((total - (along**2 / values).sum(axis=0)) / RATIOS, np.finfo(float).tiny)
        surprise = m * np.log(misfit / m) + (m - len(root)) * np.log(RATIOS) + np.log(values).sum(axis=0)
        k = int(np.argmin(surprise))
        if surprise[k] < least:
            size = math.sqrt(float(misfit[k]) / m)
            least, best = float(surprise[k]), Figure(size, length, size * math.sqrt(RATIOS[k]))
    return best
