"""Is the covariance honest: mean NIS and NEES as values that carry their own chi-square bounds.

Bar-Shalom, Li, Kirubarajan (2001), section 5.4: for an honest filter the sum of squared normalised errors is
chi-square with as many degrees of freedom as were summed.
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Vector, number

SMALLER = "errors smaller than stated, no fault"


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
        Interval that contains `ratio` with `probability` if the covariance is correct and the terms are independent.
    dof : int
        Degrees of freedom summed.
    probability : float
        Of the interval.
    """

    quantity: str
    ratio: float
    lower: float
    upper: float
    dof: int
    probability: float

    @property
    def consistent(self) -> bool:
        """Whether the ratio lies in its interval."""
        return self.lower <= self.ratio <= self.upper

    @property
    def overconfident(self) -> bool:
        """Whether the ratio exceeds the interval, a fault; below it errors are smaller than the model states."""
        return self.ratio > self.upper

    def __str__(self) -> str:
        """One sentence: figure, interval, verdict."""
        if self.dof == 0:
            return f"{self.quantity}: no data"
        verdict = "overconfident" if self.overconfident else "consistent" if self.consistent else SMALLER
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


def consistency_of_sum(quantity: str, total: float, dof: int, probability: float = 0.95) -> Consistency:
    """Consistency of a sum of squared normalised errors with so many degrees of freedom."""
    if dof == 0:
        return Consistency(quantity, float("nan"), float("nan"), float("nan"), 0, probability)
    lower, upper = chi_square_interval(dof, probability)
    return Consistency(quantity, total / dof, lower, upper, dof, probability)


def nis_consistency(nis: Vector, dof: Codes, probability: float = 0.95) -> Consistency:
    """Consistency of normalised innovations squared, (n,) with their degrees of freedom (n,); NaN are left out."""
    used = np.isfinite(nis) & (np.asarray(dof) > 0)
    total = int(np.sum(np.asarray(dof)[used]))
    return consistency_of_sum("NIS", float(np.sum(np.asarray(nis)[used])), total, probability)


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
