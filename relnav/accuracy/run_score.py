"""One run of a scenario through the filter, in figures: errors against truth, reported sigmas, NEES, by range bin."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np

from relnav.accuracy.run_figures import Figures, Quantity, RunKind, RunStatus
from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.codegen.kernel import is_at_hand, kernel, long_entry, long_kernel
from relnav.codegen.together import RUNS, anywhere, attempt, lanes_of, new_lanes, select
from relnav.dynamics.error_state import factor_size
from relnav.mission import Model, VisionMission
from relnav.navigation.docking_view import VIEW_ROWS, view_epoch
from relnav.navigation.log import Epochs, LogFilter
from relnav.navigation.logs_together import LogsTogether, is_together_at_hand
from relnav.navigation.memory import METHODS
from relnav.navigation.record import DIAGONAL
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING, EpochStatus
from relnav.simulation.dispersed import Flight, Flights, check_flyable, fly_run, fly_runs
from relnav.simulation.dispersions import Scenario
from relnav.simulation.run_draws import built_names

STATE = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
BINNED = (Quantity("range", "m"), Quantity("azimuth", "deg"), Quantity("elevation", "deg"))
DOCKING = tuple(quantity.column for quantity in BINNED)
DEGREES = 1.0, 180.0 / math.pi, 180.0 / math.pi
STARTED_AT, NIS_SUM, NIS_DOF, NEES_SUM, NEES_EPOCHS, TOTALS = range(6)
"""What is added up over a run: the epoch of the start, -1 for none; squared innovations of what was used, and their
degrees of freedom; NEES of settled epochs, and how many they are."""
SIGMA_SAMPLES = 250
"""Epochs of a run, evenly spread, whose reported sigma is looked at; a run of fewer has all of them looked at."""


@kernel
def _angle(across: float, along: float) -> float:
    """Angle of (along, across): its series where it is small, which is seven times faster than the arctangent."""
    small, t = abs(across) < 0.01 * along, across / along
    s = t * t
    angle = t * (1.0 - s * (1.0 / 3.0 - s * (1.0 / 5.0 - s / 7.0)))
    if anywhere(not small):
        angle = select(small, angle, math.atan2(across, along))
    return angle


@kernel
def _nees(error: Vector, factor: Vector) -> float:
    """Normalised error squared of error (6,), which is used up, by packed factors (21,) of P = L D L^T."""
    total, at = 0.0, 0
    for i in range(6):
        for j in range(i):
            error[i] -= factor[at + j] * error[j]
        at += i
        total += error[i] * error[i] / factor[at]
        at += 1
    return total


@kernel
def _place(state: Vector, dock: Matrix, offset: Vector, p: Vector) -> None:
    """Write the camera's place (3,) in the docking frame, and its distances from the pole and from O, into p (5,)."""
    for i in range(3):
        p[i] = 0.0
        for j in range(3):
            p[i] += dock[i, j] * (state[j] + offset[j])
    level = p[0] * p[0] + p[1] * p[1]
    p[3], p[4] = math.sqrt(level), math.sqrt(level + p[2] * p[2])


@long_kernel
def _score(
    state: Matrix, factor: Matrix, truth: Matrix, dock: Matrix, offset: Vector, nees: Vector, told: Matrix, work: Matrix
) -> None:
    """Write NEES (n,) of every epoch, its true range and its squared docking errors (n, 4); NaN without a state.

    offset: camera minus port, from the chaser's centre of mass; work (3, 6): scratch.
    """
    true, own, error = work[0], work[1], work[2]
    for e in range(state.shape[0]):
        for i in range(6):
            error[i] = state[e, i] - truth[e, i]
        nees[e] = _nees(error, factor[e])
        _place(truth[e], dock, offset, true)
        _place(state[e], dock, offset, own)
        far = own[4] - true[4]
        aside = _angle(true[0] * own[1] - true[1] * own[0], true[0] * own[0] + true[1] * own[1])
        above = _angle(true[2] * own[3] - true[3] * own[2], true[3] * own[3] + true[2] * own[2])
        told[e, 0], told[e, 1], told[e, 2], told[e, 3] = true[4], far * far, aside * aside, above * above


