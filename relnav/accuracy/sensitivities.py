"""What of the error at the port comes from which dispersion: one at a time, and Sobol' indices."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from relnav.accuracy.campaign_summary import Reader
from relnav.accuracy.sensitivity_design import Design
from relnav.arrays import Flags, Stack, Vector, whole
from relnav.simulation.streams import Draws, Stream

CONFIDENCE, RESAMPLES = 0.95, 400
LISTED = 12
"""Causes of a component that are told to a reader, the largest first."""
LEAST = 8
"""Base runs."""


@dataclass(frozen=True)
class Share:
    """What one cause does to one component of the error at the end.

    Attributes
    ----------
    component, cause : str
    used : int
        Base runs of which this is, a power of two: of which all three flights that tell of the cause have a state at
        the end.
    first, first_low, first_high : float
        First-order Sobol' index: the share of the variance that goes if this cause alone were known, with its 95 %
        interval from resampling (it may lie a little outside 0 to 1).
    total, total_low, total_high : float
        Total index: the share that stays if everything but this cause were known.
    """

    component: str
    cause: str
    used: int
    first: float
    first_low: float
    first_high: float
    total: float
    total_low: float
    total_high: float


@dataclass(frozen=True)
class Shift:
    """One number moved alone: half the difference of a component between plus and minus one sigma.

    Attributes
    ----------
    component, number : str
    shift, spread : float
        Mean over runs of different noise, in the component's unit, and their standard deviation.
    """

    component: str
    number: str
    shift: float
    spread: float


@dataclass(frozen=True)
class Sensitivities:
    """Where the error at the port comes from.

    Attributes
    ----------
    base, used : int
        Base runs asked for; and used for the cause of which the fewest are, of those that have indices.
    deviation : dict of str to float
        Standard deviation of each component over pairs of base runs that both have a state at the end, in its unit.
    shares : tuple of Share
    shifts : tuple of Shift
    """

    base: int
    used: int
    deviation: dict[str, float]
    shares: tuple[Share, ...]
    shifts: tuple[Shift, ...]

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "base": self.base,
            "used": self.used,
            "deviation": self.deviation,
            "shares": [vars(share) for share in self.shares],
            "shifts": [vars(shift) for shift in self.shifts],
        }

    def of(self, component: str) -> list[Share]:
        """Causes of a component, the largest total first."""
        return sorted((one for one in self.shares if one.component == component), key=lambda one: -one.total)

    @property
    def runs_used(self) -> str:
        """How many base runs the indices are of, in words."""
        most = max((share.used for share in self.shares), default=self.used)
        used = f"{self.used} to {most}" if most > self.used else str(self.used)
        return f"{used} of {self.base} base runs used"

    def lines(self) -> list[str]:
        """For a reader: the position's components."""
        lines = [f"{self.runs_used}; 95 % intervals from resampling"]
        if self.used < self.base:
            lines.append("  a base run is used for a cause if the three flights that tell of it end with a state:")
            lines.append("  neither ambiguous, lost nor failed. So the indices are those of flights that end well")
        if not self.shares:
            lines.append(
                f"  no indices from fewer than {LEAST}: what one sigma moves is in sensitivities.json; let the flights "
                "end where the filter is sure (longer, nearer, or another pattern)"
            )
            return lines
        for component in list(self.deviation)[:3]:
            lines.append(f"{component} at the end, deviation {self.deviation[component]:.3g}")
            lines.append("  cause                     first order             total             one sigma moves it by")
            for one in self.of(component)[:LISTED]:
                lines.append(
                    f"  {one.cause:<22}{one.first:6.2f} [{one.first_low:5.2f}, {one.first_high:5.2f}]"
                    f"{one.total:7.2f} [{one.total_low:5.2f}, {one.total_high:5.2f}]   {self._moved(one)}"
                )
        return lines

    def _moved(self, share: Share) -> str:
        """The largest shift of the cause's numbers."""
        own = [
            shift
            for shift in self.shifts
            if shift.component == share.component
            and math.isfinite(shift.shift)  # else no flight with it ended with a state
            and (shift.number == share.cause or shift.number.startswith(f"{share.cause}_"))
        ]
        if not own:
            return "-"
        largest = max(own, key=lambda shift: abs(shift.shift))
        named = "" if largest.number == share.cause else f" ({largest.number[len(share.cause) + 1 :]})"
        return f"{largest.shift:+.2e}{named}"


