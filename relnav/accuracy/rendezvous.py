"""What a vehicle's filter delivers at the docking port, against truth: errors, honesty by block, what each sensor buys.

Every run draws anew lasting errors (mountings, levers, lights, lenses, thrusters), the start, the orbit and all noise.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import nan
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.accuracy.claims import ClaimRow, ClaimsReport, claim_row, information
from relnav.accuracy.published import Published
from relnav.arrays import Matrix, Stack, Vector
from relnav.estimation.consistency import chi_square_interval, nees
from relnav.geometry.rotation_vector import attitude_error, rotation_vector_between
from relnav.simulation.rendezvous import Rendezvous, Truth
from relnav.simulation.vehicle_sensors import VehicleRun, simulate_rendezvous
from relnav.spacecraft import GYRO, Vehicle
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.filters import VehicleFilters
from relnav.vehicle.forward import estimates_at
from relnav.vehicle.layout import CHASER_ATTITUDE, layout_of
from relnav.vehicle.replay import Event
from relnav.vehicle.update import Outcome

RANGES_M = (25.0, 10.0, 6.5, 5.0, 3.0, 1.0)
SHORT = Rendezvous(start_m=12.0, slow_m_s=0.06)
"""For what a sensor buys: the last twelve metres, faster."""
GROUPS = {
    "port": "port",
    "motion": "position velocity",
    "target": "target_attitude target_rate",
    "chaser attitude": "chaser_attitude",
    "gyro bias": "gyro_bias",
    "thrusters": "thrust.scale thrust.direction",
}
"""Blocks whose honesty is told; alignments are added by sensor."""
APPROACH = "all sensors, from 30 m"
"""What a row of the whole approach is called."""
HONEST = 0.9999
"""Probability of the interval in which an honest NEES lies."""


@dataclass(frozen=True)
class Checkpoint:
    """Errors at one port distance, truth less estimate.

    Attributes
    ----------
    port_error, port_covariance : (12,), (12, 12)
        Position m, velocity m/s, attitude rad, rate rad/s, target axes.
    error, covariance : (n,), (n, n)
        Of the filter's state, by its layout.
    """

    port_error: Vector
    port_covariance: Matrix
    error: Vector
    covariance: Matrix


@dataclass
class Told:
    """What each sensor told, nats: of position, target attitude and chaser attitude."""

    by_sensor: dict[str, Vector] = field(default_factory=dict)

    def add(self, event: Event, outcome: Outcome) -> None:
        """Count an observation in."""
        self.by_sensor[event.source] = self.by_sensor.get(event.source, np.zeros(3)) + np.array(outcome.gains)


def true_ports(truth: Truth, t_s: Vector) -> tuple[Matrix, Stack]:
    """Truth at the port at times (k,): (position, velocity, zeros, rate) (k, 12), target axes; (k, 3, 3), attitudes.

    These are dcm_target_from_chaser. Velocity and the chaser's rate are differences over 20 ms.
    """
    h = 0.01
    t = (t_s[:, None] + np.array([-h, 0.0, h])).ravel()
    to_frame, to_target = (
        turn.transpose(0, 2, 1) for turn in (truth.dcm_chaser_from_frame(t), truth.dcm_frame_from_target(t))
    )
    own, other = np.array(truth.vehicle.chaser.port_position_m), np.array(truth.vehicle.target.port_position_m)
    apart = truth.motion(t)[:, :3] + to_frame @ own
    place = ((to_target @ apart[..., None])[..., 0] - other).reshape(-1, 3, 3)
    body, dcm = truth.dcm_chaser_from_inertial(t), to_target[1::3] @ to_frame[1::3]
    turning = Rotation.from_matrix(body[::3] @ body[2::3].transpose(0, 2, 1)).as_rotvec() / (2.0 * h)
    rate = truth.target_rate(t_s) - (dcm @ turning[..., None])[..., 0]
    velocity = (place[:, 2] - place[:, 0]) / (2.0 * h)
    return np.concatenate([place[:, 1], velocity, np.zeros_like(rate), rate], axis=1), dcm


def true_port(run: VehicleRun, t_s: float) -> tuple[Vector, Matrix]:
    """`true_ports` at one time."""
    values, dcm = true_ports(run.truth, np.array([t_s]))
    return values[0], dcm[0]


def checkpoint(run: VehicleRun, estimate: VehicleEstimate) -> Checkpoint:
    """An estimate against truth."""
    truth, t = run.truth, np.array([estimate.t_s])
    error = -estimate.values
    place = estimate.layout.by_name
    motion = truth.motion(t)[0]
    error[place["position"]] += motion[:3]
    error[place["velocity"]] += motion[3:]
    error[place["target_rate"]] += truth.target_rate(t)[0]
    error[place["gyro_bias"]] += run.bias_at(estimate.t_s)
    error[place["slow_acceleration"]] += truth.slow_acceleration_at(estimate.t_s)
    for name, value in run.lasting.items():
        if name in place:  # a gyro that is off has blocks only where that is stated
            error[place[name]] += value
    target, chaser = truth.dcm_frame_from_target(t)[0], truth.dcm_chaser_from_inertial(t)[0]
    error[place["target_attitude"]] = rotation_vector_between(target, estimate.dcm_lvlh_from_target)
    error[place["chaser_attitude"]] = rotation_vector_between(chaser.T, estimate.dcm_inertial_from_chaser)
    port, (true, dcm) = estimate.port, true_port(run, estimate.t_s)
    own = np.concatenate([port.position_m, port.velocity_m_s, np.zeros(3), port.rate_rad_s])
    port_error = true - own
    port_error[6:9] = attitude_error(port.dcm_target_from_chaser, dcm)
    return Checkpoint(port_error, port.covariance, error, estimate.covariance)


def fly(
    run: VehicleRun,
    ranges_m: Sequence[float] = RANGES_M,
    without: Sequence[str] = (),
    told: Told | None = None,
    *,
    believed: Vehicle | None = None,
) -> list[Checkpoint]:
    """A run through the filter, looked at where the planned port distance passes each range, without some sensors.

    believed: the vehicle as the filter takes it; as the run has it if left out.
    """
    filters = VehicleFilters(run.truth.vehicle if believed is None else believed, 0.0, monitor=False)
    filters.on_outcome = None if told is None else told.add
    samples = run.samples[: 0 if GYRO in without else None]
    seen = (one for one in run.others if one.sensor not in without)
    events = (filters.event(one.sensor, one.t_s, one.value, None) for one in seen)
    times = run.truth.times_of(ranges_m).tolist()
    return [checkpoint(run, estimate) for estimate in estimates_at(filters, samples, events, times)]


def honesty(points: Sequence[Checkpoint], places: dict[str, slice], names: str) -> tuple[float, int]:
    """Mean NEES over its degrees of freedom, and these; of some blocks, or of the port's twelve ("port").

    One point a run: lasting errors are drawn once a run, so that only runs are independent.
    """
    if names == "port":
        errors = np.stack([point.port_error for point in points])
        covariances = np.stack([point.port_covariance for point in points])
    else:
        index = np.concatenate([np.arange(places[name].start, places[name].stop) for name in names.split()])
        errors = np.stack([point.error[index] for point in points])
        covariances = np.stack([point.covariance[np.ix_(index, index)] for point in points])
    return float(np.mean(nees(errors, covariances))) / errors.shape[1], errors.size


def port_figures(points: Sequence[Checkpoint]) -> tuple[Vector, Vector]:
    """Rms error and rms reported 1-sigma of the port's twelve over runs, (12,) each."""
    errors = np.stack([point.port_error for point in points])
    variances = np.stack([np.diagonal(point.port_covariance) for point in points])
    return np.sqrt(np.mean(errors**2, axis=0)), np.sqrt(np.mean(variances, axis=0))


