"""An approach flown on the integrated orbits: a small guidance law closes the loop on the true state."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, long_kernel
from relnav.dynamics.two_body import MU_EARTH_M3_S2
from relnav.mission import Model, VisionMission
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
    if t <= cruise:
        return start - speed * t, -speed, 0.0
    left = brake * math.exp(-BANDWIDTH_RAD_S * (t - cruise))
    return final + left, -BANDWIDTH_RAD_S * left, BANDWIDTH_RAD_S**2 * left


@long_kernel
def _fly(
    y: Matrix,
    environment: Vector,
    n: float,
    dcm_dock: Matrix,
    port: Vector,
    profile: Vector,
    dt: float,
    noise: Vector,
    draws: Matrix,
    state: Matrix,
    command: Matrix,
    scratch: Matrix,
) -> None:
    """Write truth (m, 6) and the commanded acceleration over the interval that ends at each row, (m, 3).

    profile: start range, final range, speed, guidance steps, thrust scale error, thrust turn (3). noise: amplitudes of
    the white acceleration, and of the control's errors in size and direction; draws (m, 7): standard normal, or (0, 7).
    scratch (28, 3): zeros.
    """
    axes, work, order, executed = scratch[0:3], scratch[3:26], scratch[26], scratch[27]
    relative_state(y, axes, state[0])
    hold = int(profile[3])
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
            executed[i] = order[i] * (1.0 + profile[4]) + profile[5 + j] * order[k] - profile[5 + k] * order[j]
            if draws.shape[0] > 0:  # a x draw has covariance |a|^2 I - a a^T
                across = order[j] * draws[row, 4 + k] - order[k] * draws[row, 4 + j]
                executed[i] += noise[0] * draws[row, i] + noise[1] * order[i] * draws[row, 3] + noise[2] * across
        runge_kutta_step(y, executed, environment, dt, work)
        relative_state(y, axes, state[row])


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
    count, dt = epochs_of(approach), 1.0 / approach.rate_hz
    y = np.zeros((4, 3))
    y[0], y[1] = _target_start(model, approach)
    dcm_dock, port = model.dcm_dock_from_lvlh, model.port_position_m
    start = np.concatenate([port + dcm_dock.T @ np.array(approach.start_m), disturbances.velocity_m_s])
    place_chaser(y, start, np.empty((3, 3)))
    environment = np.array(
        [
            MU_EARTH_M3_S2,
            J2_EARTH if approach.j2 else 0.0,
            approach.air_density_kg_m3,
            approach.target_ballistic_m2_kg,
            approach.chaser_ballistic_m2_kg,
        ]
    )
    profile = np.array(
        [
            approach.start_m[0],
            min(approach.final_range_m, approach.start_m[0]),
            approach.speed_m_s,
            max(1.0, round(GUIDANCE_PERIOD_S * approach.rate_hz)),
            approach.thrust_scale_error,
            *disturbances.thrust_turn_rad,
        ]
    )
    # White noise of density q, held over dt, has variance q / dt.
    density = model.process_noise
    error = math.sqrt(density.control_correlation_time_s / dt)
    noise = np.array(
        [
            math.sqrt(density.acceleration_noise_density_m2_s3 / dt),
            density.control_magnitude_sigma * error,
            density.control_direction_sigma_rad * error,
        ]
    )
    state, command, draws = np.empty((count, 6)), np.zeros((count, 3)), disturbances.draws
    n = model.orbit.mean_motion_rad_s
    _fly(y, environment, n, dcm_dock, port, profile, dt, noise, draws, state, command, np.zeros((28, 3)))
    if not np.isfinite(state).all():
        raise ValueError("the chaser flew out of all numbers: speed, air density or range are beyond any spacecraft")
    return np.arange(count, dtype=np.float64) / approach.rate_hz, state, command


def _target_start(model: Model | VisionMission, approach: Approach) -> tuple[Vector, Vector]:
    """Inertial position and velocity of the target: perigee on the line of nodes."""
    n, e = model.orbit.mean_motion_rad_s, model.orbit.eccentricity
    a = (MU_EARTH_M3_S2 / n**2) ** (1.0 / 3.0)
    p = a * (1.0 - e * e)
    given = approach.true_anomaly_deg
    theta = model.orbit.true_anomaly_rad if given is None else math.radians(given)
    i = math.radians(approach.inclination_deg)
    in_plane = np.array([[1.0, 0.0], [0.0, math.cos(i)], [0.0, math.sin(i)]])
    direction = np.array([math.cos(theta), math.sin(theta)])
    r = p / (1.0 + e * math.cos(theta)) * in_plane @ direction
    v = math.sqrt(MU_EARTH_M3_S2 / p) * in_plane @ np.array([-math.sin(theta), e + math.cos(theta)])
    return np.asarray(r, dtype=np.float64), np.asarray(v, dtype=np.float64)
