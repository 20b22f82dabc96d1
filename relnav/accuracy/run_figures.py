"""What is told of every run of a campaign, in columns, and what kinds of model are flown."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol, runtime_checkable

from relnav.arrays import Vector


class RunStatus(IntEnum):
    """What became of a run."""

    OK = 0
    """The filter has a state at the end."""
    NOT_STARTED = 1
    """It never had one."""
    LOST = 2
    """It had one, and lost it."""
    FAILED = 3
    """The run could not be flown; its reason is told."""
    AMBIGUOUS = 4
    """Of markers and vehicles: the filter has several poses left at the end, and says so."""


@dataclass(frozen=True)
class Quantity:
    """A quantity that is told by range, and its unit."""

    name: str
    unit: str

    @property
    def column(self) -> str:
        """Its name in columns."""
        return f"{self.name}_{self.unit}".replace(" ", "_").replace("/", "_")


@dataclass(frozen=True)
class Figures:
    """Which errors are told of a run.

    Attributes
    ----------
    state : tuple of str
        Components of the error at the end, with their units; NEES is of all of them.
    binned : tuple of Quantity
        Told by range.
    more : tuple of str
        Counts that this kind alone has.
    """

    state: tuple[str, ...]
    binned: tuple[Quantity, ...]
    more: tuple[str, ...] = ()


class Binned(Protocol):
    """A scenario, as far as columns depend on it."""

    @property
    def range_edges_m(self) -> tuple[float, ...]:
        """Limits of the range bins."""


class Scorer(Protocol):
    """Flies, filters and scores runs one after the other."""

    def run(self, number: int, given: Mapping[str, float] | None = None) -> tuple[RunStatus, Vector]:
        """Status and figures of a run; given: numbers that replace what is drawn once, by name."""


@runtime_checkable
class TogetherScorer(Scorer, Protocol):
    """The same, `together` of them at once as well, to the bit."""

    together: int

    def runs(
        self, numbers: Sequence[int], given: Sequence[Mapping[str, float] | None]
    ) -> list[tuple[RunStatus, Vector]]:
        """Status and figures of `together` runs."""


@dataclass(frozen=True)
class RunKind:
    """How one kind of model is flown and scored.

    Attributes
    ----------
    figures : Figures
    methods : tuple of str
        Of the filter; the first is the default.
    threads : bool
        Whether threads fly side by side; else only processes do.
    check : callable
        (model, scenario): ValueError for what cannot be flown.
    epochs : callable
        (model, scenario) -> about how long a run is, in epochs of a beacon filter.
    drawn : callable
        (model, scenario) -> what is drawn once a run, of the kinds that the scenario makes uncertain: names by cause.
    scorer : callable
        (model, scenario, method, seed) -> Scorer.
    together_at_hand : callable or None
        Whether its scorer flies runs together without compiling that first; None where it does not at all.
    note : callable or None
        (model, scenario) -> a sentence on what the filter is not told of the truth, empty where there is none.
    """

    figures: Figures
    methods: tuple[str, ...]
    threads: bool
    check: Callable[[Any, Any], None]
    epochs: Callable[[Any, Any], float]
    drawn: Callable[[Any, Any], dict[str, tuple[str, ...]]]
    scorer: Callable[[Any, Any, str, int], Scorer]
    together_at_hand: Callable[[], bool] | None = None
    note: Callable[[Any, Any], str] | None = None

    def columns(self, model: Any, scenario: Binned) -> tuple[str, ...]:
        """Names of the figures of a run, but for its number, its status and its reason."""
        names = ["started_s", "restarts", "epochs", "epochs_partial", "epochs_rejected", "epochs_predicted"]
        names += ["epochs_waiting", *self.figures.more, "nis_sum", "nis_dof", "nees_mean", "final_range_m"]
        names += ["final_nees", *(f"final_error_{name}" for name in self.figures.state)]
        names += [f"final_sigma_{name}" for name in self.figures.state]
        binned = [quantity.column for quantity in self.figures.binned]
        for k in range(len(scenario.range_edges_m) - 1):
            names += [f"bin{k}_epochs", *(f"bin{k}_rms_{name}" for name in binned)]
            names += [*(f"bin{k}_sigma_{name}" for name in binned), f"bin{k}_nees"]
        drawn = (name for names in self.drawn(model, scenario).values() for name in names)
        return (*names, *(f"drawn_{name}" for name in drawn))
