"""Two spacecraft integrated in inertial space, and the relative state that follows: no Clohessy-Wiltshire here.

Point-mass gravity, optionally J2 and drag (air at rest in inertial space, of one density), classical fourth-order
Runge-Kutta with the log's own step. Commanded acceleration is held in the target's turning `lvlh_ccsds` axes.
"""

import math

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel

EARTH_RADIUS_M = 6378136.6  # the same table
J2_EARTH = 1.0826359e-3  # the same table

# Environment vector: mu, J2 switch, air density kg/m^3, target and chaser ballistic coefficients Cd A / m, m^2/kg
MU, J2, DENSITY, DRAG_TARGET, DRAG_CHASER = 0, 1, 2, 3, 4


@kernel
def _natural_acceleration(r: Vector, v: Vector, environment: Vector, ballistic: float, a: Vector) -> None:
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    distance = math.sqrt(r2)
    gravity = -environment[MU] / (r2 * distance)
    a[0], a[1], a[2] = gravity * r[0], gravity * r[1], gravity * r[2]
    if environment[J2] != 0.0:
        squash = 1.5 * environment[J2] * (EARTH_RADIUS_M / distance) ** 2
        s = 5.0 * r[2] * r[2] / r2
        a[0] *= 1.0 + squash * (1.0 - s)
        a[1] *= 1.0 + squash * (1.0 - s)
        a[2] *= 1.0 + squash * (3.0 - s)
    if environment[DENSITY] != 0.0:
        drag = 0.5 * environment[DENSITY] * ballistic * math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        for i in range(3):
            a[i] -= drag * v[i]


@kernel
def lvlh_axes(r: Vector, v: Vector, axes: Matrix) -> float:
    """Write the `lvlh_ccsds` axes (rows, inertial components) of a target at r, v; returns its turn rate h / r^2."""
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    h0 = r[1] * v[2] - r[2] * v[1]
    h1 = r[2] * v[0] - r[0] * v[2]
    h2 = r[0] * v[1] - r[1] * v[0]
    h = math.sqrt(h0 * h0 + h1 * h1 + h2 * h2)
    distance = math.sqrt(r2)
    axes[1, 0], axes[1, 1], axes[1, 2] = -h0 / h, -h1 / h, -h2 / h
    for i in range(3):
        axes[2, i] = -r[i] / distance
    axes[0, 0] = axes[1, 1] * axes[2, 2] - axes[1, 2] * axes[2, 1]
    axes[0, 1] = axes[1, 2] * axes[2, 0] - axes[1, 0] * axes[2, 2]
    axes[0, 2] = axes[1, 0] * axes[2, 1] - axes[1, 1] * axes[2, 0]
    return float(h / r2)


@kernel
def _derivative(y: Matrix, command: Vector, environment: Vector, axes: Matrix, dy: Matrix) -> None:
    """Rows of y: target r, v, chaser r, v."""
    _natural_acceleration(y[0], y[1], environment, environment[DRAG_TARGET], dy[1])
    _natural_acceleration(y[2], y[3], environment, environment[DRAG_CHASER], dy[3])
    lvlh_axes(y[0], y[1], axes)
    for i in range(3):
        dy[0, i] = y[1, i]
        dy[2, i] = y[3, i]
        for j in range(3):
            dy[3, i] += axes[j, i] * command[j]


@kernel
def runge_kutta_step(y: Matrix, command: Vector, environment: Vector, dt: float, work: Matrix) -> None:
    """Advance y (4, 3), in place, by dt under a commanded acceleration (3,) in lvlh_ccsds; work (23, 3) scratch."""
    k1, k2, k3, k4 = work[0:4], work[4:8], work[8:12], work[12:16]
    trial, axes = work[16:20], work[20:23]
    _derivative(y, command, environment, axes, k1)
    for i in range(4):
        for j in range(3):
            trial[i, j] = y[i, j] + 0.5 * dt * k1[i, j]
    _derivative(trial, command, environment, axes, k2)
    for i in range(4):
        for j in range(3):
            trial[i, j] = y[i, j] + 0.5 * dt * k2[i, j]
    _derivative(trial, command, environment, axes, k3)
    for i in range(4):
        for j in range(3):
            trial[i, j] = y[i, j] + dt * k3[i, j]
    _derivative(trial, command, environment, axes, k4)
    for i in range(4):
        for j in range(3):
            y[i, j] += dt / 6.0 * (k1[i, j] + 2.0 * k2[i, j] + 2.0 * k3[i, j] + k4[i, j])


@kernel
def relative_state(y: Matrix, axes: Matrix, state: Vector) -> None:
    """Write the chaser's state (6,) relative to the target in `lvlh_ccsds` into state; axes (3, 3) scratch.

    The frame turns at omega = -rate y, so the velocity seen in it is C dv - omega x rho.
    """
    rate = lvlh_axes(y[0], y[1], axes)
    for i in range(3):
        state[i] = 0.0
        state[3 + i] = 0.0
        for j in range(3):
            state[i] += axes[i, j] * (y[2, j] - y[0, j])
            state[3 + i] += axes[i, j] * (y[3, j] - y[1, j])
    state[3] += rate * state[2]
    state[5] -= rate * state[0]


@kernel
def place_chaser(y: Matrix, state: Vector, axes: Matrix) -> None:
    """Set the chaser's rows of y from its relative state (6,), the inverse of `relative_state`."""
    rate = lvlh_axes(y[0], y[1], axes)
    v0, v1, v2 = state[3] - rate * state[2], state[4], state[5] + rate * state[0]
    for i in range(3):
        y[2, i] = y[0, i] + axes[0, i] * state[0] + axes[1, i] * state[1] + axes[2, i] * state[2]
        y[3, i] = y[1, i] + axes[0, i] * v0 + axes[1, i] * v1 + axes[2, i] * v2
