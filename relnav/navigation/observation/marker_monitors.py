"""What of an image of markers is watched (`estimation/monitors.py`).

Each spot against the mean of the others is a group of two rows, and the mean of all is another: what turns the camera
is in the mean alone, and little of what the state does not know is in the differences. They are those of the leading
hypothesis; rivals that are taken up beside it change nothing. While it is so wide that it may cover other roots, what
is usual is learnt anew, as after three seconds without an image that was used. Two more things are said as SHIFTED.
Another hypothesis has taken the lead from one that was long settled, by odds that are not ambiguous any more: what is
wrong has made another root the better one. And a spot that was refused for long, others being used, is used again
though it surprises, or lies to the side where it lay: not the spot has come back, the gate has grown. When a fault is
over `marker_witness.py` says.
"""

import math

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import kernel
from relnav.dynamics.error_state import THETA
from relnav.dynamics.rigid_body import FRAME_RATE, ORBIT
from relnav.estimation.clock_monitor import learn_step
from relnav.estimation.lasting_change import lasting_change, learn_lasting
from relnav.estimation.monitors import (
    AWAY_S,
    JUMP_S,
    STUCK,
    WARM_S,
    note_image,
    note_step,
    watch_image,
    watch_start,
    write_alarm,
)
from relnav.estimation.repeated_reading import LEAST_MOTION, repeats
from relnav.estimation.returning import note_pair, returns_wrong
from relnav.estimation.rows import pair_covariance
from relnav.navigation.observation.marker_rows import has_spot, new_noise
from relnav.navigation.observation.marker_witness import ask_witness, call_witness, remember
from relnav.navigation.pose_epoch import odds_of
from relnav.navigation.pose_memory import NEWEST, OLDER, WITNESS, PoseMemory
from relnav.navigation.pose_propagation import advance_pose, carry_sensitivities
from relnav.navigation.propagation import carry_state_eccentric
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT

BENDS = 0.5
"""Of ln |R| by the second order: the leader then may cover roots that it cannot tell apart."""
USURPED_S = 1.0
LONGEST_JUMP_S = 10.0
"""Of a clock, that is told from a gap by what spots show; after a longer step the state is no longer known so well."""


@kernel
def _note_spots(m: PoseMemory, lead: Record, count: int) -> None:
    """Note how fast each spot is to move and, of one that was refused for long, how surprising it is."""
    v, rate, dcm, mean_motion = lead["motion"], lead["rate"], lead["dcm"], m.body["values"][ORBIT, FRAME_RATE]
    for g in range(count):
        source, spot = m.groups[g], m.spots[int(m.which[g])]
        speed = m.scratch["error"]
        for k in range(2):
            h, speed[k] = source["gradient"][k], 0.0
            for j in range(3):  # the orbit turns by -n about y
                speed[k] += h[j] * v[3 + j] + h[THETA + j] * (rate[j] + mean_motion * dcm[1, j])
            source["innovation"][k] = speed[k]
        spot["speed"] = math.hypot(speed[0], speed[1])
        covariance = m.noise[2 * g, 2 * g + 1]
        note_pair(spot, lead["ld"], source["gradient"], source["variance"], covariance, source["residual"], True)


@kernel
def _add_up(m: PoseMemory, k: int, count: int, sums: Vector, gradient: Vector, covariances: Stack) -> None:
    """Write sums (4,) over the spots in use of axis k: values, motions, new noise, all noise; gradients (12,) likewise.

    The noise of each with all stands in `independent`: new in `residual`, all of it in `spread`.
    """
    for j in range(4):
        sums[j] = 0.0
    for j in range(gradient.shape[0]):
        gradient[j] = 0.0
    for g in range(count):
        source, own = m.groups[g], m.independent[g]
        if source["tested"] == 0:
            continue
        new, every, h = 0.0, 0.0, source["gradient"][k]
        for other in range(count):
            if m.groups[other]["tested"] > 0:
                new += new_noise(m, 2 * g + k, 2 * other + k, covariances)
                every += m.noise[2 * g + k, 2 * other + k]
        own["residual"][k], own["spread"][k] = new, every
        sums[0], sums[1] = sums[0] + source["residual"][k], sums[1] + source["innovation"][k]
        sums[2], sums[3] = sums[2] + new, sums[3] + every
        for j in range(3):
            gradient[j] += h[j]
            gradient[THETA + j] += h[THETA + j]


