"""Both spacecraft of a rendezvous step by step: orbits, guidance, and the target's rotation; no filter's formulas."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import kernel, long_kernel
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector
from relnav.simulation.orbits import MU, lvlh_axes, runge_kutta_step

STEP_S = 0.1
GUIDANCE_PERIOD_S = 1.0
GUIDANCE_STEPS = round(GUIDANCE_PERIOD_S / STEP_S)
BANDWIDTH_RAD_S = 0.06
"""Of the guidance, critically damped."""
CONTROL_RAD_S, CONTROL_DAMPING = 0.01, 0.9
"""Of the target's attitude."""


@kernel
def _times(a: Matrix, v: Vector, out: Vector) -> None:
    """Write a @ v, (3,), into out, which may not be v."""
    for i in range(3):
        out[i] = a[i, 0] * v[0] + a[i, 1] * v[1] + a[i, 2] * v[2]


@kernel
def _times_transposed(a: Matrix, v: Vector, out: Vector) -> None:
    """Write a.T @ v, (3,), into out, which may not be v."""
    for i in range(3):
        out[i] = a[0, i] * v[0] + a[1, i] * v[1] + a[2, i] * v[2]


@kernel
def _cross(a: Vector, b: Vector, out: Vector) -> None:
    """Write a x b into out, which may be neither."""
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _command(
    x: Vector, profile: Vector, chaser: Matrix, target: Matrix, rate: Vector, turn: float, ports: Matrix,
    largest: float, turns: bool, work: Matrix, out: Vector,
) -> None:  # fmt: skip
    """Write the acceleration, chaser axes, that brings the chaser's port onto the axis of the target's.

    x (6,): relative state; profile (2,): port distance and its rate; chaser and target (3, 3): frame's axes to the
    chaser's, and target's to the frame's; turn: the frame's rate about its y axis; ports (2, 3): target's, chaser's;
    largest: that may be ordered along an axis; turns: whether the chaser turns with the target, and is then carried
    round with it; work (7, 3).
    """
    reach, place, own, turning, speed, across, bent = work[0], work[1], work[2], work[3], work[4], work[5], work[6]
    for i in range(3):
        reach[i] = ports[0, i] + (profile[0] if i == 0 else 0.0)
    _times(target, reach, place)
    _times_transposed(chaser, ports[1], own)
    _times(target, rate, turning)
    turning[1] -= turn
    _cross(turning, place, across)
    for i in range(3):
        speed[i] = target[i, 0] * profile[1] + across[i]
    if turns:  # its centre of mass goes round too, and all of it needs an acceleration
        _cross(turning, own, across)
        for i in range(3):
            speed[i] -= across[i]
            across[i] = speed[i] + target[i, 0] * profile[1]
        _cross(turning, across, bent)
    n = -turn
    natural = (2.0 * n * x[5], -n * n * x[1], 3.0 * n * n * x[2] - 2.0 * n * x[3])
    for i in range(3):
        order = BANDWIDTH_RAD_S * (BANDWIDTH_RAD_S * (place[i] - own[i] - x[i]) + 2.0 * (speed[i] - x[3 + i]))
        if turns:
            order += bent[i]
        reach[i] = min(max(order - natural[i], -largest), largest)
    _times(chaser, reach, out)


@kernel
def _angular(
    dcm: Matrix, w: Vector, nadir: Vector, gradient: float, inertia: Matrix, inverse: Matrix, push: Vector,
    work: Matrix, out: Vector,
) -> None:  # fmt: skip
    """Write the target's angular acceleration: gravity gradient, Euler's equations, push (3,).

    dcm (3, 3): target's axes to inertial ones; nadir (3,) inertial; gradient: three times mu / r^3; work (5, 3).
    """
    down, bent, torque, spin, gyroscopic = work[0], work[1], work[2], work[3], work[4]
    _times_transposed(dcm, nadir, down)
    _times(inertia, down, bent)
    _cross(down, bent, torque)
    _times(inertia, w, spin)
    _cross(w, spin, gyroscopic)
    for i in range(3):
        torque[i] = gradient * torque[i] - gyroscopic[i]
    _times(inverse, torque, out)
    for i in range(3):
        out[i] += push[i]


