"""The step of a vehicle's estimate, compiled: relative motion, the target's turn and all covariances.

Errors (Markley and Crassidis 2014, ch. 6, for the gyro; convention of `relnav.geometry.rotation_vector`):

    alpha' = -w x alpha - db - dM w - n_w,     d(a) = C_LB (f dk - [f x] (dd + alpha)) + ds

with M the gyro's scale and misalignment (`gyro_errors`), a = (1 + k) C_LB (f + d x f) + s the acceleration in
`lvlh_ccsds`, f the command, k and d the thrusters' errors, s the slow acceleration. Relative motion and the target's
turn bring their own transitions.

The chaser turns within a step from t_0 to t_1, and the thrusters with it, by C(t) = C_LB exp([phi(t) x]). The gyro's
samples give C(t) all the time, so that velocity gets the integral of C dt, and position that of (t_1 - t) C dt. Of an
attitude's error the same is - [(integral) f x] C(t_0) alpha(t_0), as alpha does not turn in inertial axes.
"""

import numpy as np

from relnav.arrays import Codes, Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics import gauss_markov, relative_motion, rigid_body
from relnav.dynamics.clohessy_wiltshire import acceleration_effect_into
from relnav.dynamics.error_state import MOTION, ROTATION
from relnav.dynamics.process_noise import NODES
from relnav.dynamics.rigid_body import BODY_ROWS, FRAME_RATE, GRADIENT, ORBIT
from relnav.estimation.schmidt import carry_into, clear
from relnav.vehicle.drift_sums import carry_drifts
from relnav.vehicle.gyro_errors import drive_attitude, drive_sensitivities, driven_into
from relnav.vehicle.layout import (
    CHASER_ATTITUDE,
    DRIVING,
    GYRO_BIAS,
    GYRO_ERRORS,
    MOVING,
    SLOW_ACCELERATION,
    TARGET_ATTITUDE,
    TARGET_RATE,
    THRUST_DIRECTION,
    THRUST_SCALE,
    VELOCITY,
)
from relnav.vehicle.orbit_frame import lvlh_from_inertial_into
from relnav.vehicle.turning import turn_through

_F = np.float64

CONSTANTS = np.dtype(
    [
        ("orbit", _F, 4),
        ("axes", _F, (3, 3)),
        ("body", _F, (BODY_ROWS, 3)),
        ("torque_density", _F),
        ("density", _F, (3, 3)),
        ("slow_sigma", _F, 3),
        ("slow_time", _F, 3),
        ("push_sigma", _F, 3),
        ("push_time", _F, 3),
        ("angle_walk", _F),
        ("period", _F),
    ]
)
"""Of a vehicle: its orbit (`OrbitFrame`), the target (`rigid_body`), densities of white noise, the slow acceleration,
what stands in its place where no command is told, the gyro's angle random walk squared and its period."""

SCRATCH = np.dtype(
    [
        ("phi", _F, (MOTION, MOTION)),
        ("q", _F, (MOTION, MOTION)),
        ("effect", _F, MOTION),
        ("work", _F, (MOTION, MOTION)),
        ("nodes", _F, (NODES, MOTION, MOTION)),
        ("turn", _F, (ROTATION, ROTATION)),
        ("spread", _F, (ROTATION, ROTATION)),
        ("steps", _F, (50, ROTATION)),
        ("fade", _F, (3, 3)),
        ("drift", _F, (3, 3)),
        ("push_fade", _F, (3, 3)),
        ("push_drift", _F, (3, 3)),
        ("told", _F, 3),
        ("acceleration", _F, 3),
        ("pushed", _F, 3),
        ("extra", _F, 3),
        ("slope", _F, 3),
        ("whole", _F, 3),
        ("driven", _F, (3, 9)),
        ("along", _F, 3),
        ("turned", _F, (3, 3)),
        ("mean", _F, (3, 3)),
        ("early", _F, (3, 3)),
        ("to_velocity", _F, (3, 3)),
        ("to_position", _F, (3, 3)),
        ("frame", _F, (3, 3)),
        ("before", _F, (3, 3)),
        ("begin", _F, (3, 3)),
        ("F", _F, (MOVING, DRIVING)),
        ("Q", _F, (MOVING, MOVING)),
        ("product", _F, (DRIVING, MOVING)),
        ("places", np.int64, (MOVING, DRIVING)),
        ("weights", _F, (MOVING, DRIVING)),
        ("counts", np.int64, MOVING),
    ]
)

