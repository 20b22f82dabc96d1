"""What a campaign flies, in which batches, and one batch of it: the same figures wherever and whenever it runs."""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from relnav.accuracy.run_figures import RunKind, RunStatus, Scorer, TogetherScorer
from relnav.accuracy.run_kinds import kind_of
from relnav.accuracy.sensitivity_design import Design
from relnav.arrays import Codes, Matrix, Vector, whole
from relnav.codegen.kernel import is_compiled
from relnav.codegen.together import RUNS

EPOCHS_OF_A_BATCH = 1_000_000
"""About a second or two of work."""
MOST_RUNS_OF_A_BATCH = 4000
WORTH_COMPILING = 5e7
"""Epochs of a campaign for which it is worth 25 s to compile what flies runs together: that saves 1 us of each, half
of it where two threads fly."""
LONGEST_TOGETHER = 20_000
"""Epochs of a run: eight of them side by side take 5.5 kB an epoch, which are 110 MB for each thread."""
SHARES = 16
"""A short campaign is cut into this many batches at least, for several workers."""


@dataclass(frozen=True)
class Plan:
    """A campaign: model, scenario, filter, seed and runs. Batches of runs belong to it, not to who computes them.

    Attributes
    ----------
    model : Model, VisionMission or Vehicle
        What is flown, and what the filter is told.
    scenario : Scenario or VehicleScenario
        What is uncertain.
    method : str
        Of the filter: of beacons fix or spots; of markers pose, of a vehicle fused.
    seed, runs : int, int
        Run k of a seed is the same in every campaign of this seed, however many there are.
    design : int
        Base runs of a design for sensitivities, by which every run's numbers are then mixed (`sensitivities`); 0: none.
    """

    model: Any
    scenario: Any
    method: str
    seed: int
    runs: int
    design: int = 0

    def __post_init__(self) -> None:
        kind = self.kind
        whole("runs", self.runs, 1)
        whole("seed", self.seed)
        if not isinstance(self.method, str) or self.method not in kind.methods:
            known = " or ".join(f'"{method}"' for method in reversed(kind.methods))
            raise ValueError(f"method must be {known}; got {self.method!r}")
        kind.check(self.model, self.scenario)

    @property
    def kind(self) -> RunKind:
        """How its model is flown and scored."""
        return kind_of(self.model)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the figures of a run, but for its number, its status and its reason."""
        return self.kind.columns(self.model, self.scenario)

    @property
    def note(self) -> str:
        """A sentence on what the filter is not told of the truth; empty where there is none."""
        note = self.kind.note
        return "" if note is None else note(self.model, self.scenario)

    @property
    def batch(self) -> int:
        """Runs of a batch, a multiple of four."""
        epochs = max(1.0, self.kind.epochs(self.model, self.scenario))
        most = min(MOST_RUNS_OF_A_BATCH, EPOCHS_OF_A_BATCH / epochs, self.runs / SHARES)
        return 4 * max(1, math.ceil(most / 4.0))

    @cached_property
    def together(self) -> bool:
        """Whether runs are flown together: to the same bits, faster, but for what it takes to compile that once."""
        at_hand, epochs = self.kind.together_at_hand, self.kind.epochs(self.model, self.scenario)
        if at_hand is None or epochs > LONGEST_TOGETHER or not is_compiled():
            return False
        return at_hand() or self.runs * epochs >= WORTH_COMPILING

    @property
    def starts(self) -> range:
        """First run of every batch."""
        return range(0, self.runs, self.batch)

    def runs_of(self, start: int) -> range:
        """Runs of the batch that starts with this one."""
        return range(start, min(self.runs, start + self.batch))


@dataclass(frozen=True)
class Batch:
    """Some runs of a campaign.

    Attributes
    ----------
    run, status : (n,)
        Number, and RunStatus.
    reasons : tuple of str
        Why a run failed; empty for the others.
    figures : (n, columns)
        In the order of `Plan.columns`; NaN where there is none.
    """

    run: Codes
    status: Codes
    reasons: tuple[str, ...]
    figures: Matrix


Numbered = tuple[int, Mapping[str, float] | None]
"""A run: its number, and what replaces what is drawn once, by name."""


def prepare(plan: Plan) -> None:
    """Compile what flies it, once for all threads or processes: it is kept."""
    fly_batch(plan, range(RUNS if plan.together else 1))


def _flown(scorer: Scorer, some: list[Numbered]) -> Iterator[tuple[RunStatus, Vector | float, str]]:
    """Status, figures and reason of failure of some runs: together where there are as many as the scorer takes."""
    if isinstance(scorer, TogetherScorer) and len(some) == scorer.together:
        with suppress(Exception):  # it is told of the run that raises it
            yield from [(status, figures, "") for status, figures in scorer.runs(*zip(*some, strict=True))]
            return
    for number, given in some:
        try:
            yield *scorer.run(number, given), ""
        except Exception as error:
            yield RunStatus.FAILED, math.nan, f"{type(error).__name__}: {error}"


def fly_batch(plan: Plan, runs: range, *, together: bool | None = None) -> Batch:
    """Fly, filter and score runs. What goes wrong in a run is told of that run, and the others are flown.

    together: whether several are flown at once, to the same bits; as the plan says, if left out.
    """
    scorer = plan.kind.scorer(plan.model, plan.scenario, plan.method, plan.seed)
    design = Design(plan.kind.drawn(plan.model, plan.scenario), plan.seed, plan.design) if plan.design else None
    status, reasons = np.empty(len(runs), dtype=np.int64), []
    figures = np.full((len(runs), len(plan.columns)), math.nan)
    numbers: list[Numbered] = [(run, None) if design is None else design.of(run) for run in runs]
    size = 1
    if isinstance(scorer, TogetherScorer) and (plan.together if together is None else together):
        size = scorer.together
    for begin in range(0, len(runs), size):
        some = numbers[begin : begin + size]
        for k, done in enumerate(_flown(scorer, some), begin):
            status[k], figures[k], reason = done
            reasons.append(reason)
    return Batch(np.arange(runs.start, runs.stop), status, tuple(reasons), figures)
