"""A paper's claims as values, and a solution's covariance set against them."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:  # a model is read without what filters are made of
    from relnav.navigation.record import Solution

QUANTITIES = ("range", "azimuth", "elevation")

UNITS = {
    "m": 1.0,
    "rad": 1.0,
    "deg": math.pi / 180.0,
    "arcsec": math.pi / 648000.0,
    "px": 1.0,
    "s": 1.0,
    "m/s": 1.0,
    "deg/s": math.pi / 180.0,
    "probability": 1.0,
    "ratio": 1.0,
}
"""Units of published figures, and what one of each is in SI."""


@dataclass(frozen=True)
class Claim:
    """One published figure, complete: a claim without its condition or page does not load.

    Attributes
    ----------
    quantity, value, unit : str, float, str
        What is claimed, in the paper's unit (one of `UNITS`).
    statistic, condition, page : str
        What kind of figure it is (1-sigma, max, unstated), where it holds, where it stands.
    expected : {"met", "not met"}
        What we find; a claim that we refute says "not met", with its reason.
    reason : str
        Why.
    """

    quantity: str
    value: float
    unit: Literal["m", "rad", "deg", "arcsec", "px", "s", "probability", "ratio"]
    statistic: str
    condition: str
    page: str
    expected: Literal["met", "not met"]
    reason: str

    @property
    def unit_si(self) -> float:
        """What one of the claim's unit is in SI."""
        return UNITS[self.unit]

    @property
    def value_si(self) -> float:
        """The figure in SI units (m, rad)."""
        return self.value * self.unit_si


@dataclass(frozen=True)
class ClaimException:
    """Where a way of measuring is not expected to meet the claims, although another does.

    Attributes
    ----------
    method : str
        Name of the way, or its beginning: "single shot" is all single shots.
    beyond_range_m : float
        It holds for ranges above this.
    quantity : str
        One quantity, or "all".
    reason : str
        Why.
    """

    method: str
    beyond_range_m: float
    quantity: str
    reason: str


@dataclass(frozen=True)
class Published:
    """Everything that a paper claims, with our findings.

    Attributes
    ----------
    claims : tuple of Claim
        Its figures.
    exceptions : tuple of ClaimException
        Ways of measuring that are not expected to meet them.
    """

    claims: tuple[Claim, ...]
    exceptions: tuple[ClaimException, ...]

    def expected(self, claim: Claim, method: str, range_m: float) -> tuple[str, str]:
        """Whether a method should meet a claim at a range ("met", "not met"), and why."""
        for entry in self.exceptions:
            applies = method.startswith(entry.method) and range_m > entry.beyond_range_m
            if applies and entry.quantity in ("all", claim.quantity):
                return "not met", entry.reason
        return claim.expected, claim.reason


@dataclass(frozen=True)
class Comparison:
    """Reported 1-sigma of one quantity at the end of a solution, beside its claim.

    Attributes
    ----------
    claim : Claim
        The published figure.
    sigma : float
        Reported 1-sigma at the last epoch with a state, in the claim's unit.
    met_from_s : float
        Time from which sigma stays within the published figure; NaN if it does not.
    """

    claim: Claim
    sigma: float
    met_from_s: float

    @property
    def ratio(self) -> float:
        """Reported sigma over published figure; below 1 the figure is met."""
        return self.sigma / self.claim.value


class PublishedTrend:
    """The comparison with the published figures, taken part after part of a solution."""

    def __init__(self, published: Published) -> None:
        self._claims = [claim for claim in published.claims if claim.quantity in QUANTITIES]
        self._sigma = [math.nan] * len(self._claims)
        self._met_from = [math.nan] * len(self._claims)

    def take(self, part: "Solution") -> None:
        """Go on with the next epochs."""
        sigma = part.docking_sigma
        known = np.isfinite(sigma).all(axis=1)
        if not known.any():
            return
        times = part.t_s[known]
        for k, claim in enumerate(self._claims):
            column = sigma[known, QUANTITIES.index(claim.quantity)]
            self._sigma[k] = float(column[-1])
            outside = np.flatnonzero(column > claim.value_si)
            if outside.size:
                first = int(outside[-1]) + 1
                self._met_from[k] = float(times[first]) if first < len(times) else math.nan
            elif math.isnan(self._met_from[k]):
                self._met_from[k] = float(times[0])

    def comparisons(self) -> tuple[Comparison, ...]:
        """One for each claim, as of the last epoch taken."""
        figures = zip(self._claims, self._sigma, self._met_from, strict=True)
        return tuple(Comparison(claim, sigma / claim.unit_si, met_from) for claim, sigma, met_from in figures)


def compare_with_published(solution: "Solution", published: Published) -> tuple[Comparison, ...]:
    """Set the solution's reported 1-sigma of range, azimuth and elevation against the published figures."""
    trend = PublishedTrend(published)
    trend.take(solution)
    return trend.comparisons()
