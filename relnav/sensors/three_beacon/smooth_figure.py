"""A detector's distortion as optics, fitted freely, and a smooth figure whose size and length the points tell.

    error = offset, scale, shear + pin-cushion t |t|^2 + tilt (T t) t + figure,    cov(figure) = s^2 exp(-d^2 / (2 l^2))

written in products of Legendre polynomials, orthonormal over the box of the points. Given size s, length l and the
points' noise the posterior mean is the best estimate there is, linear or not: no other is within any bound more often
(Anderson 1955). All three are weighed by their restricted likelihood, both axes together, and averaged over (Patterson
and Thompson 1971; Rasmussen and Williams 2006, sections 2.7 and 5.2). The covariance says what the estimate leaves.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.sensors.three_beacon.calibration import exponent_arrays, exponents

OPTICS = 9
"""Free terms of both axes together: three each, one of the pin-cushion, two of the tilt."""
OPTICS_ORDER = 3
LENGTHS = tuple(np.geomspace(0.2, 12.0, 15).tolist())
"""Tried for the figure, in half-widths: from finer than order 12 follows to what looks like optics."""
RATIOS = np.geomspace(1e-10, 1e4, 141)
"""Tried for noise^2 / s^2."""
SLIGHT = 1e-3
"""Weight at which a length, or a ratio beside the best of its length, is left out."""
NODES = 40
"""Of Gauss's quadrature along an axis."""


def legendre(u: Matrix, order: int) -> Matrix:
    """Products (n, p) of Legendre polynomials of both coordinates up to a total order, mean square 1 over the box."""
    i, j = exponent_arrays(order)
    first, second = (np.polynomial.legendre.legvander(u[:, axis], order) for axis in range(2))
    values: Matrix = first[:, i] * second[:, j] * np.sqrt((2.0 * i + 1.0) * (2.0 * j + 1.0))
    return values


@dataclass(frozen=True)
class Figures:
    """Figures of one length that points may have come from, and their weights; of all lengths they add up to 1.

    Attributes
    ----------
    length : float
        In (larger) half-widths.
    size_m, noise_m, weight : (k,)
        1-sigma of the figure and of a point, m.
    """

    length: float
    size_m: Vector
    noise_m: Vector
    weight: Vector

    @classmethod
    def known(cls, length: float, size_m: float, noise_m: float) -> "tuple[Figures, ...]":
        """One figure that is certain."""
        return (cls(length, np.array([size_m]), np.array([noise_m]), np.ones(1)),)


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
        i, j = exponent_arrays(order)
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
        optics = box.optics(order)
        whole = np.kron(np.eye(2), terms.T @ terms)
        cross = optics.T @ whole
        inverse = np.linalg.inv(cross @ optics)
        mistaken = inverse @ cross  # (9, 2 p): the optics that a coefficient is taken for
        self._left = whole - cross.T @ mistaken
        self._free = np.eye(len(optics)) - optics @ mistaken
        self.optics: Matrix = optics @ inverse @ optics.T
        """Covariance of the coefficients over noise^2, without a figure."""

    def modes(self, variance: Matrix) -> tuple[Vector, Matrix]:
        """Values v (m,) and modes V (2 p, m) of a unit figure with this covariance (p, p) of an axis.

        With it the coefficients' covariance over noise^2 is optics + V diag(1 / (v + noise^2 / s^2)) V'.
        """
        values, vectors = np.linalg.eigh(variance)
        kept = values > 1e-14 * values[-1]
        root = np.kron(np.eye(2), vectors[:, kept] * np.sqrt(values[kept]))
        values, vectors = np.linalg.eigh(root.T @ self._left @ root)
        out: Matrix = self._free @ root @ vectors
        return np.maximum(values, 0.0), out


