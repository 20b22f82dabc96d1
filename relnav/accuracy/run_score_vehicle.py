"""One approach of a vehicle through the filter of all its sensors, in figures."""

import math
from collections.abc import Mapping

import numpy as np

from relnav.accuracy.rendezvous import true_ports
from relnav.accuracy.run_figures import Figures, RunKind, RunStatus
from relnav.accuracy.run_score_port import OF_TWELVE, SAMPLES, TWELVE, score_port
from relnav.arrays import Vector
from relnav.geometry.rotation_vector import attitude_error
from relnav.simulation.dispersed_vehicle import (
    as_believed,
    check_vehicle_scenario,
    control_note,
    drawn_once,
    fly_vehicle_run,
)
from relnav.simulation.vehicle_dispersions import VehicleScenario
from relnav.simulation.vehicle_numbers import number_names
from relnav.simulation.vehicle_sensors import VehicleRun
from relnav.spacecraft import Vehicle
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.filters import VehicleFilters
from relnav.vehicle.forward import estimates_at
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.replay import Event
from relnav.vehicle.update import Outcome

EPOCHS_A_METRE = 6000.0
"""Of a beacon filter, that take as long as a metre of approach."""


class _Counts:
    """What became of the observations of a run."""

    def __init__(self) -> None:
        self.used, self.partial, self.rejected, self.nis, self.dof = 0, 0, 0, 0.0, 0

    def add(self, event: Event, outcome: Outcome) -> None:  # noqa: ARG002  (as of the others)
        """Count an observation in."""
        if outcome.groups == 0:
            return
        self.rejected += outcome.used == 0
        self.partial += 0 < outcome.used < outcome.groups
        if outcome.used == outcome.groups:
            self.used, self.nis, self.dof = self.used + 1, self.nis + outcome.nis, self.dof + outcome.dof


class VehicleScorer:
    """Flies, filters and scores runs one after the other."""

    def __init__(self, vehicle: Vehicle, scenario: VehicleScenario, method: str, seed: int) -> None:  # noqa: ARG002  (as of the others)
        self._vehicle, self._scenario, self._seed = vehicle, scenario, seed
        self._believed, self._watched = as_believed(vehicle, scenario), scenario.is_watched
        self._names, self._edges = VEHICLES.columns(vehicle, scenario), np.array(scenario.range_edges_m)

    def run(self, number: int, given: Mapping[str, float] | None = None) -> tuple[RunStatus, Vector]:
        """Status and figures of a run, in the order of the columns; given: replaces what is drawn once, by name."""
        flown, drawn = fly_vehicle_run(self._vehicle, self._scenario, self._seed, number, given)
        end = flown.truth.end_s
        times = np.linspace(end / SAMPLES, end - 0.05, SAMPLES)
        counts = _Counts()
        found = self._in_time(flown, times, counts) if flown.in_time else self._as_it_comes(flown, times, counts)
        truth, dcm = true_ports(flown.truth, times)
        error = truth - np.array([_port(estimate) for estimate in found])
        error[:, 6:9] = [
            attitude_error(estimate.port.dcm_target_from_chaser, true)
            for estimate, true in zip(found, dcm, strict=True)
        ]
        covariance = np.array([estimate.port.covariance for estimate in found])
        known = ~np.array([estimate.ambiguous for estimate in found])
        range_m, settled = np.linalg.norm(truth[:, :3], axis=1), known & (times >= self._scenario.results.settling_s)
        figures = score_port(error, covariance, range_m, settled, self._edges)
        figures |= {f"drawn_{name}": value for name, value in drawn.items()}
        figures |= {
            "started_s": 0.0 if known[0] else float(times[np.argmax(known)]) if known.any() else math.nan,
            "restarts": float(found[-1].restarts),
            "epochs": float(counts.used + counts.partial + counts.rejected),
            "epochs_partial": float(counts.partial),
            "epochs_rejected": float(counts.rejected),
            "epochs_predicted": 0.0,
            "epochs_waiting": 0.0,
            "alarms": float(len(found[-1].alarms)) if self._watched else math.nan,
            "nis_sum": counts.nis,
            "nis_dof": float(counts.dof),
        }
        status = RunStatus.OK if np.isfinite(error[-1]).all() else RunStatus.LOST
        if not known[-1]:
            status = RunStatus.AMBIGUOUS
        return status, np.array([figures.get(name, math.nan) for name in self._names])

    def _in_time(self, flown: VehicleRun, times: Vector, counts: _Counts) -> list[VehicleEstimate]:
        filters = VehicleFilters(self._believed, 0.0, monitor=self._watched)
        filters.on_outcome = counts.add
        events = (filters.event(seen.sensor, seen.t_s, seen.value, None) for seen in flown.others)
        return list(estimates_at(filters, flown.samples, events, times.tolist()))

    def _as_it_comes(self, flown: VehicleRun, times: Vector, counts: _Counts) -> list[VehicleEstimate]:
        nav, found = VehicleNavigator(self._believed, monitor=self._watched), list[VehicleEstimate]()
        nav.on_outcome = counts.add
        left = iter([*times.tolist(), math.inf])
        due = next(left)
        for seen in flown.observations:
            while seen.t_s >= due:
                found.append(nav.state(due))
                due = next(left)
            nav.observe(seen.sensor, seen.t_s, seen.value)
        while due < math.inf:
            found.append(nav.state(due))
            due = next(left)
        return found


def _port(estimate: VehicleEstimate) -> Vector:
    port = estimate.port
    return np.concatenate([port.position_m, port.velocity_m_s, np.zeros(3), port.rate_rad_s])


def _drawn(vehicle: Vehicle, scenario: VehicleScenario) -> dict[str, tuple[str, ...]]:
    return {name: number_names(name, count) for name, count in drawn_once(vehicle, scenario).items()}


def _epochs(vehicle: Vehicle, scenario: VehicleScenario) -> float:  # noqa: ARG001  (as of the others)
    approach = scenario.approach
    return EPOCHS_A_METRE * (approach.start_m - approach.final_m)


VEHICLES = RunKind(
    figures=Figures(TWELVE, tuple(OF_TWELVE), ("alarms",)),
    methods=("fused",),
    threads=False,
    check=check_vehicle_scenario,
    epochs=_epochs,
    drawn=_drawn,
    scorer=VehicleScorer,
    note=control_note,
)
