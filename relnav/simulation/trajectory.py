"""An approach flown on the integrated orbits: a small guidance law closes the loop on the true state."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import kernel, long_entry, long_kernel
from relnav.codegen.together import attempt, lanes_of, new_lanes, select
from relnav.dynamics.two_body import MU_EARTH_M3_S2
from relnav.mission import Model, Orbit, VisionMission
from relnav.simulation.orbits import J2_EARTH, place_chaser, relative_state, runge_kutta_step


@dataclass(frozen=True)
class Approach:
    """A forced approach along the docking axis to a hold.

    Attributes
    ----------
    duration_s, rate_hz : float
        Length of the log and epochs a second.
    start_m : (3,)
        Start in the docking frame.
    final_range_m, speed_m_s : float
        Where the reference point stops, and how fast it moves there.
    true_anomaly_deg : float or None
        Of the target at the start; the model's if None.
    inclination_deg : float
        Of its orbit.
    j2 : bool
        Whether the Earth is oblate.
    air_density_kg_m3, target_ballistic_m2_kg, chaser_ballistic_m2_kg : float
        Drag; a density of zero is none.
    thrust_scale_error : float
        Relative error of every executed acceleration, constant over the run.
    assumed_noise : bool
        Disturb the chaser with just the white acceleration that the model's process noise states (its density and its
        control errors): truth as the filter believes it to be, for consistency tests.
    assumed_start : bool
        Draw the initial velocity from the filter's prior, instead of starting at rest.
    """

    duration_s: float = 300.0
    rate_hz: float = 10.0
    start_m: tuple[float, float, float] = (10.0, 0.25, -0.15)
    final_range_m: float = 4.0
    speed_m_s: float = 0.03
    true_anomaly_deg: float | None = None
    inclination_deg: float = 51.6
    j2: bool = False
    air_density_kg_m3: float = 0.0
    target_ballistic_m2_kg: float = 0.01
    chaser_ballistic_m2_kg: float = 0.02
    thrust_scale_error: float = 0.0
    assumed_noise: bool = False
    assumed_start: bool = False

    def __post_init__(self) -> None:
        for name in ("duration_s", "rate_hz", "final_range_m", "speed_m_s"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(f"{name} must be positive and finite; got {getattr(self, name)!r}")
        if not all(math.isfinite(value) for value in self.start_m) or self.start_m[0] < self.final_range_m:
            raise ValueError(f"start_m must be finite and not inside final_range_m; got {self.start_m!r}")
        if not (math.isfinite(self.air_density_kg_m3) and self.air_density_kg_m3 >= 0.0):
            raise ValueError(f"air_density_kg_m3 must be >= 0 and finite; got {self.air_density_kg_m3!r}")


GUIDANCE_PERIOD_S = 1.0
BANDWIDTH_RAD_S = 0.06
"""Of the guidance: a critically damped loop settles from a lateral offset within a minute, far above the orbit rate."""


@kernel
def reference(start: float, final: float, speed: float, t: float) -> tuple[float, float, float]:
    """Range, rate and acceleration of the reference point: a steady approach, then a decay that does not overshoot.

    Within speed / BANDWIDTH_RAD_S of the hold the rate falls with the distance left.
    """
    brake = min(speed / BANDWIDTH_RAD_S, start - final)
    cruise = (start - final - brake) / speed
    left, steady = brake * math.exp(-BANDWIDTH_RAD_S * max(t - cruise, 0.0)), t <= cruise
    reach = select(steady, start - speed * t, final + left)
    rate = select(steady, -speed, -BANDWIDTH_RAD_S * left)
    return reach, rate, select(steady, 0.0, BANDWIDTH_RAD_S**2 * left)


@long_kernel
def _fly(
    y: Matrix,
    environment: Vector,
    n: float,
    dcm_dock: Matrix,
    port: Vector,
    profile: Vector,
    hold: int,
    dt: float,
    noise: Vector,
    draws: Matrix,
    state: Matrix,
    command: Matrix,
    scratch: Matrix,
) -> None:
    """Write truth (m, 6) and the commanded acceleration over the interval that ends at each row, (m, 3).

    profile: start range, final range, speed, thrust scale error, thrust turn (3); hold: rows of a guidance step.
    noise: amplitudes of the white acceleration, and of the control's errors in size and direction; draws (m, 7):
    standard normal, or (0, 7). scratch (28, 3): zeros.
    """
    axes, work, order, executed = scratch[0:3], scratch[3:26], scratch[26], scratch[27]
    relative_state(y, axes, state[0])
    for row in range(1, state.shape[0]):
        if (row - 1) % hold == 0:
            x = state[row - 1]
            t = (row - 1) * dt
            reach, speed, braking = reference(profile[0], profile[1], profile[2], t)
            for i in range(3):
                error, rate = -x[i] + port[i] + dcm_dock[0, i] * reach, dcm_dock[0, i] * speed - x[3 + i]
                order[i] = BANDWIDTH_RAD_S * (BANDWIDTH_RAD_S * error + 2.0 * rate) + dcm_dock[0, i] * braking
            order[0] -= 2.0 * n * x[5]
            order[1] += n * n * x[1]
            order[2] += 2.0 * n * x[3] - 3.0 * n * n * x[2]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            command[row, i] = order[i]
            executed[i] = order[i] * (1.0 + profile[3]) + profile[4 + j] * order[k] - profile[4 + k] * order[j]
            if draws.shape[0] > 0:  # a x draw has covariance |a|^2 I - a a^T
                across = order[j] * draws[row, 4 + k] - order[k] * draws[row, 4 + j]
                executed[i] += noise[0] * draws[row, i] + noise[1] * order[i] * draws[row, 3] + noise[2] * across
        runge_kutta_step(y, executed, environment, dt, work)
        relative_state(y, axes, state[row])


@long_entry
def _fly_together(
    y: Stack,
    environment: Vector,
    n: float,
    dcm_dock: Matrix,
    port: Vector,
    profile: Matrix,
    hold: int,
    dt: float,
    noise: Vector,
    draws: Stack,
    state: Stack,
    command: Stack,
    scratch: Stack,
) -> bool:
    """`_fly` of RUNS runs; whether all went the same way."""
    divided, _ = attempt(
        _fly,
        lanes_of(y),
        environment,
        n,
        dcm_dock,
        port,
        lanes_of(profile),
        hold,
        dt,
        noise,
        lanes_of(draws),
        lanes_of(state),
        lanes_of(command),
        lanes_of(scratch),
    )
    return divided == 0


@dataclass(frozen=True)
class Disturbances:
    """What sets one flight of an approach apart from another.

    Attributes
    ----------
    velocity_m_s : (3,)
        At the start, as seen in `lvlh_ccsds`.
    draws : (m, 7)
        Standard normal numbers of every interval's white acceleration, or (0, 7) for none.
    thrust_turn_rad : (3,)
        Small rotation vector, `lvlh_ccsds`, by which every executed acceleration is turned.
    """

    velocity_m_s: Vector
    draws: Matrix
    thrust_turn_rad: Vector


def fly(model: Model | VisionMission, approach: Approach, rng: np.random.Generator) -> tuple[Vector, Matrix, Matrix]:
    """Fly an approach; `fly_disturbed` with what the generator draws."""
    velocity = rng.normal(size=3) * model.filter.initial_velocity_sigma_m_s * approach.assumed_start
    draws = rng.normal(size=(epochs_of(approach) if approach.assumed_noise else 0, 7))
    return fly_disturbed(model, approach, Disturbances(velocity, draws, np.zeros(3)))


def epochs_of(approach: Approach) -> int:
    """Number of rows of its log.

    Raises
    ------
    ValueError
        If there are fewer than two.
    """
    count = round(approach.duration_s * approach.rate_hz)
    if count < 2:
        raise ValueError(f"duration_s times rate_hz must give two epochs or more; got {count}")
    return count


def fly_disturbed(
    model: Model | VisionMission, approach: Approach, disturbances: Disturbances
) -> tuple[Vector, Matrix, Matrix]:
    """Fly an approach with what disturbs it.

    Returns
    -------
    t_s (m,), truth (m, 6) in `lvlh_ccsds`, commanded acceleration (m, 3) m/s^2 held over the interval that ends at
    each row.
    """
    y, profile = _beginning(model, approach, disturbances)
    count = epochs_of(approach)
    state, command = np.empty((count, 6)), np.zeros((count, 3))
    _fly(y, *_setting(model, approach, profile), disturbances.draws, state, command, np.zeros((28, 3)))
    _check_flown(state)
    return np.arange(count, dtype=np.float64) / approach.rate_hz, state, command


def fly_together(
    model: Model | VisionMission, runs: list[tuple[Approach, Disturbances]]
) -> tuple[Vector, Matrix, Matrix]:
    """RUNS approaches of one scenario at once, each to the bit as `fly_disturbed` flies it.

    Returns
    -------
    t_s (m,), truth (m, 6, RUNS), commanded acceleration (m, 3, RUNS).
    """
    approach, disturbances = runs[0]
    count = epochs_of(approach)
    y, profile, draws = new_lanes(4, 3), new_lanes(7), new_lanes(*disturbances.draws.shape, make=np.empty)
    for lane, run in enumerate(runs):
        y[..., lane], profile[..., lane] = _beginning(model, *run)
        draws[..., lane] = run[1].draws
    state, command = new_lanes(count, 6, make=np.empty), new_lanes(count, 3, make=np.empty)
    command[0] = 0.0  # before it there is no interval
    agreed = _fly_together(y, *_setting(model, approach, profile), draws, state, command, new_lanes(28, 3))
    assert agreed, "nothing in a flight is decided by its numbers"
    _check_flown(state)
    return np.arange(count, dtype=np.float64) / approach.rate_hz, state, command


def _beginning(model: Model | VisionMission, approach: Approach, disturbances: Disturbances) -> tuple[Matrix, Vector]:
    """Inertial states (4, 3) of target and chaser at the start, and the profile, as `_fly` wants them."""
    y = np.zeros((4, 3))
    y[0], y[1] = _target_start(model.orbit, approach.true_anomaly_deg, approach.inclination_deg)
    place = model.port_position_m + model.dcm_dock_from_lvlh.T @ np.array(approach.start_m)
    place_chaser(y, np.concatenate([place, disturbances.velocity_m_s]), np.empty((3, 3)))
    final_range = min(approach.final_range_m, approach.start_m[0])
    profile = [approach.start_m[0], final_range, approach.speed_m_s, approach.thrust_scale_error]
    return y, np.array([*profile, *disturbances.thrust_turn_rad])


def _setting(
    model: Model | VisionMission, approach: Approach, profile: Vector
) -> tuple[Vector, float, Matrix, Vector, Vector, int, float, Vector]:
    """What else `_fly` wants, up to the draws."""
    dt, density = 1.0 / approach.rate_hz, model.process_noise
    environment = [MU_EARTH_M3_S2, J2_EARTH if approach.j2 else 0.0, approach.air_density_kg_m3]
    environment += [approach.target_ballistic_m2_kg, approach.chaser_ballistic_m2_kg]
    # White noise of density q, held over dt, has variance q / dt.
    error = math.sqrt(density.control_correlation_time_s / dt)
    noise = [math.sqrt(density.acceleration_noise_density_m2_s3 / dt)]
    noise += [density.control_magnitude_sigma * error, density.control_direction_sigma_rad * error]
    hold = max(1, round(GUIDANCE_PERIOD_S * approach.rate_hz))
    n, dock, port = model.orbit.mean_motion_rad_s, model.dcm_dock_from_lvlh, model.port_position_m
    return np.array(environment), n, dock, port, profile, hold, dt, np.array(noise)


def _check_flown(state: Matrix) -> None:
    if not np.isfinite(state).all():
        raise ValueError("the chaser flew out of all numbers: speed, air density or range are beyond any spacecraft")


@lru_cache(maxsize=8)
def _target_start(orbit: Orbit, true_anomaly_deg: float | None, inclination_deg: float) -> tuple[Vector, Vector]:
    """Inertial position and velocity of the target: perigee on the line of nodes. Of every run of a scenario alike."""
    n, e = orbit.mean_motion_rad_s, orbit.eccentricity
    a = (MU_EARTH_M3_S2 / n**2) ** (1.0 / 3.0)
    p = a * (1.0 - e * e)
    theta = orbit.true_anomaly_rad if true_anomaly_deg is None else math.radians(true_anomaly_deg)
    i = math.radians(inclination_deg)
    in_plane = np.array([[1.0, 0.0], [0.0, math.cos(i)], [0.0, math.sin(i)]])
    direction = np.array([math.cos(theta), math.sin(theta)])
    r = p / (1.0 + e * math.cos(theta)) * in_plane @ direction
    v = math.sqrt(MU_EARTH_M3_S2 / p) * in_plane @ np.array([-math.sin(theta), e + math.cos(theta)])
    for vector in (r, v):
        vector.setflags(write=False)
    return r, v