class Estimator:
    """The best estimator up to a total order, for points (n, 2) in half-widths of the box and likely figures.

    With the errors (n, 2) m at the points the spread of the figures' estimates is part of the covariance.

    Attributes
    ----------
    terms : (n, p)
        Legendre products at the points.
    gain : (2 p, 2 p)
        Coefficients of both axes are gain @ (terms.T @ error of each axis).
    covariance : (2 p, 2 p)
        Of the coefficients, m^2.
    missed_m : float
        1-sigma of the figure beyond the order, mean over the box.
    """

    def __init__(
        self, box: Box, u: Matrix, order: int, figures: tuple[Figures, ...], error_m: Matrix | None = None
    ) -> None:
        self.order, self.terms = order, legendre(u, order)
        normal = _Normal(box, self.terms, order)
        self.gain = normal.optics.copy()
        self.covariance = normal.optics * sum(float(some.weight @ some.noise_m**2) for some in figures)
        moments = np.zeros(len(self.gain)) if error_m is None else (self.terms.T @ error_m).T.ravel()
        mean, missed = np.zeros(len(self.gain)), 0.0
        for some in figures:
            variance = box.figure(some.length, order)
            values, modes = normal.modes(variance)
            shares = 1.0 / (values[:, None] + (some.noise_m / some.size_m) ** 2)
            self.gain += (modes * (shares @ some.weight)) @ modes.T
            self.covariance += (modes * (shares @ (some.weight * some.noise_m**2))) @ modes.T
            along = (modes.T @ moments)[:, None] * shares
            self.covariance += modes @ ((along * some.weight) @ along.T) @ modes.T
            mean += modes @ (along @ some.weight)
            missed += float(some.weight @ some.size_m**2) * max(0.0, 1.0 - float(np.trace(variance)))
        self.covariance -= np.outer(mean, mean)
        self.missed_m = math.sqrt(missed)

    def coefficients(self, error_m: Matrix) -> Matrix:
        """Of the Legendre products, (p, 2), from errors (n, 2) at the points."""
        out: Matrix = (self.gain @ (self.terms.T @ error_m).T.ravel()).reshape(2, -1).T
        return out

    def _own(self, both: Matrix) -> tuple[Matrix, Matrix]:
        p = self.terms.shape[1]
        return both[:p, :p], both[p:, p:]

    def leverage(self) -> Matrix:
        """Share (n, 2) that an error has in its own estimate; their sum is the number of terms in use."""
        own = self._own(self.gain)
        return np.stack([np.einsum("np,pq,nq->n", self.terms, block, self.terms) for block in own], axis=1)

    @property
    def fit_noise_m(self) -> float:
        """1-sigma of what is wrong with the terms in use, mean over the box and the axes."""
        return math.sqrt(0.5 * float(np.trace(self.covariance)))

    @property
    def residual_m(self) -> float:
        """1-sigma of what a correction leaves, mean over the box and the axes."""
        return math.hypot(self.fit_noise_m, self.missed_m)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the chi-square that has mean and variance of what an axis is left with."""
        own = self._own(self.covariance)
        return float(np.mean([np.trace(block) ** 2 / (block**2).sum() for block in own]))

    def chance(self, target_m: float) -> float:
        """Probability that 3 rms of an axis over the box is within a target."""
        from scipy.special import chdtr

        nu = self.freedom
        return float(chdtr(nu, nu * (target_m / (3.0 * self.residual_m)) ** 2))


def likely_figures(box: Box, u: Matrix, error_m: Matrix, order: int) -> tuple[Figures, ...]:
    """Figures that errors (n, 2) m at points (n, 2) in half-widths may come from, weighed; flat in every logarithm.

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
    surprises, sizes2 = [], []  # -2 log likelihood, and s^2, of every length and ratio
    for length in LENGTHS:
        values, modes = normal.modes(box.figure(length, order))
        spread = values[:, None] + RATIOS
        misfit = total - ((modes.T @ moments)[:, None] ** 2 / spread).sum(axis=0)
        misfit = np.maximum(misfit / RATIOS, np.finfo(float).tiny)
        surprises.append(m * np.log(misfit / m) + (m - len(values)) * np.log(RATIOS) + np.log(spread).sum(axis=0))
        sizes2.append(misfit / (m - 2))
    weights = np.exp(-0.5 * (np.array(surprises) - np.min(surprises)))
    weights[weights < SLIGHT * weights.max(axis=1, keepdims=True)] = 0.0
    weights[weights.sum(axis=1) < SLIGHT * weights.sum()] = 0.0
    weights /= weights.sum()
    out = []
    for length, size2, weight in zip(LENGTHS, sizes2, weights, strict=True):
        kept = weight > 0.0
        if kept.any():
            size = np.sqrt(size2[kept])
            out.append(Figures(length, size, size * np.sqrt(RATIOS[kept]), weight[kept]))
    return tuple(out)
