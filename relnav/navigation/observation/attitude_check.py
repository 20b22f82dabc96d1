"""Whether an image looks as the stated attitude of the camera says it should, from where the filter believes to be.

A fix does not depend on the attitude, so that an attitude that is wrong, or a target that turns, goes unseen: the track
then follows a frame that turns with the target. Here the spots of A, B and C are predicted from the updated state, and
two things are compared that the fix has not used: where the three lie in the image in the mean, and how the line from B
to A lies.
"""

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.estimation.rows import pair_covariance
from relnav.navigation.memory import FIX, Memory
from relnav.navigation.observation.beacon_geometry import see_beacon
from relnav.navigation.observation.beacon_monitors import gather_attitude


@kernel
def _roll_is_credible(sensor: Record, spots: Matrix, predicted: Matrix, noise: float, limit: float) -> bool:
    """Whether the line from B to A lies in the image as predicted; noise: variance of a spot's coordinate."""
    x, y = predicted[0, 0] - predicted[1, 0], predicted[0, 1] - predicted[1, 1]
    across = x * (spots[0, 1] - spots[1, 1]) - y * (spots[0, 0] - spots[1, 0])
    length2 = x * x + y * y
    variance = 2.0 * noise / length2 + sensor["attitude_sigma"] ** 2
    credible: bool = across * across <= limit * variance * length2 * length2
    return credible


@kernel
def _hand_over(
    m: Memory,
    residual: Vector,
    variance: Vector,
    xx: float,
    yy: float,
    predicted: Matrix,
    spots: Matrix,
    noise: float,
    tells: bool,
) -> None:
    """Let the monitors have what the image says of the attitude; variance (2,): of noise and attitude, xx and yy whole.

    What lasts in it besides the attitude's error: mountings, and places of beacons, that seem to turn the target.
    """
    sensor, t, numbers = m.sensor, m.tolerances, m.scratch["triads"]
    value, own, state, lasting = numbers[0], numbers[1], numbers[2], numbers[3]
    a, b, stated = sensor["half_spacing"], sensor["c_distance"], sensor["attitude_sigma"] ** 2
    placed = t["beacon_placement"] ** 2
    turn = stated + t["camera_mounting"] ** 2 + t["beacon_mounting"] ** 2
    turn_across = turn + 1.5 * placed / (b * b)
    x, y = predicted[0, 0] - predicted[1, 0], predicted[0, 1] - predicted[1, 1]
    across = x * (spots[0, 1] - spots[1, 1]) - y * (spots[0, 0] - spots[1, 0])
    f2, length2, fresh = sensor["focal_length"] ** 2, x * x + y * y, sensor["attitude_noise"] ** 2
    whole = xx, yy
    for k in range(2):
        value[k], state[k] = residual[k], whole[k] - variance[k]
        own[k] = noise / 3.0 + fresh * f2
        lasting[k] = max(0.0, variance[k] - noise / 3.0) + (turn_across - stated) * f2
    value[2], own[2], state[2] = across / length2, 2.0 * noise / length2 + fresh, 0.0
    lasting[2] = turn + 0.5 * placed / (a * a)
    gather_attitude(m, value, own, state, lasting, predicted, tells)


@kernel
def attitude_is_credible(m: Memory, track: Record, spots: Matrix, tells: bool) -> bool:
    """Whether the image (n, 2) m agrees with the stated attitude, at the gate's probability.

    True where none is stated, or the image tells nothing.

    The mean of the three residuals has the covariance H P H^T + R + sigma^2 E E^T, E = d(spot) / d(small turn of the
    camera): the state's error and the spots' are nearly independent, because the spots' mean says nothing of a fix.
    """
    sensor = m.sensor
    if sensor["method"] != FIX or sensor["attitude_known"] == 0:
        return True
    predicted, numbers, rows = m.scratch["three"], m.scratch["columns"], m.scratch["six"]
    residual, variance, one = numbers[0], numbers[1], numbers[2]
    gradient, own_gradient = rows[0:2], rows[2:4]
    f, noise, u, v = sensor["focal_length"], 0.0, 0.0, 0.0
    for k in range(2):
        residual[k], variance[k] = 0.0, 0.0
        for j in range(3):
            gradient[k, j] = 0.0
    for i in range(3):
        beacon = m.beacons[i]
        see_beacon(track["state"], m.kept["mount"], beacon["position"], f, spots[i], one, own_gradient)
        for k in range(2):
            residual[k] += one[k] / 3.0
            predicted[i, k] = spots[i, k] - one[k]
            own = beacon["spot_sigma"][k] ** 2 + beacon["lasting_sigma"] ** 2
            variance[k] += own / 9.0
            noise += own / 6.0
            for j in range(3):
                gradient[k, j] += own_gradient[k, j] / 3.0
        u, v = u + predicted[i, 0] / 3.0, v + predicted[i, 1] / 3.0
    turn = sensor["attitude_sigma"] ** 2  # E = ((-u v / f, f + u^2 / f, -v), (-f - v^2 / f, u v / f, u))
    variance[0] += turn * ((u * v / f) ** 2 + (f + u * u / f) ** 2 + v * v)
    variance[1] += turn * ((f + v * v / f) ** 2 + (u * v / f) ** 2 + u * u)
    both = turn * u * v * (1.0 + (u * u + v * v) / (f * f))
    xx, xy, yy = pair_covariance(track["ld"], gradient, variance, both)
    _hand_over(m, residual, variance, xx, yy, predicted, spots, noise, tells)
    x, y = residual[0], residual[1]
    lies: bool = x * x * yy - 2.0 * x * y * xy + y * y * xx <= m.gate[1] * (xx * yy - xy * xy)
    return (lies & _roll_is_credible(sensor, spots, predicted, noise, m.gate[0])) | (not tells)
