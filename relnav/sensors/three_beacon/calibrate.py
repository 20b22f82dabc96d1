"""Fit a detector's calibration from a grid of known spots: the order by cross-validation, and what it leaves.

The distortion is fitted where the spots are known to be: optics freely, a smooth figure as is likely after the points
(`smooth_figure`). Of all total orders the one is taken that predicts points best which were left out; that costs
nothing extra: the error is e_i / (1 - h_i), h_i the leverage (Allen 1974). Left-out points do not see corners that hold
none: an order that is further from the highest one, over the whole box, than it says it leaves is not taken. The
correction is the distortion's inverse (`inverse`). What it leaves has three parts: the noise of the terms in use, the
figure beyond the order, and what is wrong with the inverse.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, numbers
from relnav.sensors.three_beacon.calibration import Calibration, exponents, powers
from relnav.sensors.three_beacon.inverse import invert
from relnav.sensors.three_beacon.repeated_points import SAME_M, mean_of_points, odd_readings
from relnav.sensors.three_beacon.smooth_figure import (
    LENGTHS,
    OPTICS_ORDER,
    Box,
    Estimator,
    Figures,
    legendre,
    likely_figures,
)

HIGHEST_ORDER = 12
LEAST_POINTS = 12
"""Nine numbers go to the optics, three to the figure and the noise."""
SURE = 0.99
"""Probability with which a recommended grid keeps an axis within the target."""
OUTLIER_SIGMA = 8.0
"""From where the other points put it: one point in 1e14."""
MOST_LEFT_OUT, GROSS = 0.05, 20.0
LARGEST_SIDE = 64
"""Of a grid that is recommended."""
USUAL_GAIN = 0.1
"""Of a gain's difference from one, more of which is said: a detector's own is some per cent."""
LEAST_SHARE = 0.01
"""Of the detector: nobody calibrates a tenth of its width, but micrometres may be written as millimetres."""
LARGEST_ERROR = 0.5
"""Of the grid's half width, rms: beyond it, axes or units are not what they are said to be."""


@dataclass(frozen=True)
class OrderFit:
    """One order: terms an axis, how many of them are in use, and what it does; 1-sigma of each axis, m.

    `prediction_m` is the error of predicted left-out points, their noise included; `fit_noise_m` what is wrong with the
    terms in use; `figure_m` what is beyond them; `apart_m` the rms difference from the highest order over the box.
    """

    order: int
    terms: int
    in_use: float
    prediction_m: float
    fit_noise_m: float
    figure_m: float
    apart_m: float

    @property
    def left_m(self) -> float:
        """What the order says it leaves."""
        return math.hypot(self.fit_noise_m, self.figure_m)


