"""From one epoch to the next: Clohessy-Wiltshire, the commanded control, and what neither of them knows."""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.dynamics.clohessy_wiltshire import PHI_PATTERN, acceleration_effect_into, transition_into
from relnav.dynamics.process_noise import acceleration_noise_into
from relnav.estimation.factored import factorize_into, time_update_into
from relnav.navigation.block import (
    CONTROL,
    EFFECT,
    INPUT,
    PHI,
    Q_FACTORS,
    SETTINGS,
    STEP_KEY,
    WORK,
)

TICKS_PER_S = 2.0**33
"""Steps are rounded to 0.12 ns: the differences of a log's time stamps differ by their rounding, and would otherwise
make every step a new one. At 1 m/s that is 0.1 nm."""
LONGEST_SNAP_S = 1e5
LONGEST_STEP_RAD = 1e12
"""Of the orbit, between two epochs: beyond it (1e15 s) the phase is lost to rounding; the track is dropped."""


@kernel
def _add_execution_error(u0: float, u1: float, u2: float, along: float, across: float, out: Matrix) -> None:
    """Add along^2 u u^T + across^2 (|u|^2 I - u u^T) of a control vector u to the last 3 x 3 of out."""
    row = out.shape[0] - 3
    size2 = u0 * u0 + u1 * u1 + u2 * u2
    for i in range(3):
        ui = u0 if i == 0 else (u1 if i == 1 else u2)
        for j in range(3):
            uj = u0 if j == 0 else (u1 if j == 1 else u2)
            product = ui * uj
            out[row + i, row + j] += along * along * product
            out[row + i, row + j] += across * across * ((size2 if i == j else 0.0) - product)


@kernel
def snapped(dt: float) -> float:
    """A step as it is taken: rounded to a tick, unless it is long."""
    return math.floor(dt * TICKS_PER_S + 0.5) / TICKS_PER_S if dt < LONGEST_SNAP_S else dt


@kernel
def prepare_step(block: Matrix, dt: float) -> bool:
    """Compute Phi, the factors of Q and the control effect for this dt and INPUT, unless they are those at hand.

    STEP_KEY then holds the step that was taken. Returns whether it is a new one.
    """
    key, control, given = block[STEP_KEY], block[CONTROL], block[INPUT]
    dt = snapped(dt)
    impulse = given[3] != 0.0 or given[4] != 0.0 or given[5] != 0.0
    same = key[0] == dt and key[1] == given[0] and key[2] == given[1] and key[3] == given[2]
    if same and key[4] == 0.0 and not impulse:
        return False
    key[0], key[1], key[2], key[3] = dt, given[0], given[1], given[2]
    key[4] = 1.0 if impulse else 0.0
    n, density = block[SETTINGS, 4], block[SETTINGS, 5]
    if not abs(n * dt) < LONGEST_STEP_RAD:
        block[Q_FACTORS, 0] = math.nan
        return True
    phi, q = block[PHI : PHI + 6], block[WORK : WORK + 6]
    noise = block[WORK + 6 : WORK + 9]
    for i in range(3):
        for j in range(3):
            noise[i, j] = density if i == j else 0.0
    root = math.sqrt(control[2])
    _add_execution_error(given[0], given[1], given[2], control[0] * root, control[1] * root, noise)
    acceleration_noise_into(n, dt, noise, q, phi, block[WORK + 12 : WORK + 18])
    _add_execution_error(given[3], given[4], given[5], control[0], control[1], q)
    if not factorize_into(q, block[Q_FACTORS : Q_FACTORS + 6]):
        block[Q_FACTORS, 0] = math.nan  # overflow over an absurd step: the track is dropped
    transition_into(n, dt, phi)
    effect = block[EFFECT]
    acceleration_effect_into(n, dt, given, effect)
    for i in range(3):
        effect[3 + i] += given[3 + i]
    return True


@straight_line(state=(6,), phi=PHI_PATTERN, effect=(6,), carried=(6,))
def carry_state(state: Vector, phi: Matrix, effect: Vector, carried: Vector) -> None:
    """Write Phi x + effect of a state x (6,) into carried (6,)."""
    x = np.zeros(6)
    for i in range(6):
        total = effect[i]
        for j in range(6):
            total = total + phi[i, j] * state[j]
        x[i] = total
    for i in range(6):
        carried[i] = x[i]


@straight_line(phi=PHI_PATTERN, vector=(6,))
def multiply(phi: Matrix, vector: Vector) -> None:
    """Replace a vector (6,) by Phi vector."""
    x = np.zeros(6)
    for i in range(6):
        for j in range(6):
            x[i] += phi[i, j] * vector[j]
    for i in range(6):
        vector[i] = x[i]


@straight_line(track=(7, 6), phi=PHI_PATTERN, effect=(6,), q_ld=(6, 6))
def carry(track: Matrix, phi: Matrix, effect: Vector, q_ld: Matrix) -> None:
    """Carry the state and factors of a track (7, 6) over a step: x = Phi x + effect, P = Phi P Phi^T + Q."""
    carry_state(track[0], phi, effect, track[0])
    time_update_into(track[1:7], phi, q_ld)


@kernel
def moves(sensitivity: Vector) -> bool:
    """Whether an error moves the position at all: of most nodes of a detector's field no spot comes near."""
    return bool(sensitivity[0] != 0.0 or sensitivity[1] != 0.0 or sensitivity[2] != 0.0)


@kernel
def advance(block: Matrix, track: Matrix, sensitivities: Matrix) -> None:
    """Carry the state and factors of a track (7, 6), and its sensitivities (m, 6), over the prepared step."""
    phi = block[PHI : PHI + 6]
    carry(track, phi, block[EFFECT], block[Q_FACTORS : Q_FACTORS + 6])
    for j in range(sensitivities.shape[0]):
        if moves(sensitivities[j]):
            multiply(phi, sensitivities[j])
