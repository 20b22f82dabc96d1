"""A campaign's runs in a few figures: errors by range beside the published ones, and whether sigma is honest."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np

from relnav.accuracy.published import UNITS, Claim, Published
from relnav.accuracy.run_figures import Figures, Quantity, RunStatus
from relnav.arrays import Codes, Vector
from relnav.estimation.consistency import Consistency, consistency_of_runs, consistency_of_sum
from relnav.estimation.gating import chi_square_limit

Reader = Callable[[Sequence[str]], dict[str, Vector]]
"""Figures of all runs by the names of their columns, in the order of runs."""


WRONG = 1e-6
"""Probability with which a NEES of an honest filter counts as wrong: at seven epochs of 1000 runs, 0.007 runs."""
WRONG_SAID = "NEES beyond one in a million, entering a range bin or at the end"


@dataclass(frozen=True)
class BinRow:
    """One quantity in one range bin.

    Attributes
    ----------
    quantity, unit : str
        Of beacons range, azimuth or elevation; of markers and vehicles range, across, closing rate, attitude or rate.
    from_m, to_m : float
        The bin.
    runs : int
        Runs with a state in it.
    rms, worst : float
        Error against truth over all epochs in the bin; and of the worst run.
    sigma : float
        Reported 1-sigma at epochs spread over the bin, root mean square over epochs and runs.
    published : float
        The paper's figure; NaN if it has none.
    share_within : float
        Share of runs whose rms is within the published figure; NaN if there is none.
    """

    quantity: str
    unit: str
    from_m: float
    to_m: float
    runs: int
    rms: float
    worst: float
    sigma: float
    published: float
    share_within: float


@dataclass(frozen=True)
class FinalRow:
    """One component of the state at the end, over the runs: its error, and the reported 1-sigma (rms)."""

    component: str
    mean: float
    deviation: float
    three_sigma: float
    worst: float
    sigma: float


@dataclass(frozen=True)
class CampaignSummary:
    """The figures of a campaign.

    Attributes
    ----------
    runs : int
    outcomes : dict of str to int
        Runs by RunStatus.
    restarts : int
        Of all filters.
    wrong : int
        Runs, whatever their outcome, of which a NEES below lies beyond one in a million.
    nis, final_nees : Consistency
        NIS of all epochs used whole, its interval from how much runs differ (`consistency_of_runs`); NEES at the end,
        one of each run.
    nees_by_bin : tuple of Consistency
        NEES at the first epoch in a bin, one of each run: independent from run to run, as its interval takes for
        granted.
    bins : tuple of BinRow
    final : tuple of FinalRow
    note : str
        On what the filter was not told of the truth; empty where there is nothing to say.
    """

    runs: int
    outcomes: dict[str, int]
    restarts: int
    wrong: int
    nis: Consistency
    final_nees: Consistency
    edges_m: tuple[float, ...]
    nees_by_bin: tuple[Consistency, ...]
    bins: tuple[BinRow, ...]
    final: tuple[FinalRow, ...]
    note: str = ""

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What is told by range."""
        return tuple(dict.fromkeys(Quantity(row.quantity, row.unit) for row in self.bins))

    def to_dict(self) -> dict[str, Any]:
        """The figures as plain values."""
        return {
            "runs": self.runs,
            "outcomes": self.outcomes,
            "restarts": self.restarts,
            "wrong": self.wrong,
            "nis": _plain(self.nis),
            "final_nees": _plain(self.final_nees),
            "range_edges_m": list(self.edges_m),
            "nees_by_bin": [_plain(entry) for entry in self.nees_by_bin],
            "bins": [vars(row) for row in self.bins],
            "final": [vars(row) for row in self.final],
        } | ({"note": self.note} if self.note else {})

    def lines(self) -> list[str]:
        """The figures for a reader."""
        told = ", ".join(f"{name} {count}" for name, count in self.outcomes.items() if count)
        lines = [f"{self.runs} approaches: {told}; restarts {self.restarts}"]
        if self.wrong:
            lines.append(f"WRONG in {self.wrong} of {self.runs} runs: errors far beyond sigma ({WRONG_SAID})")
        if not self.bins:
            return lines
        lines.append("    range        quantity           rms   worst run    1-sigma   published   runs within")
        for row in self.bins:
            value = [f"{number:.5f}" for number in (row.rms, row.worst, row.sigma)]
            claim = "-" if math.isnan(row.published) else f"{row.published:g} {row.unit}"
            share = "-" if math.isnan(row.share_within) else f"{100.0 * row.share_within:.1f} %"
            lines.append(
                f"  {row.from_m:5.2f} .. {row.to_m:5.2f} m  {row.quantity:<12} {value[0]:>9} {value[1]:>11} "
                f"{value[2]:>10} {claim:>11} {share:>13}"
            )
        lines.append("consistency, 95 % intervals, one epoch of each run: runs are independent of one another")
        for (low, high), entry in zip(pairwise(self.edges_m), self.nees_by_bin, strict=True):
            lines.append(f"  entering {low:.2f} .. {high:.2f} m: {entry}")
        lines.append(f"  at the end: {self.final_nees}")
        lines.append(f"  all epochs used whole: {self.nis}")
        lines.append("    at the end            mean    deviation    99.73 %       worst     1-sigma")
        for last in self.final:
            numbers = (last.mean, last.deviation, last.three_sigma, last.worst, last.sigma)
            lines.append(f"  {last.component:<14}" + "".join(f"{number:12.3g}" for number in numbers))
        return [*lines, *([f"note: {self.note}"] if self.note else [])]


