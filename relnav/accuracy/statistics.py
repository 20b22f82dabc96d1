"""Errors against truth as statistics that a reviewer can check: bias, spread, tails, and whether sigma was right."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Vector
from relnav.estimation.consistency import chi_square_interval


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of one quantity's errors, in its own unit.

    Attributes
    ----------
    bias, sigma, rms : float
        Mean, standard deviation about it, and root mean square.
    three_sigma : float
        99.73 % of the absolute errors lie below it.
    coverage_1, coverage_3 : float
        Share of errors within one and three reported sigma (0.6827 and 0.9973 if sigma is right).
    count : int
        Errors used.
    """

    bias: float
    sigma: float
    rms: float
    three_sigma: float
    coverage_1: float
    coverage_3: float
    count: int


def error_statistics(error: Vector, reported_sigma: Vector) -> ErrorStatistics:
    """Statistics of errors (n,) with their reported sigmas (n,); NaN are left out."""
    used = np.isfinite(error) & np.isfinite(reported_sigma)
    e, s = np.abs(error[used]), reported_sigma[used]
    if e.size == 0:
        nan = float("nan")
        return ErrorStatistics(nan, nan, nan, nan, nan, nan, 0)
    return ErrorStatistics(
        bias=float(np.mean(error[used])),
        sigma=float(np.std(error[used])),
        rms=float(np.sqrt(np.mean(e**2))),
        three_sigma=float(np.quantile(e, 0.9973)),
        coverage_1=float(np.mean(e <= s)),
        coverage_3=float(np.mean(e <= 3.0 * s)),
        count=int(e.size),
    )


def wilson_bounds(count: int, total: int) -> tuple[float, float]:
    """95 % bounds of a share of which `count` of `total` were seen (Wilson 1927)."""
    z2 = 3.841458820694124  # 1.96^2, of the normal distribution
    share, whole = count / total, 1.0 + z2 / total
    middle = (share + z2 / (2.0 * total)) / whole
    half = math.sqrt(z2 * (share * (1.0 - share) / total + z2 / (4.0 * total * total))) / whole
    return max(0.0, middle - half), min(1.0, middle + half)


@dataclass(frozen=True)
class NeesBand:
    """Mean NEES over runs, epoch by epoch, against its chi-square bands.

    Attributes
    ----------
    mean : float
        Over runs and epochs; the state's size for an honest covariance.
    inside_95, outside_9999 : float
        Share of epochs whose mean over runs lies inside its 95 % band, and outside its 99.99 % band.
    above_9999 : float
        Share of epochs above the 99.99 % band: overconfident.
    epochs, runs, dof : int
        Epochs looked at, runs in each mean, size of the state.
    """

    mean: float
    inside_95: float
    outside_9999: float
    above_9999: float
    epochs: int
    runs: int
    dof: int


def nees_band(values: Vector, dof: int) -> NeesBand:
    """Bands of NEES (runs, epochs); an epoch counts where at least half of the runs have a state."""
    finite = np.isfinite(values)
    runs = finite.sum(axis=0)
    used = runs >= max(1, values.shape[0] // 2)
    total = np.where(finite, values, 0.0).sum(axis=0)[used]
    runs = runs[used]
    mean = total / runs
    bounds = {
        int(n): (*chi_square_interval(dof * int(n), 0.95), *chi_square_interval(dof * int(n), 0.9999))
        for n in set(runs)
    }
    low95, high95, low, high = (dof * np.array([bounds[int(n)] for n in runs])).T
    return NeesBand(
        mean=float(total.sum() / runs.sum()),
        inside_95=float(np.mean((mean >= low95) & (mean <= high95))),
        outside_9999=float(np.mean((mean < low) | (mean > high))),
        above_9999=float(np.mean(mean > high)),
        epochs=int(used.sum()),
        runs=int(values.shape[0]),
        dof=dof,
    )
