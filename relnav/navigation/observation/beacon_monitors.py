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
from relnav.codegen.together import anywhere, held, select
from relnav.dynamics.error_state import MOTION
from relnav.estimation.clock_monitor import doubt_clock, is_doubtful, learn_step, weigh_jump
from relnav.estimation.lasting_change import lasting_change, learn_lasting
from relnav.estimation.monitors import (
    AWAY_S,
    STUCK,
    note_image,
    note_step,
    watch_image,
    watch_start,
)
from relnav.estimation.refusals import BAD_IMAGES, BAD_SPOTS, count_refusals, forget_refusals
from relnav.estimation.repeated_reading import LEAST_MOTION, repeats
from relnav.estimation.returning import LONG_S, note_pair, returns_wrong
from relnav.estimation.rows import own_variance
from relnav.estimation.watched_means import follow, newest_share
from relnav.navigation.memory import Memory
from relnav.navigation.observation.beacon_considered import shared_errors
from relnav.navigation.observation.beacon_geometry import see_beacon, uses_coordinates
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, UPDATED

EDGE_SIGMAS = 2.0
"""So far from the edge noise cut off there moves a mean by 0.06 sigma."""


@kernel
def _write_row(
    m: Memory, group: Record, k: int, residual: float, noise: float, lasting: float, h: Vector, seen: bool
) -> None:
    """Hand over a row, where it is seen."""
    x, unseen, taken = m.track["state"], m.fixed["unseen"], 0.0
    if m.watch["doubted"] > 0.0:
        for j in range(MOTION):
            taken += h[j] * (x[j] - unseen[j])
    group["value"][k] = select(seen, residual, group["value"][k])
    group["noise"][k] = select(seen, noise, group["noise"][k])
    group["lasting"][k] = select(seen, lasting, group["lasting"][k])
    group["taken"][k] = select(seen, taken, group["taken"][k])
    group["state"][k] = select(seen, own_variance(m.track["ld"], h, h), group["state"][k])
    motion = -(h[0] * x[3] + h[1] * x[4] + h[2] * x[5])
    group["motion"][k] = select(seen, motion, group["motion"][k])


@kernel
def _write_lasting(m: Memory, row: int, h: Vector, first: int, last: int, seen: bool) -> None:
    """Write what lasting errors show in a row, where it is seen.

    first, last: rows of errors whose share that the state has taken up is not in `by_error` any more.
    """
    now = m.lasting_now[row]
    for c in range(now.shape[0]):
        shown = m.by_error[row, c]
        if c < first or c >= last:
            s, taken = m.sensitivities[c], 0.0
            for j in range(s.shape[0]):
                taken += h[j] * s[j]
            shown -= taken
        now[c] = select(seen, shown, now[c])


@kernel
def show_nothing(m: Memory) -> None:
    """Take away the rows of the image before: this one may show none."""
    for i in range(m.watched.shape[0]):
        m.watched[i]["seen"] = 0


