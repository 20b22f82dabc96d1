"""From one epoch to the next: the relative motion, the commanded control, and what neither of them knows."""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, straight_line, variant
from relnav.dynamics.clohessy_wiltshire import PHI_PATTERN
from relnav.dynamics.error_state import MOTION, VELOCITY
from relnav.dynamics.process_noise import add_execution_error
from relnav.dynamics.relative_motion import depends_on_dt_alone, propagate_into
from relnav.dynamics.yamanaka_ankersen import PHI_PATTERN as ECCENTRIC_PATTERN
from relnav.estimation.considered import is_felt
from relnav.estimation.factored import factorize_into, time_update_into

TICKS_PER_S = 2.0**33
"""Steps are rounded to 0.12 ns: the differences of a log's time stamps differ by their rounding, and would otherwise
make every step a new one. At 1 m/s that is 0.1 nm."""
LONGEST_SNAP_S = 1e5


@kernel
def snapped(dt: float) -> float:
    """A step as it is taken: rounded to a tick, unless it is long."""
    return math.floor(dt * TICKS_PER_S + 0.5) / TICKS_PER_S if dt < LONGEST_SNAP_S else dt


@kernel
def prepare_step(step: Record, motion: Record, scratch: Record, t: float, dt: float) -> bool:
    """Compute Phi, the factors of Q and the control effect from t over dt, unless they are those at hand.

    `step["dt"]` then holds the step that was taken. Returns whether it is a new one.
    """
    held, orbit, a, v = step["acceleration"], motion["orbit"], motion["acceleration"], motion["delta_v"]
    dt = snapped(dt)
    impulse = v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0
    as_long = step["dt"] == dt and depends_on_dt_alone(orbit)
    as_pushed = held[0] == a[0] and held[1] == a[1] and held[2] == a[2]
    if as_long and as_pushed and step["impulse"] == 0 and not impulse:
        return False
    step["dt"], held[0], held[1], held[2] = math.nan, a[0], a[1], a[2]  # until the rest stands here
    step["impulse"] = 1 if impulse else 0
    density = motion["acceleration_noise_density"]
    along, across = motion["control_magnitude_sigma"], motion["control_direction_sigma"]
    noise, effect = step["noise"], step["effect"]
    q, densities = scratch["covariance"], scratch["density"]
    for i in range(3):
        for j in range(3):
            densities[i, j] = density if i == j else 0.0
    root = math.sqrt(motion["control_correlation_time"])
    add_execution_error(a, along * root, across * root, densities)
    if not propagate_into(orbit, t, dt, a, densities, step["phi"], q, effect, step["nodes"], scratch["six"], as_long):
        noise[0, 0] = math.nan
        step["dt"] = dt
        return True
    add_execution_error(v, along, across, q[VELOCITY:MOTION, VELOCITY:MOTION])
    if not factorize_into(q, noise):
        noise[0, 0] = math.nan  # overflow over an absurd step: the track is dropped
    for i in range(3):
        effect[VELOCITY + i] += v[i]
    step["dt"] = dt
    return True


@straight_line(state=(MOTION,), phi=PHI_PATTERN, effect=(MOTION,), carried=(MOTION,))
def carry_state(state: Vector, phi: Matrix, effect: Vector, carried: Vector) -> None:
    """Write Phi x + effect of a state x (6,) into carried (6,)."""
    x = np.zeros(MOTION)
    for i in range(MOTION):
        total = effect[i]
        for j in range(MOTION):
            total = total + phi[i, j] * state[j]
        x[i] = total
    for i in range(MOTION):
        carried[i] = x[i]


@straight_line(phi=PHI_PATTERN, vector=(MOTION,))
def multiply(phi: Matrix, vector: Vector) -> None:
    """Replace a vector (n,) by Phi vector."""
    n = vector.shape[0]
    x = np.zeros(n)
    for i in range(n):
        for j in range(n):
            x[i] += phi[i, j] * vector[j]
    for i in range(n):
        vector[i] = x[i]


@straight_line(state=(MOTION,), ld=(MOTION, MOTION), phi=PHI_PATTERN, effect=(MOTION,), noise=(MOTION, MOTION))
def carry(state: Vector, ld: Matrix, phi: Matrix, effect: Vector, noise: Matrix) -> None:
    """Carry a state and its factors over a step: x = Phi x + effect, P = Phi P Phi^T + Q; noise: factors of Q."""
    carry_state(state, phi, effect, state)
    time_update_into(ld, phi, noise)


carry_eccentric = variant(carry, "carry_eccentric", phi=ECCENTRIC_PATTERN)
carry_state_eccentric = variant(carry_state, "carry_state_eccentric", phi=ECCENTRIC_PATTERN)
multiply_eccentric = variant(multiply, "multiply_eccentric", phi=ECCENTRIC_PATTERN)


@kernel
def advance(step: Record, orbit: Vector, track: Record, sensitivities: Matrix) -> None:
    """Carry a track, and its sensitivities (m, 6), over the prepared step."""
    phi, circular = step["phi"], depends_on_dt_alone(orbit)
    if circular:
        carry(track["state"], track["ld"], phi, step["effect"], step["noise"])
    else:
        carry_eccentric(track["state"], track["ld"], phi, step["effect"], step["noise"])
    for j in range(sensitivities.shape[0]):
        if is_felt(sensitivities[j]):  # of most nodes of a detector's field no spot comes near
            if circular:
                multiply(phi, sensitivities[j])
            else:
                multiply_eccentric(phi, sensitivities[j])


@kernel
def advance_state(step: Record, orbit: Vector, state: Vector) -> None:
    """Carry a state (6,) alone over the prepared step."""
    if depends_on_dt_alone(orbit):
        carry_state(state, step["phi"], step["effect"], state)
    else:
        carry_state_eccentric(state, step["phi"], step["effect"], state)
