"""The motion relative to a target on a known orbit, as a filter takes it: one step of it, and its transition.

Clohessy-Wiltshire about a circular orbit, Yamanaka-Ankersen about any other. The orbit is a vector (4,): mean motion
rad/s, eccentricity, mean anomaly rad when the log's clock is zero, and a spare. All in `lvlh_ccsds`, m and m/s.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics import clohessy_wiltshire as circular
from relnav.dynamics.process_noise import acceleration_noise_into, eccentric_acceleration_into
from relnav.dynamics.yamanaka_ankersen import anomaly_step, from_anomalies_into, mean_from_true_anomaly

MEAN_MOTION, ECCENTRICITY, MEAN_ANOMALY = 0, 1, 2
LONGEST_STEP_RAD = 1e12
"""Of a circular orbit: beyond it the phase is lost to rounding."""

_circular_transition = circular.transition_into
_circular_effect = circular.acceleration_effect_into


def orbit_vector(mean_motion_rad_s: float, eccentricity: float = 0.0, true_anomaly_rad: float = 0.0) -> Vector:
    """The orbit (4,) of this module from the target's true anomaly when the log's clock is zero.

    Raises
    ------
    ValueError
        For a mean motion that is not positive, an eccentricity outside 0 <= e < 1, or an anomaly that is not finite.
    """
    n, e = mean_motion_rad_s, eccentricity
    if not (math.isfinite(n) and n > 0.0) or not 0.0 <= e < 1.0:
        raise ValueError(f"mean_motion_rad_s > 0 and 0 <= eccentricity < 1 are expected; got {n!r}, {e!r}")
    if not math.isfinite(true_anomaly_rad):
        raise ValueError(f"true_anomaly_rad must be finite; got {true_anomaly_rad!r}")
    return np.array([n, e, mean_from_true_anomaly(e, true_anomaly_rad), 0.0])


@kernel
def depends_on_dt_alone(orbit: Vector) -> bool:
    """Whether the same dt gives the same Phi, Q and effect at any time: so it is about a circular orbit."""
    return bool(orbit[1] == 0.0)


@kernel
def true_anomaly_at(orbit: Vector, t: float) -> tuple[float, float]:
    """Sine and cosine of the target's true anomaly at t s on the log's clock."""
    _, _, _, sine, cosine = anomaly_step(orbit[1], 0.0, 1.0, orbit[2] + orbit[0] * t)
    return sine, cosine


@entry
def frame_rate(orbit: Vector, t: float) -> float:
    """Rate at which `lvlh_ccsds` turns about -y at t s on the log's clock, rad/s: h / r^2 of the target."""
    rate, _ = frame_and_gradient(orbit, t)
    return rate


@kernel
def frame_and_gradient(orbit: Vector, t: float) -> tuple[float, float]:
    """That rate, and three times mu / r^3 of the target, 1/s^2.

    mu / r^3 = n^2 (a / r)^3, a / r = (1 + e cos v) / (1 - e^2).
    """
    n, e = float(orbit[0]), orbit[1]
    if e == 0.0:
        return n, 3.0 * n * n
    _, cosine = true_anomaly_at(orbit, t)
    q, near = 1.0 - e * e, 1.0 + e * cosine
    return n * near**2 / (q * math.sqrt(q)), 3.0 * n * n * (near / q) ** 3


@kernel
def transition_into(orbit: Vector, t: float, dt: float, phi: Matrix) -> None:
    """Write Phi (6, 6) from t s on the log's clock to t + dt, dt of either sign, into phi.

    The inverse of that over dt from t, as smoothing needs it, is `transition_into(orbit, t + dt, -dt, phi)`.
    """
    n, e = orbit[0], orbit[1]
    if e == 0.0:
        _circular_transition(n, dt, phi)
    else:
        sin0, cos0 = true_anomaly_at(orbit, t)
        S, V, W, _, _ = anomaly_step(e, sin0, cos0, n * dt)
        from_anomalies_into(n, e, sin0, cos0, S, V, W, phi)


@kernel
def propagate_into(
    orbit: Vector,
    t: float,
    dt: float,
    acceleration: Vector,
    density: Matrix,
    phi: Matrix,
    q: Matrix,
    effect: Vector,
    nodes: Stack,
    work: Matrix,
    again: bool = False,
) -> bool:
    """Write Phi and Q (6, 6) over a step dt >= 0 s from t s on the log's clock, and the effect (6,) of an acceleration.

    acceleration (3,) m/s^2 is constant over the step, density (3, 3) m^2/s^3 that of white acceleration noise, both in
    `lvlh_ccsds`. work (6, 6) and nodes (NODES, 6, 6) are scratch, none of the other arrays; again: nodes and phi hold
    what a call for this orbit, a circular one, and this dt has left. False, and nothing of use written, for a step so
    long that nothing is known of the position after it (LONGEST_STEP_RAD, `process_noise.MOST_PIECES`) or that is no
    number.
    """
    n, e = orbit[0], orbit[1]
    if not abs(n * dt) < LONGEST_STEP_RAD:
        return False
    if e == 0.0:
        acceleration_noise_into(n, dt, density, q, nodes, work, again)
        if not again:
            _circular_transition(n, dt, phi)
        _circular_effect(n, dt, acceleration, effect)
        return True
    sin0, cos0 = true_anomaly_at(orbit, t)
    S, V, W, sin1, cos1 = anomaly_step(e, sin0, cos0, n * dt)
    if not eccentric_acceleration_into(n, e, sin1, cos1, dt, acceleration, density, q, effect, nodes[0]):
        return False
    from_anomalies_into(n, e, sin0, cos0, S, V, W, phi)
    return True
