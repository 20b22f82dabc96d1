"""What of an image of the beacons is watched (`estimation/monitors.py`): rows, and what may be in them.

`spots`: the two coordinates of every spot, a group a beacon. `fix` and invariants: their three independent rows are one
group, and where the attitude is stated what the image says of it is another: three spots are six numbers, of which a
fix leaves three, where the image lies, two, and its roll (`attitude_check.py`). That is the residual of the triangle's
shape: with three beacons and an attitude there is no other, and a beacon that is displaced seems to turn the target.

While a spot is near the detector's edge nothing is watched: it is seen only where its noise is inward, so that its mean
is not its place, and what the others say depends on how often it is seen.
"""

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.codegen.together import anywhere, select
from relnav.dynamics.error_state import MOTION
from relnav.estimation.clock_monitor import doubt_clock, is_doubtful, weigh_jump
from relnav.estimation.monitors import (
    AWAY_S,
    STUCK,
    note_step,
    watch_image,
    watch_start,
)
from relnav.estimation.repeated_reading import LEAST_MOTION, repeats
from relnav.estimation.returning import LONG_S, note_pair, returns_wrong
from relnav.estimation.rows import own_variance
from relnav.estimation.watched_means import follow
from relnav.navigation.memory import Memory
from relnav.navigation.observation.beacon_considered import shared_errors
from relnav.navigation.observation.beacon_geometry import see_beacon, uses_coordinates
from relnav.navigation.observation.beacon_lasting_change import lasting_change, learn_lasting
from relnav.navigation.status import PARTIAL, UPDATED

EDGE_SIGMAS = 2.0
"""So far from the edge noise cut off there moves a mean by 0.06 sigma."""


@kernel
def _write_row(m: Memory, group: Record, k: int, residual: float, noise: float, lasting: float, h: Vector) -> None:
    x, unseen, taken = m.track["state"], m.fixed["unseen"], 0.0
    if m.watch["doubted"] > 0.0:
        for j in range(MOTION):
            taken += h[j] * (x[j] - unseen[j])
    group["value"][k], group["noise"][k], group["lasting"][k], group["taken"][k] = residual, noise, lasting, taken
    group["state"][k] = own_variance(m.track["ld"], h, h)
    group["motion"][k] = -(h[0] * x[3] + h[1] * x[4] + h[2] * x[5])