@kernel
def gather_rows(m: Memory, track: Record, spots: Matrix, tells: bool) -> None:
    """Hand over the rows of an image that tells something, as they stand at the prediction."""
    half, unseen = m.sensor["half_width"], m.fixed["unseen"]
    if m.watch["doubted"] == 0.0 or is_doubtful(m.watch, m.step["dt"]):
        for j in range(MOTION):
            unseen[j] = select(tells, track["state"][j], unseen[j])
    if not uses_coordinates(m.sensor):
        group, source = m.watched[0], m.groups[0]
        seen = source["variance"][2] > 0.0
        group["rows"], group["seen"], m.watched[1]["seen"] = 3, select(seen, 1, 0), 0
        if anywhere(seen):
            seen = held(seen)
            for k in range(3):
                h = source["gradient"][k]
                _write_row(m, group, k, source["residual"][k], source["variance"][k], 0.0, h, seen)
        return
    turned = m.sensor["attitude_noise"] ** 2
    first, last = shared_errors(m)
    calm, share = m.watch["on"] == 0, newest_share(m.step["dt"])
    for i in range(m.groups.shape[0]):
        group, source, own = m.watched[i], m.groups[i], m.beacons[i]["spot_sigma"]
        residual, variance = source["residual"], source["variance"]
        seen = (variance[0] > 0.0) & (variance[1] > 0.0)
        group["rows"], group["seen"] = 2, select(seen, 1, 0)
        if not anywhere(seen):
            continue
        seen = held(seen)
        for k in range(2):
            h, noise = source["gradient"][k], own[k] * own[k]
            if turned > 0.0:
                turn = m.turns[2 * i + k]
                noise += turned * (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
            _write_row(m, group, k, residual[k], noise, max(0.0, variance[k] - noise), h, seen)
            _write_lasting(m, 2 * i + k, h, first, last, seen)
            row = 2 * i + k
            changed, moved = lasting_change(m.lasting_now[row], m.lasting_usual[row], m.lasting_fast[row])
            group["moved"][k] = select(seen, moved, group["moved"][k])
            if anywhere(calm):  # while an alarm lasts it is held: what follows is not to explain what was found
                changed = select(group["learnt"] > 0, changed, 0.0)
                group["changed"][k] = select(calm & seen, changed, group["changed"][k])
            expected = spots[i, k] - residual[k] + follow(group, k, share, seen)
            near_edge = seen & (abs(expected) > half[k] - EDGE_SIGMAS * own[k])
            if anywhere(near_edge):
                m.watch["pause"] = select(near_edge, AWAY_S, m.watch["pause"])
        note_pair(m.returning[i], m.track["ld"], source["gradient"], variance, 0.0, residual, seen)


@kernel
def _note_return(m: Memory, i: int, seen: bool, used: bool, refused: bool, dt: float) -> None:
    """Say SHIFTED of a spot that was refused for long and is used though it surprises, until it is refused again.

    The state takes up what is wrong with it, so that innovations which are quiet again say nothing.
    """
    if returns_wrong(m.returning[i], seen & used, seen & refused, dt):
        m.watch["returned"], m.watch["on"] = i + 1, 1
    elif seen & (m.watch["returned"] == i + 1) & (m.returning[i]["refused"] > LONG_S):
        m.watch["returned"] = 0
    if seen & (m.watch["returned"] > 0):
        m.watch["quiet"] = 0.0


@kernel
def gather_attitude(
    m: Memory, value: Vector, noise: Vector, state: Vector, lasting: Vector, predicted: Matrix, tells: bool
) -> None:
    """Hand over what an image says of the stated attitude: where it lies and its roll, (3,); predicted spots (3, 2)."""
    group, half, share = m.watched[1], m.sensor["half_width"], newest_share(m.step["dt"])
    group["rows"], group["seen"] = 3, select(tells, 1, 0)
    for k in range(3):
        group["motion"][k], group["taken"][k] = 0.0, 0.0
        group["value"][k] = select(tells, value[k], group["value"][k])
        group["noise"][k] = select(tells, noise[k], group["noise"][k])
        group["state"][k] = select(tells, state[k], group["state"][k])
        group["lasting"][k] = select(tells, lasting[k], group["lasting"][k])
    for k in range(2):
        offset = follow(group, k, share, tells)
        for i in range(3):
            expected = predicted[i, k] + offset
            near_edge = tells & (abs(expected) > half[k] - EDGE_SIGMAS * m.beacons[i]["spot_sigma"][k])
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
def _count_refusals(m: Memory, status: int) -> None:
    """Count what of an image a gate refuses: a fix as a whole; of spots those that have not been refused for long.

    Spots that lie off the detector, or explain no position, are not a gate's.
    """
    since, whole = m.watch["since"], status == REJECTED
    seen = (status == UPDATED) | (status == PARTIAL) | whole
    if not uses_coordinates(m.sensor):
        seen = seen & (m.watched[0]["seen"] > 0)
        count_refusals(m.watch, since, select(whole, 1.0, 0.0), 1.0, BAD_IMAGES, seen)
        return
    spots, refused = 0.0, 0.0
    for i in range(m.groups.shape[0]):
        counts = (m.watched[i]["seen"] > 0) & (m.returning[i]["refused"] <= LONG_S)
        bad = counts & (whole | (m.groups[i]["tested"] == 0))
        spots, refused = select(counts, spots + 1.0, spots), select(bad, refused + 1.0, refused)
    seen, spots = seen & (spots > 0.0), max(spots, 1.0)
    count_refusals(m.watch, since, refused / spots, spots, BAD_SPOTS, seen)


@kernel
def watch(m: Memory, spots: Matrix, dt: float, status: int) -> None:
    """Take an image (n, 2) m that the running track was updated with, or not, into the monitors."""
    stuck, groups = False, m.watched
    if is_doubtful(m.watch, dt):  # an epoch that nothing was used of stands at its prediction
        taken, unseen = (status == UPDATED) | (status == PARTIAL), m.fixed["unseen"]
        for j in range(MOTION):
            unseen[j] = select(taken, unseen[j], m.track["state"][j])
    note_step(m.watch, dt)
    _count_refusals(m, status)
    note_image(m.watch, status != PREDICTED)
    doubt_clock(m.watch, dt, m.track["state"], m.track["ld"])
    learn_step(m.watch, dt)
    weigh_jump(m.watch, groups)
    coordinates = uses_coordinates(m.sensor)
    for i in range(groups.shape[0]):
        used, seen = (status == UPDATED) | (status == PARTIAL), groups[i]["seen"] > 0
        if coordinates:
            used = used & (m.groups[i]["tested"] > 0)
            if anywhere(seen):
                _note_return(m, i, seen, used, (status == PARTIAL) & (not used), dt)
        elif i > 1:
            seen = False
        groups[i]["seen"] = select(used & seen, 1, 0)
        if _is_stuck(m, i, spots, dt):
            stuck = True
            m.watch["pulled"] = 1 if used else m.watch["pulled"]
    watch_image(m.watch, groups, dt)
    if coordinates:
        learn_lasting(m.watched, m.lasting_now, m.lasting_usual, m.lasting_fast)
    if m.watch["pulled"] > 0 and not stuck:  # it is over, and has pulled the state away
        m.watch["restart"] = 1
    if stuck or m.watch["pulled"] > 0:
        m.watch["alarm"] |= STUCK


@kernel
def watch_new_track(m: Memory, again: bool) -> None:
    """A track has started; again: it replaced one."""
    for i in range(m.returning.shape[0]):
        m.returning[i]["refused"] = 0.0
    if not again:
        forget_refusals(m.watch)
    watch_start(m.watch, m.watched, again, not uses_coordinates(m.sensor))
