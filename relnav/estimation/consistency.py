"""Is the covariance honest: mean NIS and NEES as values that carry their own chi-square bounds.

Bar-Shalom, Li, Kirubarajan (2001), section 5.4: for an honest filter the sum of squared normalised errors is
chi-square with as many degrees of freedom as were summed.
"""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Vector, number
from relnav.estimation.whiteness import NeighbourSums

SMALLER = "errors smaller than stated, no fault"
SMALLER_OR_COLOURED = "errors smaller than stated, or alike from image to image"
COLOURED = "errors are alike from image to image (correlation {:.2f}), which the covariance does not include"
LASTING = "lasting errors are included, the same in every epoch"
ONE_RUN = "one run does not tell how much runs differ"


@dataclass(frozen=True)
class Consistency:
    """A mean squared normalised error per degree of freedom, and the interval in which it should lie.

    Attributes
    ----------
    quantity : str
        "NIS" or "NEES".
    ratio : float
        Sum over its degrees of freedom; 1 if the covariance is correct, more if it is too small.
    lower, upper : float
        Interval that contains `ratio` with `probability` if the covariance is correct and the terms are independent;
        NaN where there is none, and no verdict by it: `consistent` is then False, `overconfident` as `correlated`.
    dof : int
        Degrees of freedom summed.
    probability : float
        Of the interval.
    withheld : str
        Why there is no interval; empty if there is one.
    correlation : float
        Of each innovation, the share that was in the one of the image before, -1 to 1; NaN where it is not told.
    correlated : bool
        Whether that is more than chance, and than the covariance includes (`relnav.estimation.whiteness`). The
        covariance is then too small, and so is `ratio`, as the estimate follows such errors.
    """

    quantity: str
    ratio: float
    lower: float
    upper: float
    dof: int
    probability: float
    withheld: str = ""
    correlation: float = math.nan
    correlated: bool = False

    @property
    def consistent(self) -> bool:
        """Whether the ratio lies in its interval, and innovations are not correlated."""
        return self.lower <= self.ratio <= self.upper and not self.correlated

    @property
    def overconfident(self) -> bool:
        """Whether the ratio exceeds the interval, or innovations are correlated: the covariance is too small.

        Below the interval errors are smaller than the model states.
        """
        return self.ratio > self.upper or self.correlated

    def __str__(self) -> str:
        """One sentence: figure, interval, verdict."""
        if self.dof == 0:
            return f"{self.quantity}: no data"
        coloured = COLOURED.format(self.correlation)
        if self.withheld:
            told = f"{self.quantity} per degree of freedom {self.ratio:.3f}, no interval: {self.withheld}"
            return f"{told}; overconfident: {coloured}" if self.correlated else told
        untold = self.quantity == "NIS" and math.isnan(self.correlation)
        smaller = SMALLER_OR_COLOURED if untold else SMALLER
        verdict = "overconfident" if self.overconfident else "consistent" if self.consistent else smaller
        verdict += f": {coloured}" if self.correlated else ""
        return (
            f"{self.quantity} per degree of freedom {self.ratio:.3f}, "
            f"{100 * self.probability:g} % interval [{self.lower:.3f}, {self.upper:.3f}]: {verdict}"
        )


def chi_square_interval(dof: int, probability: float = 0.95) -> tuple[float, float]:
    """Two-sided interval of a chi-square variable divided by its dof; Wilson-Hilferty above 1e6 dof.

    Raises
    ------
    ValueError
        Unless 0 < probability < 1.
    """
    from scipy.special import chdtri, ndtri  # half a second, and not every filter's user asks

    tail = 0.5 * (1.0 - number("probability", probability))
    if not 0.0 < tail < 0.5:
        raise ValueError(f"0 < probability < 1 is expected; got {probability!r}")
    if dof > 1_000_000:
        k = 2.0 / (9.0 * dof)
        width = float(ndtri(1.0 - tail)) * k**0.5
        return (1.0 - k - width) ** 3, (1.0 - k + width) ** 3
    return float(chdtri(dof, 1.0 - tail)) / dof, float(chdtri(dof, tail)) / dof