@kernel
def gather_rows(m: Memory, track: Record, spots: Matrix) -> None:
    """Hand over the rows of an image as they stand at the prediction."""
    half, unseen = m.sensor["half_width"], m.fixed["unseen"]
    if m.watch["doubted"] == 0.0 or is_doubtful(m.watch, m.step["dt"]):
        for j in range(MOTION):
            unseen[j] = track["state"][j]
    if not uses_coordinates(m.sensor):
        group, source = m.watched[0], m.groups[0]
        group["rows"], group["seen"], m.watched[1]["seen"] = 3, 1 if source["variance"][2] > 0.0 else 0, 0
        if group["seen"] > 0:
            for k in range(3):
                h = source["gradient"][k]
                _write_row(m, group, k, source["residual"][k], source["variance"][k], 0.0, h)
        return
    turned = m.sensor["attitude_noise"] ** 2
    first, last = shared_errors(m)
    calm = m.watch["on"] == 0
    for i in range(m.groups.shape[0]):
        group, source, own = m.watched[i], m.groups[i], m.beacons[i]["spot_sigma"]
        residual, variance = source["residual"], source["variance"]
        group["rows"], group["seen"] = 2, 1 if variance[0] > 0.0 and variance[1] > 0.0 else 0
        if group["seen"] == 0:
            continue
        for k in range(2):
            h, noise = source["gradient"][k], own[k] * own[k]
            if turned > 0.0:
                turn = m.turns[2 * i + k]
                noise += turned * (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
            _write_row(m, group, k, residual[k], noise, max(0.0, variance[k] - noise), h)
            changed = lasting_change(m, 2 * i + k, h, first, last)
            if anywhere(calm):  # while an alarm lasts it is held: what follows is not to explain what was found
                changed = select(group["learnt"] > 0, changed, 0.0)
                group["changed"][k] = select(calm, changed, group["changed"][k])
            expected = spots[i, k] - residual[k] + follow(group, k, m.step["dt"])
            near_edge = abs(expected) > half[k] - EDGE_SIGMAS * own[k]
            if anywhere(near_edge):
                m.watch["pause"] = select(near_edge, AWAY_S, m.watch["pause"])
        note_pair(m.returning[i], m.track["ld"], source["gradient"], variance, 0.0, residual)


@kernel
def _note_return(m: Memory, i: int, used: bool, refused: bool, dt: float) -> None:
    """Say SHIFTED of a spot that was refused for long and is used though it surprises, until it is refused again.

    The state takes up what is wrong with it, so that innovations which are quiet again say nothing.
    """
    if returns_wrong(m.returning[i], used, refused, dt):
        m.watch["returned"], m.watch["on"] = i + 1, 1
    elif m.watch["returned"] == i + 1 and m.returning[i]["refused"] > LONG_S:
        m.watch["returned"] = 0
    if m.watch["returned"] > 0:
        m.watch["quiet"] = 0.0


@kernel
def gather_attitude(m: Memory, value: Vector, noise: Vector, state: Vector, lasting: Vector, predicted: Matrix) -> None:
    """Hand over what an image says of the stated attitude: where it lies and its roll, (3,); predicted spots (3, 2)."""
    group, half = m.watched[1], m.sensor["half_width"]
    group["rows"], group["seen"] = 3, 1
    for k in range(3):
        group["value"][k], group["noise"][k], group["motion"][k], group["taken"][k] = value[k], noise[k], 0.0, 0.0
        group["state"][k], group["lasting"][k] = state[k], lasting[k]
    for k in range(2):
        offset = follow(group, k, m.step["dt"])
        for i in range(3):
            expected = predicted[i, k] + offset
            near_edge = abs(expected) > half[k] - EDGE_SIGMAS * m.beacons[i]["spot_sigma"][k]
            if anywhere(near_edge):
                m.watch["pause"] = select(near_edge, AWAY_S, m.watch["pause"])


@kernel
def _is_stuck(m: Memory, i: int, spots: Matrix, dt: float) -> bool:
    """Whether the spot of a beacon has not moved although the predicted one has, at all: by a tenth of its noise.

    Noise alone never repeats a reading; a log without noise may, of a spot that does not move.
    """
    group, x = m.watched[i], m.track["state"]
    if not repeats(group, spots[i, 0], spots[i, 1], dt):
        return False
    h, residual, rate2 = m.scratch["six"], m.scratch["vectors"][0], 0.0
    focal_length, position = m.sensor["focal_length"], m.beacons[i]["position"]
    see_beacon(x, m.kept["mount"], position, focal_length, spots[i], residual, h)
    for k in range(2):
        rate2 += (h[k, 0] * x[3] + h[k, 1] * x[4] + h[k, 2] * x[5]) ** 2
    return bool(rate2 * group["since"] ** 2 > (LEAST_MOTION * m.beacons[i]["spot_sigma"][0]) ** 2)


@kernel
def watch(m: Memory, spots: Matrix, dt: float, status: int) -> None:
    """Take an image (n, 2) m that the running track was updated with, or not, into the monitors."""
    stuck, groups = False, m.watched
    note_step(m.watch, dt)
    doubt_clock(m.watch, dt, m.track["state"], m.track["ld"])
    weigh_jump(m.watch, groups)
    coordinates = uses_coordinates(m.sensor)
    for i in range(groups.shape[0]):
        used = status == UPDATED or (status == PARTIAL and (not coordinates or m.groups[i]["tested"] > 0))
        if coordinates and groups[i]["seen"] > 0:
            _note_return(m, i, used, status == PARTIAL and not used, dt)
        if not used or (not coordinates and i > 1):
            groups[i]["seen"] = 0
        if _is_stuck(m, i, spots, dt):
            stuck = True
            m.watch["pulled"] = 1 if used else m.watch["pulled"]
    watch_image(m.watch, groups, dt)
    if coordinates:
        learn_lasting(m)
    if m.watch["pulled"] > 0 and not stuck:  # it is over, and has pulled the state away
        m.watch["restart"] = 1
    if stuck or m.watch["pulled"] > 0:
        m.watch["alarm"] |= STUCK


@kernel
def watch_new_track(m: Memory, again: bool) -> None:
    """A track has started; again: it replaced one."""
    for i in range(m.returning.shape[0]):
        m.returning[i]["refused"] = 0.0
    watch_start(m.watch, m.watched, again, not uses_coordinates(m.sensor))