@long_entry
def _score_together(
    state: Stack, factor: Stack, truth: Stack, dock: Matrix, offset: Vector, nees: Matrix, told: Stack, work: Stack
) -> bool:
    """`_score` of RUNS runs; whether all went the same way."""
    divided, _ = attempt(
        _score,
        lanes_of(state),
        lanes_of(factor),
        lanes_of(truth),
        dock,
        offset,
        lanes_of(nees),
        lanes_of(told),
        lanes_of(work),
    )
    return divided == 0


@kernel
def _bin_of(range_m: float, edges: Vector) -> int:
    """In which range bin a range is, -1 for none."""
    b: int = edges.shape[0] - 2
    if not range_m < edges[b + 1]:
        return -1
    while b >= 0 and range_m < edges[b]:
        b -= 1
    return b


@long_kernel
def _add_up(
    begin: int,
    edges: Vector,
    codes: Codes,
    nis: Matrix,
    nees: Matrix,
    told: Stack,
    bins: Stack,
    first: Codes,
    counts: Codes,
    totals: Matrix,
) -> None:
    """Add up the epochs of runs that stand side by side in arrays (n, ..., runs).

    bins (runs, bins, 4): number of epochs from `begin` on and their squared errors; first (runs, bins): the first of
    them, -1 for none; counts (runs, statuses): epochs of each EpochStatus; totals (runs, TOTALS).
    """
    for e in range(told.shape[0]):
        for run in range(told.shape[2]):
            status, dof, squared, total = codes[e, 1, run], codes[e, 0, run], nis[e, run], totals[run]
            counts[run, status] += 1
            if status == STARTED and total[STARTED_AT] < 0.0:
                total[STARTED_AT] = e
            if status in (UPDATED, STARTED) and dof > 0 and abs(squared) < math.inf:
                total[NIS_SUM] += squared
                total[NIS_DOF] += dof
            if e < begin or not abs(nees[e, run]) < math.inf:  # no state, or not settled
                continue
            total[NEES_SUM] += nees[e, run]
            total[NEES_EPOCHS] += 1.0
            b = _bin_of(told[e, 0, run], edges)
            if b >= 0:
                bins[run, b, 0] += 1.0
                for k in range(1, 4):
                    bins[run, b, k] += told[e, k, run]
                if first[run, b] < 0:
                    first[run, b] = e


@long_kernel
def _look_at(
    begin: int,
    every: int,
    edges: Vector,
    state: Stack,
    factor: Stack,
    told: Stack,
    dock: Matrix,
    port: Vector,
    lever: Vector,
    variances: Stack,
    view: Matrix,
    own: Vector,
    packed: Vector,
) -> None:
    """Add up what the filter reports every so many epochs, and write what it reports at the last one into view.

    variances (runs, bins, 4): how often it was looked at, and sums of the variances of range, azimuth and elevation;
    view (runs, VIEW_ROWS); own (6,) and packed (21,) are scratch.
    """
    n = state.shape[0]
    for place in range(begin, n + every, every):
        e = min(place, n - 1)
        for run in range(state.shape[2]):
            for i in range(6):
                own[i] = state[e, i, run]
            for i in range(packed.shape[0]):
                packed[i] = factor[e, i, run]
            seen, summed = view[run], variances[run]
            view_epoch(own, packed, dock, port, lever, seen)
            b = _bin_of(told[e, 0, run], edges)
            if place < n and b >= 0 and abs(seen[3]) < math.inf:
                summed[b, 0] += 1.0
                summed[b, 1] += seen[3]
                summed[b, 2] += seen[6]
                summed[b, 3] += seen[8]


def drawn_by_cause(scenario: Scenario, points: int) -> dict[str, tuple[str, ...]]:
    """What is drawn once a run, of the kinds that the scenario makes uncertain; each number is a cause of its own."""
    spread, thrust, names = scenario.spread, scenario.thrust, []
    for k, axis in enumerate("xyz"):
        names += [f"start_{axis}"] * (spread.start_sigma_m[k] > 0.0)
        names += [f"velocity_{axis}"] * (spread.velocity_sigma_m_s[k] > 0.0)
        names += [f"thrust_turn_{axis}"] * (thrust.direction_sigma_rad > 0.0)
    names += ["thrust_scale"] * (thrust.scale_sigma > 0.0) + ["speed"] * (spread.speed_relative_sigma > 0.0)
    names += ["final_range"] * (spread.final_range_sigma_m > 0.0)
    if scenario.as_built.any:
        names += built_names(points)
    return {name: (name,) for name in names}


