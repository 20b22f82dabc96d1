"""How the chaser moves about its target: Clohessy-Wiltshire, or Yamanaka-Ankersen about an eccentric one.

One signature for a process model: transition, what the control adds, what white acceleration adds. On a circular orbit
all three depend on the step alone; on an eccentric one on where the target is as well.

The effect of an acceleration that is held in `lvlh_ccsds`, and the covariance of white noise, are integrals of
Phi(s -> t + dt) over the step, by five Gauss-Legendre points in pieces of at most a quarter radian at perigee, where a
test holds them to 1e-9 of integrated motion.
"""

import math

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.dynamics import clohessy_wiltshire, yamanaka_ankersen
from relnav.dynamics.process_noise import NODES_5, WEIGHTS_5, acceleration_noise_into

PHI_PATTERN = ("*0**0*", "0*00*0", "*0**0*", "*0**0*", "0*00*0", "*0**0*")
"""Where Phi may differ from 0 about an eccentric target; about a circular one `clohessy_wiltshire.PHI_PATTERN`."""
WORK_ROWS = 20
"""Of scratch, six columns wide."""
LONGEST_STEP_RAD = 1e12
"""Of a circular orbit, between two times: beyond it (1e15 s) the phase is lost to rounding."""
LONGEST_ECCENTRIC_STEP_RAD = 1e4
"""Of an eccentric one: its integrals go through the step piece by piece."""

circular_transition_into = clohessy_wiltshire.transition_into
circular_effect_into = clohessy_wiltshire.acceleration_effect_into
eccentric_transition_into = yamanaka_ankersen.transition_into
mean_from_true_anomaly = yamanaka_ankersen.mean_from_true_anomaly
true_from_mean_anomaly = yamanaka_ankersen.true_from_mean_anomaly
_LARGEST_PIECE_RAD = 0.25


@kernel
def depends_on_dt_alone(orbit: Vector) -> bool:
    """Whether a step's transition, effect and noise are those of every step as long; orbit as in `propagate_into`."""
    return bool(orbit[1] == 0.0)


@kernel
def true_anomaly_at(orbit: Vector, t: float) -> float:
    """True anomaly of the target at t s, rad; orbit as in `propagate_into`."""
    return true_from_mean_anomaly(orbit[1], orbit[2] + orbit[0] * t)


@kernel
def turn_rate(orbit: Vector, t: float) -> float:
    """Rate rad/s at which `lvlh_ccsds` turns about -y at t s: n (1 + e cos theta)^2 / (1 - e^2)^(3/2)."""
    e = orbit[1]
    if e == 0.0:
        return float(orbit[0])
    rho = 1.0 + e * math.cos(true_anomaly_at(orbit, t))
    return float(orbit[0] * rho * rho / (1.0 - e * e) ** 1.5)


@kernel
def transition_into(orbit: Vector, t: float, dt: float, phi: Matrix, work: Matrix) -> None:
    """Write Phi (6, 6) from t to t + dt s, dt of either sign; work (WORK_ROWS, 6) is scratch."""
    if orbit[1] == 0.0:
        circular_transition_into(orbit[0], dt, phi)
    else:
        eccentric_transition_into(orbit[0], orbit[1], true_anomaly_at(orbit, t), dt, phi, work)


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
    work: Matrix,
) -> bool:
    """Write Phi (6, 6), Q (6, 6) and what an acceleration held from t to t + dt adds, effect (6,).

    Parameters
    ----------
    orbit : (3,)
        Mean motion rad/s, eccentricity, mean anomaly at clock zero rad.
    t, dt : float
        Start on that clock, and length >= 0 of the step, s.
    acceleration, density : (3,), (3, 3)
        m/s^2 and m^2/s^3, `lvlh_ccsds`.
    work : (WORK_ROWS, 6)
        Scratch.

    Returns
    -------
    False, with nothing written, for a step so long that nothing would be known at its end.
    """
    n, e = orbit[0], orbit[1]
    if not abs(n * dt) < (LONGEST_STEP_RAD if e == 0.0 else LONGEST_ECCENTRIC_STEP_RAD):
        return False
    if e == 0.0:
        acceleration_noise_into(n, dt, density, q, phi, work[0:6])
        circular_transition_into(n, dt, phi)
        circular_effect_into(n, dt, acceleration, effect)
        return True
    for i in range(6):
        effect[i] = 0.0
        for j in range(6):
            q[i, j] = 0.0
    fastest = n * (1.0 + e) * (1.0 + e) / (1.0 - e * e) ** 1.5
    pieces = max(1, math.ceil(fastest * dt / _LARGEST_PIECE_RAD))
    h, by_density = dt / pieces, work[14:20]
    for piece in range(pieces):
        for node in range(5):
            s = (piece + NODES_5[node]) * h
            weight = WEIGHTS_5[node] * h
            eccentric_transition_into(n, e, true_anomaly_at(orbit, t + s), dt - s, phi, work[0:14])
            for i in range(6):
                for k in range(3):
                    b0, b1, b2 = phi[i, 3], phi[i, 4], phi[i, 5]
                    by_density[i, k] = (b0 * density[0, k] + b1 * density[1, k] + b2 * density[2, k]) * weight
                effect[i] += weight * (
                    phi[i, 3] * acceleration[0] + phi[i, 4] * acceleration[1] + phi[i, 5] * acceleration[2]
                )
            for i in range(6):
                for j in range(i + 1):
                    q[i, j] += (
                        by_density[i, 0] * phi[j, 3] + by_density[i, 1] * phi[j, 4] + by_density[i, 2] * phi[j, 5]
                    )
    for i in range(6):
        for j in range(i):
            q[j, i] = q[i, j]
    eccentric_transition_into(n, e, true_anomaly_at(orbit, t), dt, phi, work[0:14])
    return True
