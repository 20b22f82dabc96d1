"""What a campaign flies, in which batches, and one batch of it: the same figures wherever and whenever it runs."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from relnav.accuracy.run_figures import RunKind, RunStatus
from relnav.accuracy.run_kinds import kind_of
from relnav.accuracy.sensitivity_design import Design
from relnav.arrays import Codes, Matrix, whole

EPOCHS_OF_A_BATCH = 1_000_000
"""About a second or two of work."""
MOST_RUNS_OF_A_BATCH = 4000
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
    def batch(self) -> int:
        """Runs of a batch, a multiple of four."""
        epochs = max(1.0, self.kind.epochs(self.model, self.scenario))
        most = min(MOST_RUNS_OF_A_BATCH, EPOCHS_OF_A_BATCH / epochs, self.runs / SHARES)
        return 4 * max(1, math.ceil(most / 4.0))

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


def fly_batch(plan: Plan, runs: range) -> Batch:
    """Fly, filter and score runs. What goes wrong in a run is told of that run, and the others are flown."""
    scorer = plan.kind.scorer(plan.model, plan.scenario, plan.method, plan.seed)
    design = Design(plan.kind.drawn(plan.model, plan.scenario), plan.seed, plan.design) if plan.design else None
    status, reasons = np.empty(len(runs), dtype=np.int64), []
    figures = np.full((len(runs), len(plan.columns)), math.nan)
    for k, run in enumerate(runs):
        try:
            status[k], figures[k] = scorer.run(run) if design is None else scorer.run(*design.of(run))
            reasons.append("")
        except Exception as error:
            status[k] = RunStatus.FAILED
            reasons.append(f"{type(error).__name__}: {error}")
    return Batch(np.arange(runs.start, runs.stop), status, tuple(reasons), figures)