def groups_of(vehicle: Vehicle) -> dict[str, str]:
    """`GROUPS`, and the alignment of each sensor."""
    names = list(layout_of(vehicle).by_name)
    return GROUPS | {f"{s} alignment": " ".join(n for n in names if n.startswith(f"{s}.")) for s in vehicle.sensor}


PARTS = (
    ("port along", slice(0, 1), "m"),
    ("port across", slice(1, 3), "m"),
    ("closing rate", slice(3, 4), "m/s"),
    ("attitude", slice(6, 9), "deg"),
    ("rate", slice(9, 12), "deg/s"),
)
"""Quantities at the port: name, which of the twelve, unit."""


def _error_rows(points: Sequence[Checkpoint], method: str, range_m: float) -> list[ClaimRow]:
    error, sigma = port_figures(points)
    rows = []
    for name, part, unit in PARTS:
        for statistic, values in (("rms error an axis", error), ("rms reported 1-sigma", sigma)):
            value = float(np.sqrt(np.mean(values[part] ** 2)))
            rows.append(information(name, method, f"at {range_m:g} m", value, unit, statistic, range_m))
    own = np.stack([point.error[CHASER_ATTITUDE] for point in points])
    said = np.stack([np.diagonal(point.covariance)[CHASER_ATTITUDE] for point in points])
    for statistic, squares in (("rms error an axis", own**2), ("rms reported 1-sigma", said)):
        value = float(np.sqrt(np.mean(squares)))
        rows.append(information("chaser attitude", method, f"at {range_m:g} m", value, "deg", statistic, range_m))
    return rows


def _honesty_rows(
    points: Sequence[Checkpoint], vehicle: Vehicle, method: str, range_m: float, *, two_sided: bool
) -> list[ClaimRow]:
    rows, places = [], layout_of(vehicle).by_name
    for name, blocks in groups_of(vehicle).items():
        ratio, dof = honesty(points, places, blocks)
        lower, upper = chi_square_interval(dof, HONEST)
        met = ratio <= upper and (ratio >= lower or not two_sided)
        text = f"NEES/n, {'in [' + format(lower, '.2f') + ', ' if two_sided else 'up to '}{upper:.2f}" + "]" * two_sided
        rows.append(information(name, method, f"at {range_m:g} m", ratio, "ratio", text, range_m, met=met))
    return rows