def base_runs(value: Any) -> int:
    """Number of base runs, which is a power of two of 8 or more.

    Raises
    ------
    ValueError
        If it is not.
    """
    count = whole("runs", value, LEAST)
    if count & (count - 1):
        raise ValueError(f"base runs of sensitivities are a power of two, as their estimates ask for; got {count}")
    return count


def sum_up(design: Design, components: tuple[str, ...], read: Reader, seed: int) -> Sensitivities:
    """The sensitivities of a study that was flown; read: columns by name, in the order of runs."""
    names = [f"final_error_{name}" for name in components]
    values = read(names)
    errors = np.stack([values[name] for name in names])
    mixed = errors[:, : design.mixed].reshape(len(components), 2 + len(design.causes), design.base)
    ends: Flags = np.isfinite(mixed.sum(axis=0))
    pairs = ends[0] & ends[1]
    deviation = dict.fromkeys(components, math.nan)
    if pairs.any():
        deviation = dict(zip(components, np.std(mixed[:, :2, pairs], axis=(1, 2)).tolist(), strict=True))
    alike: dict[tuple[int, ...], list[int]] = {}  # causes told of by the same base runs
    for j in range(len(design.causes)):
        good = np.flatnonzero(pairs & ends[2 + j])
        if len(good) >= LEAST:
            alike.setdefault(tuple(good[: 2 ** int(math.log2(len(good)))].tolist()), []).append(j)
    shares: list[Share] = []
    for chosen, causes in alike.items():
        of = mixed[:, [0, 1, *(2 + j for j in causes)]][:, :, list(chosen)]
        shares += _shares(of, components, tuple(design.causes[j] for j in causes), seed)
    used = min((len(chosen) for chosen in alike), default=0)
    alone = errors[:, design.mixed :].reshape(len(components), len(design.numbers), 2, design.repeats)
    return Sensitivities(design.base, used, deviation, tuple(shares), tuple(_shifts(alone, components, design.numbers)))


def _shares(mixed: Any, components: tuple[str, ...], causes: tuple[str, ...], seed: int) -> list[Share]:
    """Sobol' indices of errors (components, 2 + causes, n), A and B first, by scipy; intervals from resampled runs."""
    from scipy.stats import sobol_indices

    n, rng = mixed.shape[2], Draws(seed, 0).generator(Stream.DESIGN)

    def indices(of: Any) -> Stack:
        by_cause = np.concatenate([of[:, 2:], of[:, 2:3]], axis=1)  # scipy cannot do one cause alone: the first twice
        flown: Any = {"f_A": of[:, 0], "f_B": of[:, 1], "f_AB": by_cause.transpose(1, 0, 2)}
        found = sobol_indices(func=flown, n=n)
        both = (np.reshape(part, (len(components), -1)) for part in (found.first_order, found.total_order))
        return np.stack([part[:, :-1] for part in both])

    told = indices(mixed)
    around = np.stack([indices(mixed[:, :, rng.integers(n, size=n)]) for _ in range(RESAMPLES)])
    low, high = np.quantile(around, [0.5 * (1.0 - CONFIDENCE), 0.5 * (1.0 + CONFIDENCE)], axis=0)
    return [
        Share(name, cause, n, *(float(part[of, k, j]) for of in (0, 1) for part in (told, low, high)))
        for k, name in enumerate(components)
        for j, cause in enumerate(causes)
    ]


def _shifts(alone: Any, components: tuple[str, ...], numbers: tuple[str, ...]) -> list[Shift]:
    """From errors (components, numbers, 2, repeats) with one number at plus and at minus one sigma."""
    half = 0.5 * (alone[:, :, 0] - alone[:, :, 1])
    return [
        Shift(name, number, *_mean_and_deviation(half[k, j]))
        for k, name in enumerate(components)
        for j, number in enumerate(numbers)
    ]


def _mean_and_deviation(values: Vector) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    if not len(known):
        return math.nan, math.nan
    return float(known.mean()), float(known.std(ddof=1)) if len(known) > 1 else math.nan