@kernel
def _write_lasting(m: PoseMemory, row: int, own: int, count: int, alone: float, others: float) -> None:
    """Write what lasting errors show in a row under watch: of the spots' row `own` alone, and of all in use."""
    now = m.lasting_now[row]
    for c in range(now.shape[0]):
        now[c] = alone * m.left[own, c]
    for g in range(count):
        if m.groups[g]["tested"] > 0:
            for c in range(now.shape[0]):
                now[c] += others * m.left[2 * g + own % 2, c]


@kernel
def gather_markers(m: PoseMemory, lead: Record, count: int, covariances: Stack) -> None:
    """Hand over the rows of the groups (count,) of an image as they stood at the prediction; lead: the track there.

    A spot against the mean of the other n - 1: (n e - 1) / (n - 1) times all, e its own unit vector.
    """
    used, markers, sums = 0, m.points.shape[0], m.scratch["noise"]
    both, rows = m.independent[0]["gradient"], m.independent[1]["gradient"]
    for i in range(markers + 1):
        m.watched[i]["seen"] = 0
    if lead["added"] != m.clock["leader"]:
        return
    if m.scratch["bending"] >= BENDS:
        m.watch["pause"] = AWAY_S
    _note_spots(m, lead, count)
    for g in range(count):
        used += 1 if m.groups[g]["tested"] > 0 else 0
    if used == 0:
        return
    for k in range(2):
        _add_up(m, k, count, sums[k], both[k], covariances)
    zero = m.independent[0]["variance"]
    zero[0], zero[1] = 0.0, 0.0
    for i in range(count + 1):
        mean = i == count
        if not mean and (used < 2 or m.groups[i]["tested"] == 0):
            continue
        group, source = m.watched[markers if mean else int(m.which[i])], m.groups[0 if mean else i]
        alone, others = (0.0, 1.0 / used) if mean else (used / (used - 1.0), -1.0 / (used - 1.0))
        group["rows"], group["seen"] = 2, 1
        for k in range(2):
            own, h, row = 2 * i + k, source["gradient"][k], rows[k]
            noise, total = others * others * sums[k, 2], others * others * sums[k, 3]
            if not mean:
                noise += alone * alone * new_noise(m, own, own, covariances)
                noise += 2.0 * alone * others * m.independent[i]["residual"][k]
                total += alone * (alone * m.noise[own, own] + 2.0 * others * m.independent[i]["spread"][k])
            for j in range(3):
                row[j] = alone * h[j] + others * both[k, j]
                row[THETA + j] = alone * h[THETA + j] + others * both[k, THETA + j]
            group["value"][k] = alone * source["residual"][k] + others * sums[k, 0]
            group["motion"][k] = -alone * source["innovation"][k] - others * sums[k, 1]
            group["noise"][k], group["lasting"][k] = noise, max(0.0, total - noise)
            row_of = 2 * (markers if mean else int(m.which[i])) + k
            _write_lasting(m, row_of, k if mean else own, count, alone, others)
            changed, moved = lasting_change(m.lasting_now[row_of], m.lasting_usual[row_of], m.lasting_fast[row_of])
            group["moved"][k] = moved
            if m.watch["on"] == 0:  # while an alarm lasts it is held: what follows is not to explain what was found
                group["changed"][k] = changed if group["learnt"] > 0 else 0.0
        xx, _, yy = pair_covariance(lead["ld"], rows, zero, 0.0)
        group["state"][0], group["state"][1] = xx, yy


@kernel
def let_pass(m: PoseMemory, dt: float) -> None:
    """Carry what is kept over the step that has been prepared."""
    step, past, watch = m.step, m.past, m.watch
    note_step(watch, dt)
    learn_step(watch, dt)
    write_alarm(watch)
    carry_state_eccentric(past[NEWEST]["motion"], step["phi"], step["effect"], past[NEWEST]["motion"])
    carry_state_eccentric(past[OLDER]["motion"], step["phi"], step["effect"], past[OLDER]["motion"])
    if watch["on"] > 0 and past[WITNESS]["added"] == past[WITNESS]["added"]:
        at = m.clock["t"]
        if advance_pose(m.body, step, m.scratch, m.motion["orbit"], past[WITNESS], at, step["dt"]):
            carry_sensitivities(m.body, m.scratch["phi"], m.past_sensitivities[WITNESS])
        else:
            past[WITNESS]["added"] = math.nan