_VELOCITY, _TARGET, _RATE, _CHASER = VELOCITY.start, TARGET_ATTITUDE.start, TARGET_RATE.start, CHASER_ATTITUDE.start
_GYRO, _GYRO_END = GYRO_ERRORS.start, GYRO_ERRORS.stop
_BIAS, _SLOW, _SCALE, _DIRECTION = (
    block.start for block in (GYRO_BIAS, SLOW_ACCELERATION, THRUST_SCALE, THRUST_DIRECTION)
)


@kernel
def _into_lvlh(frame: Matrix, turned: float, dcm: Matrix, out: Matrix) -> None:
    """Write frame @ dcm into out (3, 3), of the frame as it was when it stood `turned` rad short of its place."""
    for c in range(3):
        for i in range(3):
            out[i, c] = frame[i, 0] * dcm[0, c] + frame[i, 1] * dcm[1, c] + frame[i, 2] * dcm[2, c]
        x, z = out[0, c], out[2, c]
        out[0, c], out[2, c] = x - turned * z, z + turned * x  # about -y; its square is 1e-6 in the longest step


@kernel
def _push(scratch: Record, turned: float, dt: float, command: Vector, values: Vector, pushes: bool) -> None:
    """Write the acceleration in `lvlh_ccsds` into scratch, and how much further than if held it moves the chaser.

    turned: of `lvlh_ccsds` in the step, rad. Weights of `mean` have their centre in its middle, of `early` at a third.
    """
    a, pushed, extra, frame = scratch["acceleration"], scratch["pushed"], scratch["extra"], scratch["frame"]
    for i in range(3):
        a[i], extra[i] = values[_SLOW + i], 0.0
    if not pushes:
        return
    to_velocity, to_position = scratch["to_velocity"], scratch["to_position"]
    _into_lvlh(frame, turned / 2.0, scratch["mean"], to_velocity)
    _into_lvlh(frame, turned / 1.5, scratch["early"], to_position)
    _into_lvlh(frame, turned, scratch["before"], scratch["begin"])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        pushed[i] = command[i] + values[_DIRECTION + j] * command[k] - values[_DIRECTION + k] * command[j]
    for i in range(3):
        along = to_velocity[i, 0] * pushed[0] + to_velocity[i, 1] * pushed[1] + to_velocity[i, 2] * pushed[2]
        early = to_position[i, 0] * pushed[0] + to_position[i, 1] * pushed[1] + to_position[i, 2] * pushed[2]
        a[i] += (1.0 + values[_SCALE]) * along
        extra[i] = 0.5 * dt * dt * (1.0 + values[_SCALE]) * (early - along)