@kernel
def _turn_target(
    dcm: Matrix, rate: Vector, r: Vector, mu: float, inertia: Matrix, inverse: Matrix, push: Vector, work: Matrix
) -> None:
    """Turn the target by a step, in place: Euler's equations at its middle; r (3,): inertial place; work (14, 3)."""
    nadir, angle, first, middle, half, scratch = work[0], work[1], work[2], work[3], work[4:7], work[7:12]
    distance = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    gradient = 3.0 * mu / (distance * distance * distance)
    for i in range(3):
        nadir[i] = -r[i] / distance
    _angular(dcm, rate, nadir, gradient, inertia, inverse, push, scratch, first)
    for i in range(3):
        angle[i], middle[i] = 0.5 * STEP_S * rate[i], rate[i] + 0.5 * STEP_S * first[i]
    turn_by_rotation_vector(dcm, angle, half)
    _angular(half, middle, nadir, gradient, inertia, inverse, push, scratch, work[12])
    for i in range(3):
        angle[i] = STEP_S * middle[i]
        rate[i] += STEP_S * work[12, i]
    turn_by_rotation_vector(dcm, angle, half)
    for i in range(3):
        for j in range(3):
            dcm[i, j] = half[i, j]


@kernel
def _controlled(
    frame: Matrix, dcm: Matrix, rate: Vector, held: Matrix, held_rate: Vector, work: Matrix, push: Vector
) -> None:
    """Write the angular acceleration (3,) by which the target holds its attitude; held (3, 3): target from frame."""
    reference, off = work[0:3], work[3]
    for i in range(3):
        for j in range(3):
            reference[i, j] = frame[0, i] * held[j, 0] + frame[1, i] * held[j, 1] + frame[2, i] * held[j, 2]
    rotation_vector_into(dcm, reference, off)
    for i in range(3):
        push[i] = -CONTROL_RAD_S * (CONTROL_RAD_S * off[i] + 2.0 * CONTROL_DAMPING * (rate[i] - held_rate[i]))


@kernel
def _relative(y: Matrix, frame: Matrix, turn: float, work: Matrix, x: Vector) -> None:
    """Write the relative state (6,) in a frame (3, 3) that turns about its y axis."""
    for i in range(3):
        work[0, i], work[1, i] = y[2, i] - y[0, i], y[3, i] - y[1, i]
    _times(frame, work[0], x[:3])
    _times(frame, work[1], x[3:])
    x[3] -= turn * x[2]
    x[5] += turn * x[0]