def consistency_of_sum(
    quantity: str,
    total: float,
    dof: int,
    probability: float = 0.95,
    *,
    lasting: bool = False,
    neighbours: NeighbourSums | None = None,
) -> Consistency:
    """Consistency of a sum of squared normalised errors with so many degrees of freedom.

    lasting: whether the errors include some that are the same in every term. Then the terms are not independent: the
    mean of one run may lie anywhere, and no interval is told. neighbours: of the innovations, where it is known that
    nothing but noise makes neighbours alike.
    """
    if dof == 0:
        return Consistency(quantity, math.nan, math.nan, math.nan, 0, probability)
    lower, upper = chi_square_interval(dof, probability)
    withheld, told = "", (math.nan, False)
    if lasting:
        lower, upper, withheld = math.nan, math.nan, LASTING
    if neighbours is not None:
        told = neighbours.correlation, neighbours.overconfident(total / dof)
    return Consistency(quantity, total / dof, lower, upper, dof, probability, withheld, *told)


def nis_consistency(
    nis: Vector,
    dof: Codes,
    probability: float = 0.95,
    *,
    lasting: bool = False,
    neighbours: NeighbourSums | None = None,
) -> Consistency:
    """Consistency of normalised innovations squared, (n,) with their degrees of freedom (n,); NaN are left out.

    lasting, neighbours: as in `consistency_of_sum`.
    """
    used = np.isfinite(nis) & (np.asarray(dof) > 0)
    total = int(np.sum(np.asarray(dof)[used]))
    summed = float(np.sum(np.asarray(nis)[used]))
    return consistency_of_sum("NIS", summed, total, probability, lasting=lasting, neighbours=neighbours)


def consistency_of_runs(quantity: str, totals: Vector, dofs: Vector, probability: float = 0.95) -> Consistency:
    """Consistency of sums of squared normalised errors, one of each run (n,), whose terms need not be independent.

    Within a run a lasting error is in every term. Runs are independent: `ratio` is the mean of their r = total / dof,
    and the interval 1 +- t s / sqrt(n), with s the deviation of r over the runs and t of Student's distribution with
    n - 1 degrees of freedom. Runs without a term are left out.
    """
    from scipy.special import stdtrit  # as in `chi_square_interval`

    used = np.isfinite(totals) & (np.asarray(dofs) > 0)
    r, dof = np.asarray(totals)[used] / np.asarray(dofs)[used], round(math.fsum(np.asarray(dofs)[used]))
    if not r.size:
        return Consistency(quantity, math.nan, math.nan, math.nan, 0, probability)
    mean = math.fsum(r) / r.size
    if r.size == 1:
        return Consistency(quantity, mean, math.nan, math.nan, dof, probability, ONE_RUN)
    deviation = math.sqrt(math.fsum((r - mean) ** 2) / (r.size - 1))
    half = float(stdtrit(r.size - 1, 0.5 * (1.0 + probability))) * deviation / math.sqrt(r.size)
    return Consistency(quantity, mean, 1.0 - half, 1.0 + half, dof, probability)


def nees(errors: Matrix, covariances: Matrix) -> Vector:
    """Normalised estimation error squared e^T P^-1 e, (n,), of errors (n, m) and covariances (n, m, m)."""
    e = np.asarray(errors, dtype=np.float64)
    solved = np.linalg.solve(np.asarray(covariances, dtype=np.float64), e[..., None])[..., 0]
    out: Vector = np.einsum("...i,...i->...", e, solved)
    return out


def nees_consistency(values: Vector, state_size: int, probability: float = 0.95) -> Consistency:
    """Consistency of NEES values (n,) of a state with state_size components, from independent runs."""
    finite = np.asarray(values)[np.isfinite(values)]
    return consistency_of_sum("NEES", float(np.sum(finite)), int(finite.size) * state_size, probability)
