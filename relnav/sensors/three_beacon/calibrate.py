"""Fit a detector's calibration from a grid of known spots: the order by cross-validation, and what it leaves.

Every order is fitted by least squares. Leaving one point out and predicting it costs nothing extra: the error is
e_i / (1 - h_i), h_i the leverage (Allen 1974); the order with the least of these over both axes is taken. The choice
is uncertain by one, so the next order is added and every degree from the second on is shrunk by how little it stands
out of the noise (the positive part of James and Stein 1961): a degree that is noise vanishes. What the correction
leaves has two parts: the fit's own noise, sigma sqrt(p / n) for p terms in use from n points, and what they cannot
follow, seen as residuals above the noise.
"""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix
from relnav.sensors.three_beacon.calibration import Calibration, exponents, powers

HIGHEST_ORDER = 10
POINTS_PER_TERM = 1.5
"""An order is tried only while there are this many points a term."""
SPARE_ORDERS = 2
"""The noise is read from orders up to this much above the one in question: they follow the figure more closely."""


@dataclass(frozen=True)
class OrderFit:
    """One order: terms, error of predicted left-out points, fit noise, figure that it does not follow; 1-sigma."""

    order: int
    terms: int
    prediction_m: float
    fit_noise_m: float
    figure_m: float

    @property
    def residual_m(self) -> float:
        """1-sigma of what the correction leaves, each axis."""
        return math.hypot(self.fit_noise_m, self.figure_m)

    def points_for(self, target_m: float, noise_m: float) -> float:
        """Grid points with which 3-sigma of this order comes down to the target; inf if its figure alone is above."""
        room = (target_m / 3.0) ** 2 - self.figure_m**2
        return self.terms * noise_m**2 / room if room > 0.0 else math.inf


@dataclass(frozen=True)
class CalibrationReport:
    """What a grid gave.

    Attributes
    ----------
    calibration : Calibration
        The correction.
    orders : tuple of OrderFit
        Every order tried, by plain least squares.
    chosen : OrderFit
        The one that predicts left-out points best; the calibration's own order is one above, shrunk.
    raw_max_m, raw_rms_m : float
        Detection error before: largest and rms, each axis.
    noise_m : float
        1-sigma of a grid point, each axis, estimated.
    empty_cells : int
        Of 25 equal cells of the grid's box, those without a point.
    detector_share : float or None
        Part of the detector's area that the box covers, if the detector is known.
    target_m : float
        Wanted 3-sigma of what the correction leaves.
    """

    calibration: Calibration
    orders: tuple[OrderFit, ...]
    chosen: OrderFit
    raw_max_m: float
    raw_rms_m: float
    noise_m: float
    empty_cells: int
    detector_share: float | None
    target_m: float

    @property
    def reached_m(self) -> float:
        """3-sigma of what the correction leaves, each axis."""
        return 3.0 * self.calibration.residual_sigma_m

    @property
    def met(self) -> bool:
        """Whether the target is reached on a grid without holes."""
        return self.reached_m <= self.target_m and self.empty_cells == 0

    def recommended(self) -> tuple[int, int] | None:
        """Side of a square grid that reaches the target, and the order that then does; None if no order tried can."""
        best = min(self.orders, key=lambda fit: fit.points_for(self.target_m, self.noise_m))
        points = best.points_for(self.target_m, self.noise_m)
        if not math.isfinite(points):
            return None
        return math.ceil(math.sqrt(max(points, POINTS_PER_TERM * best.terms))), best.order