@long_kernel
def _integrate(
    y: Matrix, frames: Stack, turns: Vector, chaser: Stack, profile: Matrix, environment: Vector, thrust: Vector,
    pushed: Matrix, pushes: Matrix, dcm: Matrix, rate: Vector, inertia: Matrix, inverse: Matrix, held: Matrix,
    held_rates: Matrix, ports: Matrix, turns_too: bool, track: Matrix, attitudes: Stack, rates: Matrix,
    commands: Matrix, work: Matrix,
) -> None:  # fmt: skip
    """Write relative states (m, 6), the target's attitudes (m, 3, 3) and rates (m, 3), commands (one a period, 3).

    pushed (m, 3): accelerations of the chaser, frame; pushes (m, 3): of the target's rotation, or (0, 3): it controls
    itself. thrust (5,): errors of scale and direction, largest command. turns_too: as in `_command`. dcm and rate are
    the target's first, and used up; work (50, 3).
    """
    axes, order, body, sum_, inertial, push = work[0:3], work[3], work[4], work[5], work[6], work[7]
    target, scratch = work[8:11], work[11:]
    for k in range(track.shape[0]):
        frame = frames[k]
        _relative(y, frame, turns[k], scratch, track[k])
        for i in range(3):
            rates[k, i] = rate[i]
            for j in range(3):
                attitudes[k, i, j] = dcm[i, j]
                target[i, j] = frame[i, 0] * dcm[0, j] + frame[i, 1] * dcm[1, j] + frame[i, 2] * dcm[2, j]
        if k % GUIDANCE_STEPS == 0:
            _command(
                track[k], profile[k], chaser[k], target, rate, turns[k], ports, thrust[4], turns_too, scratch, order
            )
            for i in range(3):
                commands[k // GUIDANCE_STEPS, i] = order[i]
        _cross(thrust[1:4], order, body)
        for i in range(3):
            body[i] = (1.0 + thrust[0]) * (order[i] + body[i])
        _times_transposed(chaser[k], body, sum_)
        for i in range(3):
            sum_[i] += pushed[k, i]
        _times_transposed(frame, sum_, inertial)
        lvlh_axes(y[0], y[1], axes)
        _times(axes, inertial, body)
        runge_kutta_step(y, body, environment, STEP_S, scratch)
        if pushes.shape[0] > 0:
            for i in range(3):
                push[i] = pushes[k, i]
        else:
            _controlled(frame, dcm, rate, held, held_rates[k], scratch, push)
        _turn_target(dcm, rate, y[0], environment[MU], inertia, inverse, push, scratch)


@dataclass(frozen=True)
class Turning:
    """A target that turns.

    Attributes
    ----------
    dcm, rate_rad_s : (3, 3), (3,)
        At the start: its axes to inertial ones, inertial rate in its axes.
    inertia_kg_m2 : (3, 3)
    held, held_rates_rad_s : (3, 3), (m, 3)
        What it holds: target's axes from the frame's, and the rate of that step by step.
    pushes_rad_s2 : (m, 3)
        Angular accelerations step by step in place of its control; (0, 3) for none.
    """

    dcm: Matrix
    rate_rad_s: Vector
    inertia_kg_m2: Matrix
    held: Matrix
    held_rates_rad_s: Matrix
    pushes_rad_s2: Matrix


@dataclass(frozen=True)
class Course:
    """What the frames and the chaser's attitude are at each of m steps, whatever else happens.

    Attributes
    ----------
    frames, turns_rad_s : (m, 3, 3), (m,)
        `lvlh_ccsds` of the stated orbit against inertial axes, and its rate about its own y axis.
    chaser : (m, 3, 3)
        Chaser's axes from the frame's.
    profile : (m, 2)
        Port distance and its rate, as planned.
    pushed_m_s2 : (m, 3)
        Accelerations of the chaser that nobody commands, frame.
    turns_too : bool
        Whether the chaser's attitude follows the target's, which guidance then allows for.
    """

    frames: Stack
    turns_rad_s: Vector
    chaser: Stack
    profile: Matrix
    pushed_m_s2: Matrix
    turns_too: bool = False


@dataclass(frozen=True)
class Flown:
    """Relative states (m, 6), attitudes target to inertial (m, 3, 3), rates (m, 3), commands (one a period, 3)."""

    track: Matrix
    attitudes: Stack
    rates: Matrix
    commands: Matrix


def integrate(y: Matrix, course: Course, target: Turning, environment: Vector, thrust: Vector, ports: Matrix) -> Flown:
    """Fly from inertial states y (4, 3), as `orbits` has them and its environment.

    thrust (5,): relative error of size, turn, largest command along an axis, m/s^2; ports (2, 3) m: target's and
    chaser's, each in its own axes.
    """
    m = len(course.profile)
    flown = Flown(np.empty((m, 6)), np.empty((m, 3, 3)), np.empty((m, 3)), np.empty((-(-m // GUIDANCE_STEPS), 3)))
    own = np.ascontiguousarray
    _integrate(
        y,
        own(course.frames),
        course.turns_rad_s,
        own(course.chaser),
        course.profile,
        environment,
        thrust,
        own(course.pushed_m_s2),
        own(target.pushes_rad_s2),
        target.dcm.copy(),
        target.rate_rad_s.copy(),
        target.inertia_kg_m2,
        own(np.linalg.inv(target.inertia_kg_m2)),
        own(target.held),
        own(target.held_rates_rad_s),
        ports,
        course.turns_too,
        flown.track,
        flown.attitudes,
        flown.rates,
        flown.commands,
        np.zeros((50, 3)),
    )
    return flown