@kernel
def _is_usurped(m: PoseMemory, t: float) -> bool:
    """Whether another hypothesis has taken the lead from one that was long settled, and kept it."""
    clock, added, warm = m.clock, m.bank[0]["added"], m.watch["age"] > WARM_S
    if added == clock["leader"]:
        clock["usurped"] = math.nan
        if not warm and clock["blurred"] == t:  # among those of a start
            m.watch["pause"] = AWAY_S
        return False
    if math.isnan(clock["usurped"]):
        clock["usurped"] = t
    if warm and (t - clock["usurped"] < USURPED_S or odds_of(m) < AMBIGUITY_LIMIT):
        return False
    clock["leader"], clock["usurped"], m.watch["pause"] = added, math.nan, AWAY_S
    return bool(warm)


@kernel
def _comes_back(m: PoseMemory, spots: Matrix, dt: float) -> bool:
    """Count how long spots are refused, others not; whether one that was for long is used though it surprises."""
    surprises = False
    for i in range(m.spots.shape[0]):
        refused = has_spot(spots, i) and m.result["used"] > 0
        if returns_wrong(m.spots[i], m.accepted[i] > 0.0, refused, dt):
            surprises = True
    return surprises


@kernel
def _is_stuck(m: PoseMemory, spots: Matrix, dt: float) -> tuple[bool, bool]:
    """Whether a spot reads the same though it should have moved, by a tenth of its noise; whether one that is used."""
    stuck, pulls = False, False
    for i in range(m.spots.shape[0]):
        if repeats(m.watched[i], spots[i, 0], spots[i, 1], dt):
            stays = m.spots[i]["speed"] * m.watched[i]["since"] > LEAST_MOTION * m.camera["noise"]
            stuck, pulls = stuck or stays, pulls or (stays and m.accepted[i] > 0.0)
    return stuck, pulls


@kernel
def watch_markers(m: PoseMemory, t: float, spots: Matrix, covariances: Stack) -> None:
    """Take an image (n, 2) px that the bank was corrected with, or not, into the monitors."""
    watch, clock = m.watch, m.clock
    dt, before = t - clock["watched"], watch["on"]
    note_image(watch, True)
    clock["watched"] = t
    if m.result["used"] > 0:
        gap = t - clock["used"]
        if gap > AWAY_S and (gap > LONGEST_JUMP_S or watch["jumped"] >= JUMP_S):
            watch["pause"] = AWAY_S
        clock["used"] = t
    stuck, pulls = _is_stuck(m, spots, dt)
    usurped, back = _is_usurped(m, t), _comes_back(m, spots, dt)
    groups = m.watched[: m.points.shape[0] + 1]
    watch_image(watch, groups, dt)
    learn_lasting(groups, m.lasting_now, m.lasting_usual, m.lasting_fast)
    if usurped or back or pulls:  # a spot that was stuck leaves a pose that it has pulled away
        watch["on"] = 1
        if watch["jumped"] < JUMP_S and not pulls:
            watch["clock"], watch["restart"] = 1, 1
        write_alarm(watch)
    if watch["on"] > 0:
        if before == 0:
            call_witness(m, t)
        ask_witness(m, t, spots, covariances)
    elif not (stuck or watch["alarm"] > 0 or watch["pause"] > 0.0 or m.result["used"] < m.result["seen"]):
        remember(m, t)
    if stuck:
        watch["alarm"] |= STUCK


@kernel
def watch_new_track(m: PoseMemory, again: bool) -> None:
    """A track has started; again: it replaced one.

    After a lock-out nothing is held against it: two images have confirmed it. Amid a fault that is not over the alarm
    stays, and the witness.
    """
    watch, clock = m.watch, m.clock
    clock["watched"], clock["used"], clock["leader"], clock["usurped"] = (
        clock["t"],
        clock["t"],
        m.bank[0]["added"],
        math.nan,
    )
    clock["denied"] = 0
    for i in range(m.spots.shape[0]):
        m.spots[i]["refused"], m.spots[i]["denied"] = 0.0, 0
    asked = again and (watch["restart"] > 0 or watch["jumped"] < JUMP_S)
    if again and watch["on"] > 0 and not asked:
        for i in range(m.watched.shape[0]):
            m.watched[i]["images"] = 0
        return
    watch_start(watch, m.watched, asked, False)
    write_alarm(watch)
    m.past[NEWEST]["added"], m.past[OLDER]["added"], m.past[WITNESS]["added"] = math.nan, math.nan, math.nan