@kernel
def _write_push(rows: Matrix, weight: float, to_lvlh: Matrix, begin: Matrix, command: Vector, along: Vector) -> None:
    """Write into three rows of F what errors of thrusters and attitude do: weight times that to the acceleration.

    to_lvlh: mean of C_LB; begin: C_LB at the step's begin; along (3,) scratch.
    """
    for i in range(3):
        along[i] = to_lvlh[i, 0] * command[0] + to_lvlh[i, 1] * command[1] + to_lvlh[i, 2] * command[2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows[i, _SCALE] = weight * along[i]
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            rows[i, _DIRECTION + c] = weight * (to_lvlh[i, e] * command[d] - to_lvlh[i, d] * command[e])
            rows[i, _CHASER + c] = weight * (begin[j, c] * along[k] - begin[k, c] * along[j])


@kernel
def _write_transition(scratch: Record, dt: float, command: Vector, fade: Matrix, now: Matrix, pushes: bool) -> None:
    """Write F (MOVING, DRIVING) of all errors that move; now: dcm_inertial_from_chaser at the end."""
    F, before = scratch["F"], scratch["before"]
    clear(F)
    for i in range(MOTION):
        for c in range(MOTION):
            F[i, c] = scratch["phi"][i, c]
            F[_TARGET + i, _TARGET + c] = scratch["turn"][i, c]
    for i in range(3):
        F[i, _SLOW + i], F[_VELOCITY + i, _SLOW + i] = 0.5 * dt * dt, dt
        F[_SLOW + i, _SLOW + i], F[_BIAS + i, _BIAS + i] = fade[i, i], 1.0
        F[_CHASER + i, _BIAS + i] = -dt
        for c in range(3):
            F[_CHASER + i, _CHASER + c] = now[0, i] * before[0, c] + now[1, i] * before[1, c] + now[2, i] * before[2, c]
    if pushes:
        begin, along = scratch["begin"], scratch["along"]
        _write_push(F[:3], 0.5 * dt * dt, scratch["to_position"], begin, command, along)
        _write_push(F[_VELOCITY : _VELOCITY + 3], dt, scratch["to_velocity"], begin, command, along)


@kernel
def _write_noise(scratch: Record, dt: float, drift: Matrix, angle_walk: float, bias_walk: float) -> None:
    """Write Q (MOVING, MOVING)."""
    Q = scratch["Q"]
    clear(Q)
    for i in range(MOTION):
        for c in range(MOTION):
            Q[i, c] = scratch["q"][i, c]
            Q[_TARGET + i, _TARGET + c] = scratch["spread"][i, c]
    for i in range(3):
        Q[_SLOW + i, _SLOW + i] = drift[i, i]
        Q[_CHASER + i, _CHASER + i] = angle_walk * dt + bias_walk * dt * dt * dt / 3.0
        Q[_CHASER + i, _BIAS + i] = Q[_BIAS + i, _CHASER + i] = -0.5 * bias_walk * dt * dt
        Q[_BIAS + i, _BIAS + i] = bias_walk * dt


@kernel
def _add_push_noise(Q: Matrix, dt: float, drift: Matrix) -> None:
    """Add to Q what an acceleration that gains drift (3, 3) over dt, evenly, has done to motion meanwhile."""
    for i in range(3):
        gained = drift[i, i]
        Q[i, i] += gained * dt**4 / 20.0
        Q[_VELOCITY + i, _VELOCITY + i] += gained * dt**2 / 3.0
        for a, b, shared in (
            (i, _VELOCITY + i, gained * dt**3 / 8.0),
            (i, _SLOW + i, gained * dt**2 / 6.0),
            (_VELOCITY + i, _SLOW + i, gained * dt / 2.0),
        ):
            Q[a, b] += shared
            Q[b, a] += shared


@kernel
def _shared(constants: Record, scratch: Record, t: float, dt: float) -> None:
    """Write into scratch what is the same in every estimate over dt from t: the frame, and what fades."""
    lvlh_from_inertial_into(constants["orbit"], constants["axes"], t + dt, scratch["frame"])
    rate, gradient = relative_motion.frame_and_gradient(constants["orbit"], t + 0.5 * dt)
    constants["body"][ORBIT, FRAME_RATE], constants["body"][ORBIT, GRADIENT] = rate, gradient
    sigma, time, fade, drift = constants["slow_sigma"], constants["slow_time"], scratch["fade"], scratch["drift"]
    gauss_markov.propagate_into(sigma, time, dt, fade, drift)


@kernel
def _move(
    constants: Record, scratch: Record, t: float, dt: float, again: bool, fade: Matrix, values: Vector, target: Matrix
) -> bool:
    """Carry values (n,) and the target's attitude from t over dt, in place; transitions and noise into scratch.

    again: they are there of another estimate over the same step; fade (3, 3): of the slow acceleration.
    """
    phi, q, effect = scratch["phi"], scratch["q"], scratch["effect"]
    orbit, a, density = constants["orbit"], scratch["acceleration"], constants["density"]
    if again and relative_motion.depends_on_dt_alone(orbit):
        acceleration_effect_into(orbit[relative_motion.MEAN_MOTION], dt, a, effect)
    elif not relative_motion.propagate_into(
        orbit, t, dt, a, density, phi, q, effect, scratch["nodes"], scratch["work"]
    ):
        return False
    turn, spread, rate = scratch["turn"], scratch["spread"], values[_RATE : _RATE + 3]
    body, torque_density = constants["body"], constants["torque_density"]
    if not rigid_body.propagate_into(body, dt, target, rate, torque_density, turn, spread, scratch["steps"]):
        return False
    for i in range(MOTION):
        for c in range(MOTION):
            effect[i] += phi[i, c] * values[c]
    for i in range(MOTION):
        values[i] = effect[i]
    for i in range(3):
        values[i] += scratch["extra"][i]
        values[_SLOW + i] *= fade[i, i]
    return True


@entry
def settle_into(
    constants: Record,
    scratch: Record,
    t: float,
    end: float,
    samples: Matrix,
    count: int,
    command: Vector,
    walks: Vector,
    turned: float,
    held: Matrix,
    without: int,
    untold: int,
    values: Matrix,
    dcm_lvlh_from_target: Stack,
    dcm_inertial_from_chaser: Stack,
    P: Stack,
    after: Stack,
    watched: int,
    drives: Codes,
    drift_sums: Matrix,
    moved: Matrix,
    gained: Matrix,
) -> bool:
    """Carry k estimates from t to end, s: values (k, n) and attitudes (k, 3, 3) in place, P (k, n, n) into after.

    samples, count: of the gyro, as `GyroSamples`; command (3,) m/s^2, chaser axes; walks (k,): the square of what the
    gyro's bias gains in a second. turned: what a rate that is held adds to the attitude's variance, rad^2. without: the
    estimate that has no gyro, and holds the sample of held (1, 4) instead, -1 if there is none. untold: the estimate
    that is told no command, and whose slow acceleration is that of unknown thrusts, -1 if there is none. watched,
    drives: the estimate whose drifts are looked for, -1 if there is none, with sums as of `drift_sums.carry_drifts`, in
    place; moved (MOVING, m) scratch. gained: (3, n) scratch of a gyro with
    `gyro_errors`, (0, n) without. False for a step so long that nothing is known after it.
    """
    dt, before, told = end - t, scratch["before"], scratch["told"]
    _shared(constants, scratch, t, dt)
    if untold >= 0:
        sigma, time = constants["push_sigma"], constants["push_time"]
        gauss_markov.propagate_into(sigma, time, dt, scratch["push_fade"], scratch["push_drift"])
    for f in range(values.shape[0]):
        now = dcm_inertial_from_chaser[f]
        for i in range(3):
            for c in range(3):
                before[i, c] = now[i, c]
        for i in range(3):
            told[i] = 0.0 if f == untold else command[i]
        pushes = told[0] != 0.0 or told[1] != 0.0 or told[2] != 0.0
        bias, period = values[f, _BIAS : _BIAS + 3], constants["period"]
        is_off = len(gained) > 0 and f != without
        errors = values[f, _GYRO : (_GYRO_END if is_off else _GYRO)]
        if f == without:
            turn_through(held, 1, period, t, end, bias, errors, now, pushes, scratch)
        else:
            turn_through(samples, count, period, t, end, bias, errors, now, pushes, scratch)
        fade, drift = scratch["fade"], scratch["drift"]
        if f == untold:
            fade, drift = scratch["push_fade"], scratch["push_drift"]
        _push(scratch, constants["body"][ORBIT, FRAME_RATE] * dt, dt, told, values[f], pushes)
        if not _move(constants, scratch, t, dt, f > 0, fade, values[f], dcm_lvlh_from_target[f]):
            return False
        _write_transition(scratch, dt, told, fade, now, pushes)
        _write_noise(scratch, dt, drift, constants["angle_walk"], walks[f])
        if turned > 0.0 and f != without:
            for i in range(_CHASER, _CHASER + 3):
                scratch["Q"][i, i] += turned
        if f == untold:
            _add_push_noise(scratch["Q"], dt, drift)
        F, Q, product, places = scratch["F"], scratch["Q"], scratch["product"], scratch["places"]
        carry_into(P[f], F, Q, after[f], product, places, scratch["weights"], scratch["counts"])
        if f == watched:
            carry_drifts(drift_sums, dt, drives, places, scratch["weights"], scratch["counts"], moved)
        if is_off:
            driven_into(scratch["whole"], scratch["driven"])
            drive_attitude(after[f], scratch["driven"], gained)
            if f == watched:
                drive_sensitivities(drift_sums, scratch["driven"])
    return True