def calibrate(
    true_m: Matrix,
    measured_m: Matrix,
    *,
    detector_size_m: tuple[float, float] | None = None,
    target_m: float = 10e-6,
    highest_order: int = HIGHEST_ORDER,
) -> CalibrationReport:
    """Fit the correction that takes measured spots to true ones.

    Parameters
    ----------
    true_m, measured_m : (n, 2)
        Known and measured positions, m; a row with NaN is left out.
    detector_size_m : (2,), optional
        For the share of the detector that is covered.
    target_m : float
        Wanted 3-sigma of what is left, each axis: the recommendation is for it.
    highest_order : int
        Total orders 0 .. this are tried, as far as the points allow.

    Raises
    ------
    ValueError
        For arrays of other shapes, fewer than six usable points, or points on one line.
    """
    true_m, measured_m = np.asarray(true_m, dtype=np.float64), np.asarray(measured_m, dtype=np.float64)
    if true_m.ndim != 2 or true_m.shape[1] != 2 or true_m.shape != measured_m.shape:
        raise ValueError(f"true_m and measured_m have one shape (n, 2); got {true_m.shape} and {measured_m.shape}")
    known = np.isfinite(true_m).all(axis=1) & np.isfinite(measured_m).all(axis=1)
    true_m, measured_m = true_m[known], measured_m[known]
    if len(true_m) < 6:
        raise ValueError(f"six points or more are needed for a calibration; got {len(true_m)}")
    low, high = measured_m.min(axis=0), measured_m.max(axis=0)
    center, half = 0.5 * (low + high), 0.5 * (high - low)
    if not (half > 0.0).all():
        raise ValueError("the points lie on one line; spread them over the detector")
    u = (measured_m - center) / half
    error = true_m - measured_m
    fits, noise = _fit_orders(u, error, highest_order)
    chosen = min(fits, key=lambda fit: fit.prediction_m)
    top = min(chosen.order + 1, len(fits) - 1)
    solution, in_use = _shrunk(u, error, top, noise)
    calibration = Calibration(
        order=top,
        center_m=(float(center[0]), float(center[1])),
        half_width_m=(float(half[0]), float(half[1])),
        correction_x_m=tuple(solution[:, 0].tolist()),
        correction_y_m=tuple(solution[:, 1].tolist()),
        residual_sigma_m=math.hypot(noise * math.sqrt(in_use / len(u)), fits[top].figure_m),
        rim_slope=_rim_slope(solution, top, half),
        points=len(u),
        noise_sigma_m=noise,
    )
    cells = np.minimum((0.5 * (u + 1.0) * 5.0).astype(int), 4)
    return CalibrationReport(
        calibration=calibration,
        orders=tuple(fits),
        chosen=chosen,
        raw_max_m=float(np.abs(error).max()),
        raw_rms_m=float(np.sqrt(np.mean(error**2))),
        noise_m=noise,
        empty_cells=25 - len({(int(i), int(j)) for i, j in cells}),
        detector_share=None if detector_size_m is None else float(4.0 * half.prod() / np.prod(detector_size_m)),
        target_m=target_m,
    )


def _fit_orders(u: Matrix, error: Matrix, highest: int) -> tuple[list[OrderFit], float]:
    """Every affordable order, and the noise of a point."""
    n = len(u)
    predictions, spreads = [], []
    for order in range(highest + 1):
        terms = len(exponents(order))
        if order > 1 and n < POINTS_PER_TERM * terms:
            break
        q, r = np.linalg.qr(powers(u, order))
        if np.abs(np.diag(r)).min() < 1e-10 * np.abs(np.diag(r)).max():
            break  # the points do not tell these terms apart
        left = error - q @ (q.T @ error)
        leverage = np.minimum((q**2).sum(axis=1), 1.0 - 1e-12)[:, None]
        predictions.append(float(np.sqrt(np.mean((left / (1.0 - leverage)) ** 2))))
        spreads.append(float((left**2).sum() / (2.0 * (n - terms))) if n > terms else math.nan)
    best = int(np.argmin(predictions))
    noise2 = min(spreads[: best + SPARE_ORDERS + 1])
    fits = []
    for order, (prediction, spread) in enumerate(zip(predictions, spreads, strict=True)):
        terms = len(exponents(order))
        figure = math.sqrt(max(0.0, spread - noise2))
        fits.append(OrderFit(order, terms, prediction, math.sqrt(noise2 * terms / n), figure))
    return fits, math.sqrt(noise2)


def _shrunk(u: Matrix, error: Matrix, order: int, noise: float) -> tuple[Matrix, float]:
    """Coefficients (p, 2) with every degree shrunk by its own noise, and how many terms an axis then has in use."""
    degree = np.array([i + j for i, j in exponents(order)])
    q, r = np.linalg.qr(powers(u, order))  # column after column: each degree is what the lower ones leave
    c, in_use = q.T @ error, 3.0
    for d in range(2, order + 1):
        block = degree == d
        values = 2 * int(block.sum())  # of both axes
        energy = float((c[block] ** 2).sum())
        kept = max(0.0, 1.0 - (values - 2) * noise**2 / energy) if energy > 0.0 else 0.0
        c[block] *= kept
        in_use += kept * 0.5 * values
    return np.linalg.solve(r, c), in_use


def _rim_slope(solution: Matrix, order: int, half: Matrix) -> float:
    """Rms slope of the correction, both axes and both directions, along the edge of the box."""
    along = np.linspace(-1.0, 1.0, 41)
    one = np.ones_like(along)
    rim = np.concatenate(
        [np.stack(pair, axis=1) for pair in ((along, one), (along, -one), (one, along), (-one, along))]
    )
    step = 1e-4
    total = 0.0
    for axis in range(2):
        offset = np.zeros(2)
        offset[axis] = step
        slope = (powers(rim + offset, order) - powers(rim - offset, order)) @ solution / (2.0 * step * half[axis])
        total += float(np.mean((slope**2).sum(axis=1)))
    return math.sqrt(0.5 * total)