def _drawn(model: Model, scenario: Scenario) -> dict[str, tuple[str, ...]]:
    return drawn_by_cause(scenario, len(model.sensor.beacons_dock_m))


def epochs_of(model: Model | VisionMission, scenario: Scenario) -> float:  # noqa: ARG001  (as of the others)
    """Images of a run."""
    return scenario.approach.duration_s * scenario.approach.rate_hz


class RunScorer:
    """Flies, filters and scores runs one after the other, in memory that is used again; one a thread.

    method : {"fix", "spots"}
        Of the filter.
    """

    together = RUNS

    def __init__(self, model: Model, scenario: Scenario, method: str, seed: int) -> None:
        self.model, self.scenario, self.method, self.seed = model, scenario, method, seed
        self._filter = LogFilter(model, method)
        self._fresh = self._filter.block.copy()
        self._names = BEACONS.columns(model, scenario)
        self._epochs: Epochs | None = None
        self._logs: LogsTogether | None = None
        self._dock, self._lever = model.dcm_dock_from_lvlh, model.dcm_cam_from_lvlh.T @ model.camera_lever_cam_m
        self._offset = self._lever - model.port_position_m

    def run(self, number: int, given: Mapping[str, float] | None = None) -> tuple[RunStatus, Vector]:
        """Status and figures of a run, in the order of the columns; given: replaces what is drawn once, by name."""
        flight = fly_run(self.model, self.scenario, self.seed, number, given)
        epochs = self._filtered_alone(flight)
        n = len(flight.log.t_s)
        nees, told, truth = np.empty(n), np.empty((n, 4)), flight.log.truth
        _score(epochs.state, epochs.factor, truth, self._dock, self._offset, nees, told, np.empty((3, 6)))
        of_one = Epochs(*(getattr(epochs, one.name)[..., None] for one in fields(epochs)))
        restarts = [self._filter.restarts]
        return self._scored(
            flight.log.t_s, [flight.drawn], truth[-1:].T, of_one, nees[:, None], told[..., None], restarts
        )[0]

    def runs(
        self, numbers: Sequence[int], given: Sequence[Mapping[str, float] | None]
    ) -> list[tuple[RunStatus, Vector]]:
        """The same of RUNS runs."""
        flights = fly_runs(self.model, self.scenario, self.seed, numbers, given)
        return self.scored(flights, self.filtered(flights))

    def filtered(self, flights: Flights) -> LogsTogether:
        """RUNS flights through the filter."""
        if self._logs is None:
            self._logs = LogsTogether(self.model, self.method, len(flights.t_s), innovations=False)
        self._logs.take(flights.t_s, flights.spots_m, flights.acceleration_m_s2, flights.sigma_m)
        self._logs.run()
        return self._logs

    def scored(self, flights: Flights, logs: LogsTogether) -> list[tuple[RunStatus, Vector]]:
        """Status and figures of RUNS flights that were filtered."""
        truth, epochs = flights.truth, logs.epochs
        n = len(truth)
        nees, told = new_lanes(n, make=np.empty), new_lanes(n, 4, make=np.empty)
        frame = self._dock, self._offset
        if not _score_together(epochs.state, epochs.factor, truth, *frame, nees, told, new_lanes(3, 6)):
            raise ArithmeticError("figures of runs were decided by their numbers")
        return self._scored(flights.t_s, flights.drawn, truth[-1], epochs, nees, told, logs.restarts)

    def _filtered_alone(self, flight: Flight) -> Epochs:
        log, n = flight.log, len(flight.log.t_s)
        if self._epochs is None or len(self._epochs.nis) != n:
            self._epochs = self._filter.room(n, smooth=False)
        control = np.zeros((n, 6))
        control[:, :3] = log.acceleration_m_s2
        self._filter.block[:] = self._fresh
        self._filter.forward(log.t_s, log.spots_m, control, np.empty((0, 4)), self._epochs, log.sigma_m)
        return self._epochs

    def _scored(
        self,
        t: Vector,
        drawn: Sequence[dict[str, float]],
        end: Matrix,
        epochs: Epochs,
        nees: Matrix,
        told: Stack,
        restarts: Sequence[int],
    ) -> list[tuple[RunStatus, Vector]]:
        """Status and figures of runs that stand side by side in epochs, nees (n, runs) and told (n, 4, runs).

        drawn: of each; end (6, runs): their last true states.
        """
        edges, count = np.array(self.scenario.range_edges_m), len(drawn)
        n, size = len(t), len(edges) - 1
        settled = int(np.searchsorted(t, self.scenario.results.settling_s))
        bins, variances = np.zeros((2, count, size, 4))
        first, counts = np.full((count, size), -1, dtype=np.int64), np.zeros((count, len(EpochStatus)), dtype=np.int64)
        totals, views = np.zeros((count, TOTALS)), np.empty((count, VIEW_ROWS))
        totals[:, STARTED_AT] = -1.0
        _add_up(settled, edges, epochs.codes, epochs.nis, nees, told, bins, first, counts, totals)
        frame = self._dock, self.model.port_position_m, self._lever
        every, scratch = max(1, n // SIGMA_SAMPLES), (np.empty(6), np.empty(factor_size(6)))
        _look_at(settled, every, edges, epochs.state, epochs.factor, told, *frame, variances, views, *scratch)
        figures = {f"drawn_{name}": np.array([numbers[name] for numbers in drawn]) for name in drawn[0]}
        figures |= self._outcome(t, counts, totals) | self._by_bin(bins, variances)
        at_first = np.where(first >= 0, nees[first, np.arange(count)[:, None]], math.nan)
        figures |= {f"bin{k}_nees": at_first[:, k] for k in range(size)}
        figures["restarts"], figures["final_range_m"] = np.array(restarts, dtype=np.float64), told[-1, 0]
        figures["final_nees"] = nees[-1] if settled < n else np.full(count, math.nan)
        errors, sigmas = epochs.state[-1] - end, np.sqrt(views[:, 9:][:, DIAGONAL])
        for k, name in enumerate(STATE):
            figures[f"final_error_{name}"], figures[f"final_sigma_{name}"] = errors[k], sigmas[:, k]
        values = np.stack([figures[name] for name in self._names], axis=1)
        lost, waits = np.isnan(figures["started_s"]), epochs.codes[-1, 1] == WAITING
        outcomes = np.select([lost, waits], [RunStatus.NOT_STARTED, RunStatus.LOST], RunStatus.OK)
        return [(RunStatus(int(outcome)), row) for outcome, row in zip(outcomes, values, strict=True)]

    @staticmethod
    def _by_bin(bins: Stack, variances: Stack) -> dict[str, Vector]:
        """Root mean squares by bin, (runs,): of the errors, and of sigma where the filter was looked at."""
        there = bins[..., :1] > 0.0
        with np.errstate(invalid="ignore"):  # of what was never seen there is no mean
            rms, sigma = (np.sqrt(sums[..., 1:] / sums[..., :1]) * DEGREES for sums in (bins, variances))
        sigma = np.where(there, sigma, math.nan)
        figures = {}
        for k in range(bins.shape[1]):
            figures[f"bin{k}_epochs"] = bins[:, k, 0]
            for j, name in enumerate(DOCKING):
                figures[f"bin{k}_rms_{name}"], figures[f"bin{k}_sigma_{name}"] = rms[:, k, j], sigma[:, k, j]
        return figures

    @staticmethod
    def _outcome(t: Vector, counts: Codes, totals: Matrix) -> dict[str, Vector]:
        started, looked = totals[:, STARTED_AT].astype(int), totals[:, NEES_EPOCHS]
        with np.errstate(invalid="ignore"):
            nees = totals[:, NEES_SUM] / looked
        return {
            "started_s": np.where(started >= 0, t[started], math.nan),
            "epochs": np.full(len(counts), float(len(t))),
            "epochs_partial": counts[:, PARTIAL],
            "epochs_rejected": counts[:, REJECTED],
            "epochs_predicted": counts[:, PREDICTED],
            "epochs_waiting": counts[:, WAITING],
            "nis_sum": totals[:, NIS_SUM],
            "nis_dof": totals[:, NIS_DOF],
            "nees_mean": nees,
        }


BEACONS = RunKind(
    figures=Figures(STATE, BINNED),
    methods=("fix", *(method for method in METHODS if method != "fix")),
    threads=True,
    check=check_flyable,
    epochs=epochs_of,
    drawn=_drawn,
    scorer=RunScorer,
    together_at_hand=lambda: is_together_at_hand() and is_at_hand(_score_together),
)
