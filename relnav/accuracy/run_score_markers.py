"""One run of a scenario before the markers' camera through the pose filter, in figures."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from relnav.accuracy.run_figures import Figures, RunKind, RunStatus
from relnav.accuracy.run_score import drawn_by_cause, epochs_of
from relnav.accuracy.run_score_port import OF_TWELVE, TWELVE, looked_at, score_port
from relnav.arrays import Codes, Matrix, Vector
from relnav.geometry.rotation_vector import attitude_error
from relnav.mission import VisionMission
from relnav.navigation.docking_port import DockingState, docking_states
from relnav.navigation.pose_log import MarkerLogFilter
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, EpochStatus
from relnav.simulation.dispersed_markers import (
    OF_TARGET,
    check_flyable,
    fly_marker_run,
    inertia_names,
    sigmas_of_target,
)
from relnav.simulation.dispersions import Scenario
from relnav.simulation.marker_flight import MarkerFlight

DECIDED = 18.4
"""Ambiguity from which on one pose alone is believed: odds of 1e8."""


class MarkerScorer:
    """Flies, filters and scores runs one after the other."""

    def __init__(self, mission: VisionMission, scenario: Scenario, method: str, seed: int) -> None:  # noqa: ARG002  (as of the others)
        self._mission, self._scenario, self._seed = mission, scenario, seed
        self._names = MARKERS.columns(mission, scenario)
        self._edges = np.array(scenario.range_edges_m)

    def run(self, number: int, given: Mapping[str, float] | None = None) -> tuple[RunStatus, Vector]:
        """Status and figures of a run, in the order of the columns; given: replaces what is drawn once, by name."""
        flight, drawn = fly_marker_run(self._mission, self._scenario, self._seed, number, given)
        control = np.zeros((len(flight.t_s), 6))
        control[:, :3] = flight.acceleration_m_s2
        log = MarkerLogFilter(self._mission)
        epochs = log.forward(flight.t_s, flight.spots_px, control, np.empty((0, 4)))
        figures = {f"drawn_{name}": value for name, value in drawn.items()} | _outcome(epochs)
        at = looked_at(len(epochs))
        error, covariance, range_m = self._errors(flight, epochs, at)
        settled = flight.t_s[at] >= self._scenario.results.settling_s
        figures |= score_port(error, covariance, range_m, settled, self._edges)
        if math.isnan(figures["started_s"]):
            status = RunStatus.NOT_STARTED
        elif epochs["hypotheses"][-1] == 0:
            status = RunStatus.LOST
        else:
            status = RunStatus.OK if np.isfinite(error[-1]).all() else RunStatus.AMBIGUOUS
        return status, np.array([figures.get(name, math.nan) for name in self._names])

    def _errors(self, flight: MarkerFlight, epochs: Any, at: Codes) -> tuple[Matrix, Any, Vector]:
        """Errors at the port, NaN where there is no state or no single pose; their covariance; true port distance."""
        here = PoseSolution(self._mission, epochs[at])
        truth = self._true_port(flight, at)
        decided = (here.hypotheses > 0) & (here.ambiguity >= DECIDED)
        error, covariance = np.full((len(at), 12), math.nan), np.full((len(at), 12, 12), math.nan)
        if decided.any():
            told = PoseSolution(self._mission, epochs[at[decided]]).docking
            covariance[decided] = told.covariance
            error[decided, :3] = truth.position_m[decided] - told.position_m
            error[decided, 3:6] = truth.velocity_m_s[decided] - told.velocity_m_s
            error[decided, 9:] = truth.rate_rad_s[decided] - told.rate_rad_s
            pairs = zip(told.dcm_target_from_chaser, truth.dcm_target_from_chaser[decided], strict=True)
            error[decided, 6:9] = [attitude_error(own, true) for own, true in pairs]
        return error, covariance, np.linalg.norm(truth.position_m, axis=1)

    def _true_port(self, flight: MarkerFlight, at: Codes) -> DockingState:
        """The true docking state of some epochs."""
        chaser = np.ascontiguousarray(flight.true_dcm_chaser_from_lvlh[at])
        attitude, rate = flight.dcm_lvlh_from_target[at], flight.rate_rad_s[at]
        nothing = np.zeros((len(at), 12, 12))
        return docking_states(flight.motion[at], attitude, rate, nothing, self._mission, chaser, flight.t_s[at])


def _outcome(epochs: Any) -> dict[str, float]:
    """What became of the epochs."""
    status, dof, nis, running = epochs["status"], epochs["dof"], epochs["nis"], epochs["hypotheses"] > 0
    counts = np.bincount(status, minlength=len(EpochStatus))
    used = ((status == UPDATED) | (status == STARTED)) & (dof > 0) & np.isfinite(nis)
    return {
        "started_s": float(epochs["t"][running][0]) if running.any() else math.nan,
        "restarts": float(max(0, counts[STARTED] - 1)),
        "epochs": float(len(epochs)),
        "epochs_partial": float(counts[PARTIAL]),
        "epochs_rejected": float(counts[REJECTED]),
        "epochs_predicted": float(counts[PREDICTED]),
        "epochs_waiting": float(np.sum(~running)),
        "epochs_ambiguous": float(np.sum(running & (epochs["ambiguity"] < DECIDED))),
        "nis_sum": float(nis[used].sum()),
        "nis_dof": float(dof[used].sum()),
    }


def _drawn(mission: VisionMission, scenario: Scenario) -> dict[str, tuple[str, ...]]:
    attitude, rate = sigmas_of_target(mission, scenario)
    sizes = (attitude, rate, mission.chaser.attitude_sigma_rad)
    own = {name: (name,) for k, name in enumerate(OF_TARGET) if sizes[k // 3] > 0.0}
    own |= {name: (name,) for name in inertia_names(mission)}
    return drawn_by_cause(scenario, len(mission.markers.points_m)) | own


MARKERS = RunKind(
    figures=Figures(TWELVE, tuple(OF_TWELVE), ("epochs_ambiguous",)),
    methods=("pose",),
    threads=False,
    check=check_flyable,
    epochs=lambda mission, scenario: 12.0 * epochs_of(mission, scenario),
    drawn=_drawn,
    scorer=MarkerScorer,
)
