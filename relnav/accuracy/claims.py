"""An accuracy report for any sensor system: rows of measured figures beside the claims of its paper."""

import math
from dataclasses import dataclass
from typing import Any

from relnav.accuracy.published import UNITS, Claim, Published


@dataclass(frozen=True)
class ClaimRow:
    """One measured figure in the claim's unit, beside the claim.

    Attributes
    ----------
    quantity, method, condition : str
        What, by which way of measuring, where ("10 m, on axis").
    published, measured : float
        In `unit`; NaN published = the paper claims nothing here, the row informs.
    unit, statistic : str
        Of both figures.
    met : bool
        Whether the figure as measured is the claim or better.
    expected, reason : str
        "met" or "not met", and why.
    range_m : float or None
        Distance, where it is the condition.
    """

    quantity: str
    method: str
    condition: str
    published: float
    measured: float
    unit: str
    statistic: str
    met: bool
    expected: str
    reason: str
    range_m: float | None = None

    @property
    def as_expected(self) -> bool:
        """Whether it came out as expected."""
        return ("met" if self.met else "not met") == self.expected


@dataclass(frozen=True)
class ClaimsReport:
    """Everything that was measured of a sensor system."""

    model: str
    runs: int
    seed: int
    rows: tuple[ClaimRow, ...]
    notes: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether every row came out as expected."""
        return all(row.as_expected for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """The report as plain values."""
        return {
            "model": self.model,
            "runs": self.runs,
            "seed": self.seed,
            "rows": [vars(row) for row in self.rows],
            "notes": list(self.notes),
            "ok": self.ok,
        }


def claim_row(
    claim: Claim,
    published: Published,
    method: str,
    measured_si: float,
    *,
    condition: str = "",
    range_m: float | None = None,
    statistic: str = "",
) -> ClaimRow:
    """A measured figure (SI, smaller is better) beside its claim, with what published.toml expects of this method."""
    expected, reason = published.expected(claim, method, range_m if range_m is not None else 0.0)
    return ClaimRow(
        quantity=claim.quantity,
        method=method,
        condition=condition or claim.condition,
        published=claim.value,
        measured=measured_si / claim.unit_si,
        unit=claim.unit,
        statistic=statistic or claim.statistic,
        met=measured_si <= claim.value_si,
        expected=expected,
        reason=reason,
        range_m=range_m,
    )


def information(
    quantity: str,
    method: str,
    condition: str,
    measured_si: float,
    unit: str,
    statistic: str,
    range_m: float | None = None,
    *,
    met: bool = True,
) -> ClaimRow:
    """A row beside which the paper claims nothing; met: whether it keeps a bound of our own."""
    reason = "" if met else "our own bound: the covariance does not describe the errors"
    return ClaimRow(
        quantity, method, condition, math.nan, measured_si / UNITS[unit], unit, statistic, met, "met", reason, range_m
    )
