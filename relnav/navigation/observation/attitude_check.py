"""Whether an image looks as the stated attitude of the camera says it should, from where the filter believes to be.

A fix does not depend on the attitude, so that an attitude that is wrong, or a target that turns, goes unseen: the track
then follows a frame that turns with the target. Here the spots of A, B and C are predicted from the updated state, and
three numbers are compared that the fix has not used: where the three lie in the image in the mean, x and y, and how the
line from B to A lies. Residuals of these have the covariance

    H P H^T + R + (s^2 + n^2) E E^T + (D - H S) (D - H S)^T

with E what a turn of the camera does to them, s the stated attitude's sigma and n that of its noise, D what one sigma
of each considered error does to them and S what it does to the state (`beacon_considered.py`). The state's error and
the spots' are nearly independent, because the spots' mean says nothing of a fix. How the line lies hardly depends on
the place: there H P H^T is left out.
"""

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.dynamics.error_state import MOTION
from relnav.estimation.rows import pair_covariance
from relnav.navigation.blocks import FIELD_ERRORS
from relnav.navigation.memory import FIX, Memory
from relnav.navigation.observation.beacon_geometry import see_beacon
from relnav.navigation.observation.beacon_lasting_errors import TOLERANCES, errors_of_spot
from relnav.navigation.observation.beacon_monitors import gather_attitude

X, Y, ROLL = 0, 1, 2


@kernel
def _look(m: Memory, x: Vector, spots: Matrix, residual: Vector, rows: Matrix, predicted: Matrix) -> float:
    """Write residuals (3,), the mean's rows (2, 6), predicted spots (3, 2); returns 1 / the line's squared length."""
    gradients, one, f = m.scratch["six"], m.scratch["vectors"][0], m.sensor["focal_length"]
    for k in range(2):
        residual[k] = 0.0
        for j in range(MOTION):
            rows[k, j] = 0.0
    for i in range(3):
        own = gradients[2 * i : 2 * i + 2]
        see_beacon(x, m.kept["mount"], m.beacons[i]["position"], f, spots[i], one, own)
        for k in range(2):
            residual[k] += one[k] / 3.0
            predicted[i, k] = spots[i, k] - one[k]
            for j in range(3):
                rows[k, j] += own[k, j] / 3.0
    u, v = predicted[0, 0] - predicted[1, 0], predicted[0, 1] - predicted[1, 1]
    shorter: float = 1.0 / (u * u + v * v)
    residual[ROLL] = (u * (spots[0, 1] - spots[1, 1]) - v * (spots[0, 0] - spots[1, 0])) * shorter
    return shorter


@kernel
def _add_shown(
    m: Memory,
    x: Vector,
    sensitivities: Matrix,
    spots: Matrix,
    rows: Matrix,
    predicted: Matrix,
    lasting: Vector,
    fresh: Vector,
) -> float:
    """Add what considered errors, the attitude's apart, and its noise do: variances (3,); returns that of x and y both.

    rows (3, 6) and predicted spots (3, 2) as `_look` left them at the state x; the line's row is written here.
    """
    gradients = m.scratch["six"]
    errors, turns, both, noise = m.by_error, m.turns, 0.0, m.sensor["attitude_noise"]
    u, v, one = predicted[0, 0] - predicted[1, 0], predicted[0, 1] - predicted[1, 1], m.scratch["vectors"][3]
    length2 = u * u + v * v
    for j in range(3):
        rows[ROLL, j] = (u * (gradients[1, j] - gradients[3, j]) - v * (gradients[0, j] - gradients[2, j])) / length2
    for i in range(3):
        errors_of_spot(m, x, i, spots[i], gradients[2 * i : 2 * i + 2], errors[2 * i], errors[2 * i + 1])
    for j in range(sensitivities.shape[0]):
        error, s = m.fixed["first_error"] + j, sensitivities[j]
        if FIELD_ERRORS <= error < TOLERANCES:
            continue
        one[X] = (errors[0, j] + errors[2, j] + errors[4, j]) / 3.0
        one[Y] = (errors[1, j] + errors[3, j] + errors[5, j]) / 3.0
        one[ROLL] = (u * (errors[1, j] - errors[3, j]) - v * (errors[0, j] - errors[2, j])) / length2
        for k in range(3):
            one[k] -= rows[k, 0] * s[0] + rows[k, 1] * s[1] + rows[k, 2] * s[2]
            lasting[k] += one[k] * one[k]
        both += one[X] * one[Y]
    for j in range(3):
        one[X] = noise * (turns[0, j] + turns[2, j] + turns[4, j]) / 3.0
        one[Y] = noise * (turns[1, j] + turns[3, j] + turns[5, j]) / 3.0
        one[ROLL] = noise * (u * (turns[1, j] - turns[3, j]) - v * (turns[0, j] - turns[2, j])) / length2
        for k in range(3):
            fresh[k] += one[k] * one[k]
        both += one[X] * one[Y]
    return both


