"""One run of a scenario through the filter, in figures: errors against truth, reported sigmas, NEES, by range bin."""

import math
from collections.abc import Mapping

import numpy as np

from relnav.accuracy.run_figures import Figures, Quantity, RunKind, RunStatus
from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel, long_kernel
from relnav.mission import Model, VisionMission
from relnav.navigation.docking_view import VIEW_ROWS, views
from relnav.navigation.log import Epochs, LogFilter
from relnav.navigation.memory import METHODS
from relnav.navigation.record import DIAGONAL
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING, EpochStatus
from relnav.simulation.dispersed import Flight, check_flyable, fly_run
from relnav.simulation.dispersions import Scenario
from relnav.simulation.run_draws import built_names

STATE = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
BINNED = (Quantity("range", "m"), Quantity("azimuth", "deg"), Quantity("elevation", "deg"))
DOCKING = tuple(quantity.column for quantity in BINNED)
DEGREES = np.array([1.0, 180.0 / math.pi, 180.0 / math.pi])
SIGMA_SAMPLES = 250
"""Epochs of a run, evenly spread, whose reported sigma is looked at; a run of fewer has all of them looked at."""


@kernel
def _angle(across: float, along: float) -> float:
    """Angle of (along, across): its series where it is small, which is seven times faster than the arctangent."""
    if abs(across) < 0.01 * along:
        t = across / along
        s = t * t
        return t * (1.0 - s * (1.0 / 3.0 - s * (1.0 / 5.0 - s / 7.0)))
    return math.atan2(across, along)


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
    state: Matrix,
    factor: Matrix,
    truth: Matrix,
    dock: Matrix,
    offset: Vector,
    edges: Vector,
    nees: Vector,
    sums: Matrix,
    first: Codes,
    work: Matrix,
) -> None:
    """Write NEES (n,) of every epoch; by bin the number of epochs and sums of squared docking errors (bins, 4).

    offset: camera minus port, from the chaser's centre of mass; first (bins,): first epoch in a bin, -1 for none;
    work (3, 6): scratch.
    """
    true, own, error = work[0], work[1], work[2]
    for e in range(state.shape[0]):
        if state[e, 0] != state[e, 0]:  # NaN: no state
            nees[e] = math.nan
            continue
        for i in range(6):
            error[i] = state[e, i] - truth[e, i]
        nees[e] = _nees(error, factor[e])
        _place(truth[e], dock, offset, true)
        b = edges.shape[0] - 2
        while b >= 0 and true[4] < edges[b]:
            b -= 1
        if b < 0 or true[4] >= edges[edges.shape[0] - 1]:
            continue
        _place(state[e], dock, offset, own)
        far = own[4] - true[4]
        aside = _angle(true[0] * own[1] - true[1] * own[0], true[0] * own[0] + true[1] * own[1])
        above = _angle(true[2] * own[3] - true[3] * own[2], true[3] * own[3] + true[2] * own[2])
        sums[b, 0] += 1.0
        sums[b, 1] += far * far
        sums[b, 2] += aside * aside
        sums[b, 3] += above * above
        if first[b] < 0:
            first[b] = e


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

    def __init__(self, model: Model, scenario: Scenario, method: str, seed: int) -> None:
        self.model, self.scenario, self.seed = model, scenario, seed
        self._filter = LogFilter(model, method)
        self._fresh = self._filter.block.copy()
        self._names = BEACONS.columns(model, scenario)
        self._epochs: Epochs | None = None
        self._dock, self._lever = model.dcm_dock_from_lvlh, model.dcm_cam_from_lvlh.T @ model.camera_lever_cam_m

    def run(self, number: int, given: Mapping[str, float] | None = None) -> tuple[RunStatus, Vector]:
        """Status and figures of a run, in the order of the columns; given: replaces what is drawn once, by name."""
        flight = fly_run(self.model, self.scenario, self.seed, number, given)
        epochs = self._filtered(flight)
        figures = self._scored(flight, epochs)
        status = epochs.codes[:, 1]
        if math.isnan(figures["started_s"]):
            outcome = RunStatus.NOT_STARTED
        else:
            outcome = RunStatus.LOST if status[-1] == WAITING else RunStatus.OK
        return outcome, np.array([figures.get(name, math.nan) for name in self._names])

    def _filtered(self, flight: Flight) -> Epochs:
        log, n = flight.log, len(flight.log.t_s)
        if self._epochs is None or len(self._epochs.nis) != n:
            self._epochs = self._filter.room(n, smooth=False)
        control = np.zeros((n, 6))
        control[:, :3] = log.acceleration_m_s2
        self._filter.block[:] = self._fresh
        self._filter.forward(log.t_s, log.spots_m, control, np.empty((0, 4)), self._epochs, log.sigma_m)
        return self._epochs

    def _scored(self, flight: Flight, epochs: Epochs) -> dict[str, float]:
        log, edges = flight.log, np.array(self.scenario.range_edges_m)
        n, bins = len(log.t_s), len(edges) - 1
        settled = int(np.searchsorted(log.t_s, self.scenario.results.settling_s))
        nees, sums, first = np.full(n, math.nan), np.zeros((bins, 4)), np.full(bins, -1, dtype=np.int64)
        offset = self._lever - self.model.port_position_m
        late = (epochs.state[settled:], epochs.factor[settled:], log.truth[settled:])
        _score(*late, self._dock, offset, edges, nees[settled:], sums, first, np.empty((3, 6)))
        figures = {f"drawn_{name}": value for name, value in flight.drawn.items()} | self._outcome(log.t_s, epochs)
        known = np.isfinite(nees)
        figures["nees_mean"] = float(nees[known].mean()) if known.any() else math.nan
        sampled = np.append(np.arange(settled, n, max(1, n // SIGMA_SAMPLES)), n - 1)
        view = self._viewed(epochs, sampled)
        ranges = np.linalg.norm(log.truth[sampled[:-1], :3] + offset, axis=1)
        self._by_bin(figures, sums, np.searchsorted(edges, ranges, "right") - 1, view[[3, 6, 8], :-1])
        for k in np.flatnonzero(first >= 0).tolist():
            figures[f"bin{k}_nees"] = float(nees[first[k] + settled])
        error = epochs.state[-1] - log.truth[-1]
        figures["final_nees"] = float(nees[-1])
        figures["final_range_m"] = float(np.linalg.norm(log.truth[-1, :3] + offset))
        sigma = np.sqrt(view[9:, -1][DIAGONAL])
        for k, name in enumerate(STATE):
            figures[f"final_error_{name}"], figures[f"final_sigma_{name}"] = float(error[k]), float(sigma[k])
        return figures

    def _viewed(self, epochs: Epochs, sampled: Codes) -> Matrix:
        """What the filter reports at some epochs, as `docking_view.views` says it; NaN where there is no state."""
        view = np.full((VIEW_ROWS, len(sampled)), math.nan)
        known = np.isfinite(epochs.state[sampled, 0])
        rows = sampled[known]
        if len(rows):
            lever = self._lever[None]
            view[:, known] = views(
                epochs.state[rows], epochs.factor[rows], self._dock, self.model.port_position_m, lever
            )
        return view

    @staticmethod
    def _by_bin(figures: dict[str, float], sums: Matrix, bins: Codes, variance: Matrix) -> None:
        """Add root mean squares by bin: of the errors, and of sigma at sampled epochs in these bins (m,)."""
        for k, total in enumerate(sums):
            figures[f"bin{k}_epochs"] = float(total[0])
            if total[0] == 0.0:
                continue
            inside = variance[:, (bins == k) & np.isfinite(variance[0])]
            sigma = np.sqrt(inside.mean(axis=1)) * DEGREES if inside.size else np.full(3, math.nan)
            rms = np.sqrt(total[1:] / total[0]) * DEGREES
            for j, name in enumerate(DOCKING):
                figures[f"bin{k}_rms_{name}"], figures[f"bin{k}_sigma_{name}"] = float(rms[j]), float(sigma[j])

    def _outcome(self, t: Vector, epochs: Epochs) -> dict[str, float]:
        status, dof = epochs.codes[:, 1], epochs.codes[:, 0]
        counts = np.bincount(status, minlength=len(EpochStatus))
        started = np.flatnonzero(status == STARTED)
        used = ((status == UPDATED) | (status == STARTED)) & (dof > 0) & np.isfinite(epochs.nis)
        return {
            "started_s": float(t[started[0]]) if started.size else math.nan,
            "restarts": float(self._filter.restarts),
            "epochs": float(len(t)),
            "epochs_partial": float(counts[PARTIAL]),
            "epochs_rejected": float(counts[REJECTED]),
            "epochs_predicted": float(counts[PREDICTED]),
            "epochs_waiting": float(counts[WAITING]),
            "nis_sum": float(epochs.nis[used].sum()),
            "nis_dof": float(dof[used].sum()),
        }


BEACONS = RunKind(
    figures=Figures(STATE, BINNED),
    methods=("fix", *(method for method in METHODS if method != "fix")),
    threads=True,
    check=check_flyable,
    epochs=epochs_of,
    drawn=_drawn,
    scorer=RunScorer,
)