@dataclass(frozen=True)
class VehicleReport(ClaimsReport):
    """What was measured of a vehicle.

    Attributes
    ----------
    shares : dict
        By sensor, what it told of all that was learnt of position, target attitude and chaser attitude, (3,).
    left : dict
        By block of errors that last a run, the share of its 1-sigma that is left at the end; NaN if it is considered.
    """

    shares: dict[str, Vector] = field(default_factory=dict)
    left: dict[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The report as plain values."""
        left = {name: None if share != share else share for name, share in self.left.items()}
        shares = {name: share.tolist() for name, share in self.shares.items()}
        return super().to_dict() | {"shares_told": shares, "sigma_left": left}


def _shares(told: Told) -> dict[str, Vector]:
    total = sum(told.by_sensor.values(), np.zeros(3))
    return {name: gains / total for name, gains in told.by_sensor.items()}


def _left(points: Sequence[Checkpoint], vehicle: Vehicle) -> dict[str, float]:
    variance = np.mean([np.diagonal(point.covariance) for point in points], axis=0)
    return {
        block.name: nan if block.role == "considered" else float(np.sqrt(np.mean(variance[block.place]))) / block.sigma
        for block in layout_of(vehicle).blocks
        if "." in block.name and block.sigma > 0.0
    }


def _lines(shares: dict[str, Vector], left: dict[str, float]) -> tuple[str, ...]:
    told = [
        f"{name}: {100.0 * place:.0f} % of the information about position, {100.0 * target:.0f} % about the target's "
        f"attitude, {100.0 * chaser:.0f} % about the chaser's"
        for name, (place, target, chaser) in shares.items()
    ]
    learnt = [
        f"{name}: {'considered' if share != share else f'{100.0 * share:.0f} % of its stated 1-sigma remains'}"
        for name, share in left.items()
    ]
    return (*told, *learnt)


def measure(
    vehicle: Vehicle,
    published: Published,
    *,
    runs: int = 6,
    seed: int = 7,
    progress: Callable[[int], None] | None = None,
    flight: Rendezvous | None = None,
    short: Rendezvous = SHORT,
) -> VehicleReport:
    """Fly a vehicle many times: errors and honesty by distance, beside the papers, and without each sensor in turn.

    Parameters
    ----------
    vehicle, published
        Vehicle, and what its sensors' papers claim.
    runs : int
        Approaches, each with everything drawn anew; the comparison without each sensor flies half as many.
    seed : int
        Of everything random.
    progress : callable, optional
        Called with 1 three times a run.
    flight, short : Rendezvous
        The approach, `Rendezvous()` if left out, and what is flown as believed and without each sensor.
    """
    told, done = Told(), progress or (lambda _count: None)
    by_range: list[list[Checkpoint]] = [[] for _ in RANGES_M]
    believed: list[Checkpoint] = []
    without_one: dict[str, list[Checkpoint]] = {}
    end = (short.final_m,)
    lacks = {"all sensors": (), **{f"without {name}": (name,) for name in ("gyro", *vehicle.sensor)}}
    for k in range(runs):
        for points, point in zip(
            by_range, fly(simulate_rendezvous(vehicle, flight, seed=seed + k), told=told), strict=True
        ):
            points.append(point)
        done(1)
        as_believed = replace(short, as_believed=True)
        believed += fly(simulate_rendezvous(vehicle, as_believed, seed=seed + runs + k), end)
        done(1)
        if k < (runs + 1) // 2:
            run = simulate_rendezvous(vehicle, short, seed=seed + 2 * runs + k)
            for name, without in lacks.items():
                without_one.setdefault(name, []).extend(fly(run, end, without))
        done(1)
    rows = []
    for range_m, points in zip(RANGES_M, by_range, strict=True):
        error, _ = port_figures(points)
        for claim in published.claims:
            if range_m == 6.5 and claim.quantity == "range":
                rows.append(
                    claim_row(claim, published, "fused", float(error[0]), range_m=range_m, statistic="rms error")
                )
        rows += _error_rows(points, APPROACH, range_m)
    for range_m, points in zip(RANGES_M, by_range, strict=True):
        rows += _honesty_rows(points, vehicle, "consistency, truth of its own", range_m, two_sided=False)
    rows += _honesty_rows(believed, vehicle, "consistency, truth as stated", short.final_m, two_sided=True)
    for name, points in without_one.items():
        rows += _error_rows(points, f"{name}, from {short.start_m:g} m", short.final_m)
    shares, left = _shares(told), _left(by_range[-1], vehicle)
    return VehicleReport(vehicle.name, runs, seed, tuple(rows), _lines(shares, left), shares, left)