@dataclass(frozen=True)
class CalibrationReport:
    """What a grid gave.

    Attributes
    ----------
    calibration : Calibration
        The correction.
    orders : tuple of OrderFit
        Every order tried.
    chosen : OrderFit
        The one that predicts left-out points best, of those that agree with the highest. The correction is its
        inverse, of an order somewhat higher.
    figures : tuple of Figures
        That the points may come from.
    estimator : Estimator
        Of the chosen order: what it leaves, and with what chance.
    box : Box
        Of the known positions.
    raw_max_m, raw_rms_m : float
        Detection error before: largest and rms, each axis.
    outlier_m, outlier_sigma : (2,), float
        The known position of the point that agrees least with the others, and by how many sigmas of what is usual.
    empty_cells : int
        Of 25 equal cells of the grid's box, those without a point.
    detector_share : float or None
        Part of the detector's area that the box covers, if the detector is known.
    target_m : float
        Wanted 3-sigma of what the correction leaves.
    gain : (2,), float
        Way of the measured spot per way of the known one along each axis, mean over the points.
    """

    calibration: Calibration
    orders: tuple[OrderFit, ...]
    chosen: OrderFit
    figures: tuple[Figures, ...]
    estimator: Estimator
    box: Box
    raw_max_m: float
    raw_rms_m: float
    outlier_m: tuple[float, float]
    outlier_sigma: float
    empty_cells: int
    detector_share: float | None
    target_m: float
    gain: tuple[float, float]

    @property
    def noise_m(self) -> float:
        """1-sigma of a grid point, each axis, estimated."""
        return self.calibration.noise_sigma_m

    @property
    def figure_length_m(self) -> tuple[float, float]:
        """Between which the smooth figure's length lies with 68 %, estimated; each length tried stands for a step."""
        reached = np.cumsum([some.weight.sum() for some in self.figures])
        low, high = (self.figures[int(np.searchsorted(reached, part))].length for part in (0.16, 0.84))
        unit, half_step = float(self.box.half_m.max()), math.sqrt(LENGTHS[1] / LENGTHS[0])
        return low / half_step * unit, high * half_step * unit

    @property
    def reached_m(self) -> float:
        """3-sigma of what the correction leaves, each axis: expected 3 x rms over the box."""
        return 3.0 * self.calibration.residual_sigma_m

    @property
    def chance(self) -> float:
        """Probability that an axis is within the target."""
        return self.estimator.chance(self.target_m * self.estimator.residual_m / self.calibration.residual_sigma_m)

    @property
    def met(self) -> bool:
        """Whether the target is reached on a grid without holes."""
        return self.reached_m <= self.target_m and self.empty_cells == 0

    def recommended(self) -> int | None:
        """Side of the smallest square grid that keeps an axis within the target, `SURE`; None if it has none."""

        def sure(side: int) -> bool:
            u = self.box.scaled(self.box.grid(side))
            return Estimator(self.box, u, self.orders[-1].order, self.figures).chance(self.target_m) >= SURE

        low, high = math.isqrt(LEAST_POINTS - 1), LARGEST_SIDE
        if not sure(high):
            return None
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if sure(middle) else (middle, high)
        return high


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
        Known and measured positions, m; a row with NaN is left out. Rows of one known position are one point, measured
        where their mean is.
    detector_size_m : (2,), optional
        For the share of the detector that is covered.
    target_m : float
        Wanted 3-sigma of what is left, each axis: the recommendation is for it.
    highest_order : int
        Total orders 3 .. this are tried.

    Raises
    ------
    ValueError
        For arrays of other shapes, fewer than twelve different points, points on one line, off the detector or on less
        than a hundredth of it, measured positions that are the known ones, or have nothing to do with them, or points
        that leave the distortion open somewhere in their box.
    """
    true_m, measured_m = numbers("true_m", true_m), numbers("measured_m", measured_m)
    if true_m.ndim != 2 or true_m.shape[1] != 2 or true_m.shape != measured_m.shape:
        raise ValueError(f"true_m and measured_m have one shape (n, 2); got {true_m.shape} and {measured_m.shape}")
    known = np.isfinite(true_m).all(axis=1) & np.isfinite(measured_m).all(axis=1)
    true_m, measured_m = mean_of_points(true_m[known], measured_m[known])
    if len(true_m) < LEAST_POINTS:
        raise ValueError(f"twelve different points or more are needed for a calibration; got {len(true_m)}")
    box, seen = Box.around(true_m), Box.around(measured_m)
    if not ((box.half_m > 0.0).all() and (seen.half_m > 0.0).all()):
        raise ValueError("the points lie on one line; spread them over the detector")
    u, error = box.scaled(true_m), measured_m - true_m
    _check_errors(true_m, measured_m, error, float(box.half_m.max()), detector_size_m)
    figures = likely_figures(box, u, error, highest_order)
    fits = _fit_orders(box, u, error, highest_order, figures)
    chosen = _chosen(fits)
    estimator = Estimator(box, u, chosen.order, figures, error)
    fitted, raw_max_m = estimator.coefficients(error), float(np.abs(error).max())
    inverse = invert(
        lambda true: legendre(box.scaled(true), chosen.order) @ fitted,
        box,
        seen,
        chosen.order,
        estimator.residual_m,
        raw_max_m,
    )
    beside = np.hypot(*_beside_others(estimator, error, 0.5).T)
    worst = int(np.argmax(beside))
    cells = np.minimum((0.5 * (u + 1.0) * 5.0).astype(int), 4)
    return CalibrationReport(
        calibration=Calibration(
            order=inverse.order,
            center_m=(float(seen.center_m[0]), float(seen.center_m[1])),
            half_width_m=(float(seen.half_m[0]), float(seen.half_m[1])),
            correction_x_m=tuple(inverse.coefficients[:, 0].tolist()),
            correction_y_m=tuple(inverse.coefficients[:, 1].tolist()),
            residual_sigma_m=math.hypot(estimator.residual_m, inverse.wrong_m),
            rim_slope=_rim_slope(inverse.coefficients, inverse.order, seen.half_m),
            points=len(u),
            noise_sigma_m=math.sqrt(sum(float(some.weight @ some.noise_m**2) for some in figures)),
        ),
        orders=tuple(fits),
        chosen=chosen,
        figures=figures,
        estimator=estimator,
        box=box,
        raw_max_m=raw_max_m,
        raw_rms_m=float(np.sqrt(np.mean(error**2))),
        outlier_m=(float(true_m[worst, 0]), float(true_m[worst, 1])),
        outlier_sigma=float(beside[worst] / np.median(beside) * math.sqrt(2.0 * math.log(2.0))),
        empty_cells=25 - len({(int(i), int(j)) for i, j in cells}),
        detector_share=None if detector_size_m is None else float(4.0 * seen.half_m.prod() / np.prod(detector_size_m)),
        target_m=target_m,
        gain=_gain(u, measured_m, box),
    )


def calibrate_without_outliers(
    true_m: ArrayLike,
    measured_m: ArrayLike,
    *,
    detector_size_m: tuple[float, float] | None = None,
    target_m: float = 10e-6,
) -> tuple[CalibrationReport, tuple[int, ...]]:
    """As `calibrate`, without the points that the others contradict: the report, and the rows that were left out.

    First those whose error is many times the usual one, and readings that others of their point contradict; then one
    after the other the worst point as long as it is `OUTLIER_SIGMA` from where the rest puts it. Never more than
    `MOST_LEFT_OUT` of the rows: beyond, what is left is reported, or refused, as it is.
    """
    true, measured = np.array(true_m, dtype=np.float64), np.array(measured_m, dtype=np.float64)
    left_out: list[int] = []
    if true.ndim == 2 and true.shape == measured.shape and true.shape[1:] == (2,) and len(true) > LEAST_POINTS:
        far = np.hypot(*(measured - np.nanmedian(measured - true, axis=0) - true).T)
        gross = np.flatnonzero(far > GROSS * np.nanmedian(far))
        if len(gross) <= MOST_LEFT_OUT * len(true):
            left_out.extend(gross.tolist())
            measured[gross] = np.nan
        odd = odd_readings(true, measured)
        if len(left_out) + len(odd) <= MOST_LEFT_OUT * len(true):
            left_out.extend(odd.tolist())
            measured[odd] = np.nan
    while True:
        report = calibrate(true, measured, detector_size_m=detector_size_m, target_m=target_m)
        apart = np.where(np.isfinite(measured).all(axis=1), np.hypot(*(true - report.outlier_m).T), np.inf)
        worst = np.flatnonzero(apart <= apart.min() + SAME_M)  # all readings of that point
        if report.outlier_sigma <= OUTLIER_SIGMA or len(left_out) + len(worst) > MOST_LEFT_OUT * len(true):
            return report, tuple(sorted(left_out))
        left_out.extend(worst.tolist())
        measured[worst] = np.nan


def _check_errors(
    true_m: Matrix, measured_m: Matrix, error: Matrix, half_m: float, detector_size_m: tuple[float, float] | None
) -> None:
    """Refuse what no detector measures."""
    off = np.abs(measured_m).max(axis=0)
    if detector_size_m is not None and (off > 0.5 * np.array(detector_size_m)).any():
        width, height = np.array(detector_size_m) * 1e3
        raise ValueError(
            f"spots are measured up to ({off[0] * 1e3:.4g}, {off[1] * 1e3:.4g}) mm off the middle, but the detector "
            f"has {width:g} x {height:g} mm: are the units right?"
        )
    covered = np.ptp(measured_m, axis=0)
    if detector_size_m is not None and covered.prod() < LEAST_SHARE * np.prod(detector_size_m):
        width, height = np.array(detector_size_m) * 1e3
        raise ValueError(
            f"the grid is {covered[0] * 1e3:.3g} x {covered[1] * 1e3:.3g} mm wide, and the detector {width:g} x "
            f"{height:g} mm: are the units right?"
        )
    if not np.abs(error).max() > 1e-9 * half_m:
        raise ValueError("the measured positions are the known ones: a calibration needs what the detector measured")
    worst = int(np.argmax(np.hypot(*error.T)))
    far = np.hypot(*error[worst])
    if far > 2.0 * half_m or float(np.sqrt(np.mean(error**2))) > LARGEST_ERROR * half_m:
        x, y = true_m[worst] * 1e3
        raise ValueError(
            f"the spot known to be at ({x:.4g}, {y:.4g}) mm is measured {far * 1e3:.4g} mm from there, and the grid is "
            f"{2e3 * half_m:.4g} mm wide: an outlier, another unit, or axes that are exchanged or mirrored?"
        )


def _gain(u: Matrix, measured_m: Matrix, box: Box) -> tuple[float, float]:
    """Slopes of the measured coordinates along their own axes, of the best affine map."""
    slopes = np.linalg.lstsq(np.column_stack([np.ones(len(u)), u]), measured_m)[0][1:] / box.half_m[:, None]
    return float(slopes[0, 0]), float(slopes[1, 1])


def _beside_others(estimator: Estimator, error: Matrix, power: float = 1.0) -> Matrix:
    """Errors (n, 2) beside their estimates over (1 - leverage)^power: 1, from all others; 1/2, all of one size."""
    leverage = np.minimum(estimator.leverage(), 1.0 - 1e-12)
    out: Matrix = (error - estimator.terms @ estimator.coefficients(error)) / (1.0 - leverage) ** power
    return out


def _fit_orders(box: Box, u: Matrix, error: Matrix, highest: int, figures: tuple[Figures, ...]) -> list[OrderFit]:
    """Every order, with the same figures."""
    fits = []
    finest = Estimator(box, u, highest, figures, error).coefficients(error)
    for order in range(OPTICS_ORDER, highest + 1):
        estimator = Estimator(box, u, order, figures, error)
        apart = finest.copy()
        apart[: estimator.terms.shape[1]] -= estimator.coefficients(error)  # of orthonormal products: mean squares
        left, in_use = _beside_others(estimator, error), 0.5 * float(estimator.leverage().sum())
        prediction = float(np.sqrt(np.mean(left**2)))
        fits.append(
            OrderFit(
                order,
                len(exponents(order)),
                in_use,
                prediction,
                estimator.fit_noise_m,
                estimator.missed_m,
                math.sqrt(0.5 * float((apart**2).sum())),
            )
        )
    return fits


def _chosen(fits: list[OrderFit]) -> OrderFit:
    """The least error of left-out points, of the orders that agree with the highest one."""
    agree = [fit for fit in fits if fit.apart_m <= fit.left_m]
    return min(agree, key=lambda fit: fit.prediction_m)


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