@kernel
def attitude_is_credible(m: Memory, track: Record, sensitivities: Matrix, spots: Matrix, tells: bool) -> bool:
    """Whether the image (n, 2) m agrees with the stated attitude, at the gate's probability.

    True where none is stated, or the image tells nothing. sensitivities (m, 6) as predicted.
    """
    sensor, numbers, x, ld = m.sensor, m.scratch["triads"], track["state"], track["ld"]
    if sensor["method"] != FIX or sensor["attitude_known"] == 0:
        return True
    residual, variance, own, state, lasting, fresh = (
        numbers[0],
        numbers[1],
        numbers[2],
        numbers[3],
        numbers[4],
        numbers[5],
    )
    predicted, rows = m.scratch["three"], m.scratch["numbers"]
    shorter = _look(m, x, spots, residual, rows, predicted)
    noise, spread, u, v = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        variance[k], lasting[k], fresh[k] = 0.0, 0.0, 0.0
    for i in range(3):
        beacon = m.beacons[i]
        for k in range(2):
            new = beacon["spot_sigma"][k] ** 2
            variance[k] += new / 9.0
            noise += new / 6.0
        spread += beacon["lasting_sigma"] ** 2 / 3.0
        u, v = u + predicted[i, 0] / 3.0, v + predicted[i, 1] / 3.0
    f, turn = sensor["focal_length"], sensor["attitude_sigma"] ** 2
    # E = ((-u v / f, f + u^2 / f, -v), (-f - v^2 / f, u v / f, u)), of the line's roll (0, 0, 1)
    variance[X] += turn * ((u * v / f) ** 2 + (f + u * u / f) ** 2 + v * v)
    variance[Y] += turn * ((f + v * v / f) ** 2 + (u * v / f) ** 2 + u * u)
    variance[ROLL] = 2.0 * noise * shorter + turn
    both = turn * u * v * (1.0 + (u * u + v * v) / (f * f))
    first, last = m.fixed["first_error"], m.fixed["first_error"] + sensitivities.shape[0]
    if first < FIELD_ERRORS or last > TOLERANCES or sensor["attitude_noise"] > 0.0:
        both += _add_shown(m, x, sensitivities, spots, rows, predicted, lasting, fresh)
    for k in range(3):
        share = 1.0 / 3.0 if k < ROLL else 2.0 * shorter
        own[k] = (noise + spread) * share + fresh[k]  # monitors take what lasts in single spots for noise
        shown = lasting[k] + fresh[k]
        lasting[k] += max(0.0, variance[k] - noise * share)
        variance[k] += shown
    xx, xy, yy = pair_covariance(ld, rows, variance, both)
    state[X], state[Y], state[ROLL] = xx - variance[X], yy - variance[Y], 0.0
    gather_attitude(m, residual, own, state, lasting, predicted, tells)
    x_off, y_off, roll = residual[X], residual[Y], residual[ROLL]
    lies: bool = x_off * x_off * yy - 2.0 * x_off * y_off * xy + y_off * y_off * xx <= m.gate[1] * (xx * yy - xy * xy)
    rolled: bool = roll * roll <= m.gate[0] * variance[ROLL]
    return (lies & rolled) | (not tells)