def summarise(
    runs: int, status: Codes, edges_m: tuple[float, ...], read: Reader, published: Published, figures: Figures
) -> CampaignSummary:
    """Sum a campaign up; the figures do not depend on how it was cut, as sums are exact until they are rounded once."""
    counted = {kind: int(np.sum(status == kind)) for kind in RunStatus}
    outcomes = {kind.name.lower(): n for kind, n in counted.items() if n or kind != RunStatus.AMBIGUOUS}
    totals = read(["restarts", "nis_sum", "nis_dof", "final_nees"])
    claims = {claim.quantity: claim for claim in published.claims if claim.unit in UNITS}
    columns = [quantity.column for quantity in figures.binned]
    bins: list[BinRow] = []
    nees: list[Consistency] = []
    worst = totals["final_nees"]
    for k, (low, high) in enumerate(pairwise(edges_m)):
        names = [f"bin{k}_{kind}_{name}" for kind in ("rms", "sigma") for name in columns]
        values = read([f"bin{k}_epochs", f"bin{k}_nees", *names])
        worst = np.fmax(worst, values[f"bin{k}_nees"])
        nees.append(_independent(values[f"bin{k}_nees"], len(figures.state)))
        for quantity, name in zip(figures.binned, columns, strict=True):
            rms, sigma = values[f"bin{k}_rms_{name}"], values[f"bin{k}_sigma_{name}"]
            bins.append(_bin_row(quantity, low, high, values[f"bin{k}_epochs"], rms, sigma, claims.get(quantity.name)))
    final = []
    for name in figures.state:
        values = read([f"final_error_{name}", f"final_sigma_{name}"])
        final.append(_final_row(name, values[f"final_error_{name}"], values[f"final_sigma_{name}"]))
    nis = consistency_of_runs("NIS", totals["nis_sum"], totals["nis_dof"])
    restarts, last = round(_sum(totals["restarts"])), _independent(totals["final_nees"], len(figures.state))
    wrong = int(np.sum(worst > chi_square_limit(1.0 - WRONG, len(figures.state))))
    return CampaignSummary(
        runs, outcomes, restarts, wrong, nis, last, tuple(edges_m), tuple(nees), tuple(bins), tuple(final)
    )


def _sum(values: Vector) -> float:
    return math.fsum(values[np.isfinite(values)])


def _root_mean_square(values: Vector) -> float:
    known = values[np.isfinite(values)]
    return math.sqrt(math.fsum(known**2) / len(known)) if len(known) else math.nan


def _independent(nees: Vector, states: int) -> Consistency:
    return consistency_of_sum("NEES", _sum(nees), states * int(np.isfinite(nees).sum()))


def _bin_row(
    quantity: Quantity, low: float, high: float, epochs: Vector, rms: Vector, sigma: Vector, claim: Claim | None
) -> BinRow:
    known = np.isfinite(rms)
    total = _sum(epochs[known])
    published = math.nan
    if claim is not None:
        published = claim.value_si / UNITS[quantity.unit]
    return BinRow(
        quantity=quantity.name,
        unit=quantity.unit,
        from_m=low,
        to_m=high,
        runs=int(known.sum()),
        rms=math.sqrt(_sum(rms[known] ** 2 * epochs[known]) / total) if total else math.nan,
        worst=float(rms[known].max()) if known.any() else math.nan,
        sigma=_root_mean_square(sigma),
        published=published,
        share_within=float(np.mean(rms[known] <= published)) if claim is not None and known.any() else math.nan,
    )


def _final_row(name: str, error: Vector, sigma: Vector) -> FinalRow:
    e = error[np.isfinite(error)]
    if len(e) == 0:
        return FinalRow(name, *(math.nan,) * 5)
    mean = math.fsum(e) / len(e)
    deviation = math.sqrt(math.fsum((e - mean) ** 2) / len(e))
    size = np.abs(e)
    return FinalRow(
        name, mean, deviation, float(np.quantile(size, 0.9973)), float(size.max()), _root_mean_square(sigma)
    )


def _plain(entry: Consistency) -> dict[str, Any]:
    return vars(entry) | {"consistent": entry.consistent}


def summary_of(plain: dict[str, Any]) -> CampaignSummary:
    """The summary that `to_dict` gave, None read as NaN.

    Raises
    ------
    KeyError, TypeError, ValueError, AttributeError, OverflowError
        For what it never gives.
    """
    return CampaignSummary(
        int(plain["runs"]),
        {str(name): int(count) for name, count in plain["outcomes"].items()},
        int(plain["restarts"]),
        int(plain["wrong"]),
        _filled(Consistency, plain["nis"]),
        _filled(Consistency, plain["final_nees"]),
        tuple(float(edge) for edge in plain["range_edges_m"]),
        tuple(_filled(Consistency, entry) for entry in plain["nees_by_bin"]),
        tuple(_filled(BinRow, entry) for entry in plain["bins"]),
        tuple(_filled(FinalRow, entry) for entry in plain["final"]),
        str(plain.get("note", "")),
    )


def _filled(kind: Any, entry: dict[str, Any]) -> Any:
    """A row whose fields are words, whole numbers and numbers."""
    values: dict[str, tuple[Any, Any]] = {field.name: (entry[field.name], field.type) for field in fields(kind)}
    turned = {name: math.nan if value is None else turn(value) for name, (value, turn) in values.items()}
    return kind(**turned)
