"""Monitors: whether what a filter's images say stays what it was, and within what is stated, from image to image.

NIS of single images does not see an error that is small in each image and lasts. Here the innovations of each row are
averaged with their sign over a second and over five, and compared with two things. With what they were before (their
mean over some 20 s): an error that lasts from the start, of attitude, mountings or beacons, is in both and falls out of
the difference, so that the limit needs no knowledge of it; what is left has the variance

    R (q + q') + (H P H' + H P' H') / 2

with q, q' the sums of squared weights of the two means, P' the covariance when the older one was made. Innovations of a
filter that weighs rightly are white, and means of them need R q alone while H P H' is small beside R. One that takes
lasting errors for noise weighs its images less, and its innovations, as all residuals of the updated state, share the
state's error for as long as the filter remembers (30 to 50 s): what of it differs over 20 s is half of 2 H P H'. And
the older mean is compared with zero: it has the variance R q' + H P H' + c, c what lasting errors may leave in the row,
not divided by the number of images: E - H S squared (`considered.py`), their effect less what the state has taken up,
its sigma averaged as the innovations are. After a start H P H' falls by powers of ten, and means still hold innovations
from before: instead of H P H' they have its sum with squared weights, where that is more. Scatter takes all of it.

The third is scatter: squared innovations about their own mean of the last second, over three seconds, for each group.

A step that was too long may be a gap in the images, or a jump of the clock. If a jump by all of it would matter, the
clock is doubted until images have decided (`clock_monitor.py`).

While an alarm of the first kind lasts the older mean is not carried on: it stands for the time before. The alarm ends
when the innovations are again what they were, for five seconds; what was learnt meanwhile is not believed, and the
filter is asked to start anew (`restart`). Where what changed does not change back, the alarm stays.

Limits of single tests: five sigma, 6e-7, with six rows and two means a test a second of 300 s would alarm in 1 of 500
runs; the sums, at 1e-6, in 1 of 1,700. Nothing here knows a sensor: it hands over rows in groups (`watched_type`).
"""

import math

import numpy as np

from relnav.arrays import Record
from relnav.codegen.kernel import kernel

SHIFTED, CONTRADICTED, NOISY, STUCK, CLOCK, RESTARTED, UNWATCHED = 1, 2, 4, 8, 16, 32, 64

FAST_S, MIDDLE_S, USUAL_S, SCATTER_S = 1.0, 5.0, 20.0, 3.0
"""Time constants of the means."""
WARM_S = 10.0
"""So long the older mean is made before others are compared with it."""
MISSING_S = 0.5
"""A group that is not seen for so long, while others are, is missing: the others are not judged without it."""
AWAY_S = 3.0
"""A group that is not seen for so long has left: what the others say changes with it, and is learnt anew."""
QUIET_S = 5.0
HOLD_S = 10.0
"""After a start that replaced a track."""
SAID_S, LASTING_SAID_S = 3.0, 100.0
"""An alarm of the third kind, and of the second, stays for so long after its last cause; after the second the filter is
asked to start anew, as a state that has taken the error up agrees with what it contradicted, and the start is watched
for WARM_S before it is believed."""
SHIFT_LIMIT2, CALM_LIMIT2 = 25.0, 16.0
SUM_LIMIT, SUM_CALM = 4.75, 3.75
"""Of a mean of one row, in squared sigmas, and of the sum over all rows, in sigmas of a normal number (`_sum_limit`):
an error that the state takes up in part is spread over them all. While an alarm lasts, the lower ones."""
LASTING_LIMIT2, LASTING_CALM2 = 20.25, 6.25
SCATTER_LIMIT = 8.0
"""Of the mean of squares, in 1-sigma of such a mean."""
JUMP_S = 5.0
"""A jump of the clock is looked for so long after a step that was too long; these are rare, so that four sigma do."""
EXPLAINED, LATE_LIMIT2 = 0.25, 16.0

_F, _I = np.float64, np.int64

WATCH = np.dtype(
    [
        ("alarm", _I),  # bits
        ("on", _I),  # innovations have shifted
        ("clock", _I),  # as if by a jump of the clock
        ("restart", _I),  # the filter is asked to start anew
        ("pulled", _I),  # a spot that was stuck was used
        ("returned", _I),  # what was refused for long is used, and wrong: 1 + its group
        ("age", _F),  # of the older means
        ("quiet", _F),  # since the innovations are what they were
        ("hold", _F),  # left of it
        ("pause", _F),  # left of it: set by the sensor while means would not be what they seem
        ("contradicted", _F),  # left of it
        ("unproven", _F),  # left of what a start after it is watched before it is believed
        ("noisy", _F),
        ("interval", _F),  # usual step
        ("jumped", _F),  # since a step that was too long
        ("offset", _F),  # s, by which an image seems late where `clock`
        ("doubted", _F),  # s, a step that may be the clock's; 0 if none is
        ("unsure", _F),  # variance of the position over the square of its jump
        ("shown", _F),  # what images since would show of the jump, in squared sigmas
        ("along", _F),  # the same of what they do show
    ]
)
"""What is known of all groups."""


def watched_type() -> np.dtype[np.void]:
    """A group of at most three rows.

    Handed over for each image: rows; seen; value, z - h(x); variances of what is new in each image (noise), of the
    state's part H P H' (state), of lasting errors (lasting); motion, what an image one second late adds to value;
    taken, while a step is doubted, what images since have put into h(x); changed, variance by which lasting errors have
    changed since the older mean was made.
    """
    return np.dtype(
        [
            ("rows", _I),
            ("seen", _I),
            ("present", _I),
            ("images", _I),
            ("learnt", _I),
            ("away", _F),  # since it was seen last
            ("gone", _F),  # while others were
            ("value", _F, 3),
            ("noise", _F, 3),
            ("state", _F, 3),
            ("lasting", _F, 3),
            ("motion", _F, 3),
            ("taken", _F, 3),
            ("changed", _F, 3),
            ("weight", _F),  # of this image in the older mean; 0: not learnt
            ("offset", _F, 3),  # mean of value over a second, watched or not
            ("fast", _F, 3),
            ("middle", _F, 3),
            ("usual", _F, 3),
            ("usual_state", _F, 3),
            ("usual_spread", _F, 3),  # mean 1-sigma of lasting errors
            ("usual_white", _F, 3),  # H P H' in it, as of white innovations
            ("fast_state", _F, 3),
            ("scatter", _F),
            ("fast_share", _F),
            ("middle_share", _F),
            ("usual_share", _F),
            ("scatter_share", _F),
            ("reading", _F, 2),
            ("repeated", _I),
            ("since", _F),
        ]
    )


@kernel
def forget(watch: Record, groups: Record) -> None:
    """Learn anew what is usual."""
    watch["age"], watch["on"], watch["clock"], watch["restart"] = 0.0, 0, 0, 0
    for g in range(groups.shape[0]):
        groups[g]["images"], groups[g]["learnt"] = 0, 0


@kernel
def watch_start(watch: Record, groups: Record, again: bool, comparable: bool) -> None:
    """A track has started; again: it replaced one. What was usual before is kept then, if rows of both can be compared.

    They can where a row hardly depends on how the track took lasting errors up.
    """
    if not again:
        forget(watch, groups)
        watch["hold"], watch["alarm"], watch["jumped"], watch["interval"] = 0.0, 0, math.inf, 0.0
        watch["contradicted"], watch["noisy"], watch["pause"] = 0.0, 0.0, 0.0
        watch["doubted"], watch["unproven"], watch["pulled"], watch["returned"] = 0.0, 0.0, 0, 0
        return
    watch["doubted"] = 0.0
    clock = 1 if watch["clock"] > 0 or watch["jumped"] < JUMP_S else 0
    watch["hold"], watch["alarm"] = HOLD_S, RESTARTED | (CLOCK if clock > 0 else 0)
    if watch["restart"] > 0:  # asked for: what was wrong is over
        watch["unproven"] = WARM_S if watch["contradicted"] > 0.0 else 0.0
        watch["contradicted"], watch["noisy"] = 0.0, 0.0
    if not comparable or not watch["age"] > WARM_S:
        forget(watch, groups)
    watch["on"], watch["restart"], watch["quiet"], watch["clock"] = 0, 0, 0.0, clock
    watch["pulled"], watch["returned"] = 0, 0
    for g in range(groups.shape[0]):
        groups[g]["images"] = 0


@kernel
def _mean_share(share: float, weight: float) -> float:
    """Sum of squared weights of a mean after the next value."""
    return (1.0 - weight) * (1.0 - weight) * share + weight * weight


@kernel
def _take(group: Record, dt: float, learning: bool) -> None:
    """Carry the means of a group on; dt: s since it was last seen."""
    group["images"] += 1
    first = 1.0 / group["images"]
    fast, middle = max(first, dt / (dt + FAST_S)), max(first, dt / (dt + MIDDLE_S))
    value, noise, state = group["value"], group["noise"], group["state"]
    mean, longer, usual, usual_state = group["fast"], group["middle"], group["usual"], group["usual_state"]
    fast_state, usual_white, usual_spread = group["fast_state"], group["usual_white"], group["usual_spread"]
    if group["images"] == 1:
        group["fast_share"], group["middle_share"], group["scatter_share"], group["scatter"] = 1.0, 1.0, 1.0, 1.0
    else:
        squares = 0.0
        for k in range(group["rows"]):
            off = value[k] - mean[k]
            squares += off * off / (noise[k] * (1.0 + group["fast_share"]) + state[k] + fast_state[k])
        weight = max(1.0 / (group["images"] - 1), dt / (dt + SCATTER_S))
        group["scatter"] += weight * (squares / group["rows"] - group["scatter"])
        group["scatter_share"] = _mean_share(group["scatter_share"], weight)
        group["fast_share"] = _mean_share(group["fast_share"], fast)
        group["middle_share"] = _mean_share(group["middle_share"], middle)
    for k in range(group["rows"]):
        mean[k] = value[k] if group["images"] == 1 else mean[k] + fast * (value[k] - mean[k])
        fast_state[k] += fast * (state[k] - fast_state[k])
        longer[k] = value[k] if group["images"] == 1 else longer[k] + middle * (value[k] - longer[k])
    if learning:
        group["learnt"] += 1
        if group["learnt"] == 1:
            group["usual_share"] = 1.0
        slow = max(1.0 / group["learnt"], dt / (dt + USUAL_S))
        group["weight"] = slow
        group["usual_share"] = _mean_share(group["usual_share"], slow)
        for k in range(group["rows"]):
            usual[k] += slow * (value[k] - usual[k])
            usual_state[k] += slow * (state[k] - usual_state[k])
            usual_spread[k] += slow * (math.sqrt(group["lasting"][k]) - usual_spread[k])
            usual_white[k] = (1.0 - slow) * (1.0 - slow) * usual_white[k] + slow * slow * state[k]


@kernel
def _shift(group: Record) -> tuple[float, float, float]:
    """How far means of the group are from what they usually were, in squared sigmas.

    The largest of all rows and both means, and the sums over rows of the shorter and of the longer mean.
    """
    mean, longer, usual = group["fast"], group["middle"], group["usual"]
    largest, short, long = 0.0, 0.0, 0.0
    for k in range(group["rows"]):
        noise = group["noise"][k]
        common = 0.5 * (group["state"][k] + group["usual_state"][k]) + group["changed"][k]
        off = mean[k] - usual[k]
        one = off * off / (noise * (group["fast_share"] + group["usual_share"]) + common)
        off = longer[k] - usual[k]
        two = off * off / (noise * (group["middle_share"] + group["usual_share"]) + common)
        largest, short, long = max(largest, one, two), short + one, long + two
    return largest, short, long


@kernel
def _sum_limit(rows: int, sigmas: float) -> float:
    """Limit of a sum of `rows` squares, as improbable as a normal number above `sigmas` (Wilson and Hilferty)."""
    spread = 2.0 / (9.0 * rows)
    return float(rows * (1.0 - spread + sigmas * math.sqrt(spread)) ** 3)


@kernel
def _contradicts(group: Record, limit2: float) -> bool:
    """Whether the usual mean is more than lasting errors and the state's explain."""
    for k in range(group["rows"]):
        usual = group["usual"][k]
        state = max(group["state"][k], group["usual_white"][k])
        known = group["noise"][k] * group["usual_share"] + state + group["usual_spread"][k] ** 2
        if usual * usual > limit2 * known:
            return True
    return False


@kernel
def _is_noisy(group: Record) -> bool:
    """Whether the group scatters more than its noise explains; variance of a mean of squares over rows: 2 / rows."""
    over = group["scatter"] - 1.0
    variance = 2.0 / group["rows"] * group["scatter_share"]
    return bool(over > 0.0 and over * over > SCATTER_LIMIT * SCATTER_LIMIT * variance)


@kernel
def _looks_late(watch: Record, groups: Record) -> bool:
    """Whether images that are late, or early, by one time explain most of a shift; the time into `offset`.

    One number is sought, so that it is seen before any single row shows it.
    """
    along, scale, total = 0.0, 0.0, 0.0
    for g in range(groups.shape[0]):
        group = groups[g]
        if group["present"] == 0 or group["learnt"] == 0 or group["images"] == 0:
            continue
        for k in range(group["rows"]):
            variance = group["noise"][k] * (group["fast_share"] + group["usual_share"])
            variance += 0.5 * (group["state"][k] + group["usual_state"][k]) + group["changed"][k]
            off, motion = group["fast"][k] - group["usual"][k], group["motion"][k]
            along += off * motion / variance
            scale += motion * motion / variance
            total += off * off / variance
    if not scale > 0.0:
        return False
    watch["offset"] = along / scale
    return bool(along * along > scale * max(EXPLAINED * total, LATE_LIMIT2))


@kernel
def follow(group: Record, k: int, dt: float) -> float:
    """Carry the mean of a row's value on, also while nothing is watched: where its next one will be."""
    offset = group["offset"]
    offset[k] += dt / (dt + FAST_S) * (group["value"][k] - offset[k])
    return float(offset[k])


@kernel
def note_step(watch: Record, dt: float) -> None:
    """Let dt s pass, and notice a step that is much longer than usual."""
    watch["jumped"] += dt
    watch["hold"] = max(0.0, watch["hold"] - dt)
    watch["noisy"] = max(0.0, watch["noisy"] - dt)
    if watch["interval"] > 0.0 and dt > 2.5 * watch["interval"]:
        watch["jumped"] = 0.0
    else:
        watch["interval"] = dt if watch["interval"] == 0.0 else watch["interval"] + 0.1 * (dt - watch["interval"])


@kernel
def _come_and_go(groups: Record, dt: float) -> tuple[bool, bool]:
    """Count how long groups are away; whether one came or left, and whether those present are seen, as a whole."""
    changed, seen, missing = False, False, False
    for g in range(groups.shape[0]):
        seen = seen or groups[g]["seen"] > 0
    for g in range(groups.shape[0]):
        group = groups[g]
        group["away"] += dt
        if group["seen"] > 0:
            group["gone"] = 0.0
            if group["present"] == 0:
                group["present"], group["away"], changed = 1, dt, True
        elif group["present"] > 0 and seen:
            group["gone"] += dt
            missing = missing or group["gone"] > MISSING_S
            if group["gone"] > AWAY_S:
                group["present"], group["images"], changed = 0, 0, True
    return changed, seen and not missing


@kernel
def watch_image(watch: Record, groups: Record, dt: float) -> None:
    """Take what the groups say of an image dt s after the last into the monitors, and write the alarm."""
    changed, whole = _come_and_go(groups, dt)
    if watch["pause"] > 0.0:
        watch["pause"] -= dt
        changed, whole = True, False
    if changed and watch["on"] == 0 and watch["hold"] == 0.0:
        forget(watch, groups)
    lasting2 = LASTING_CALM2 if watch["contradicted"] > 0.0 or watch["unproven"] > 0.0 else LASTING_LIMIT2
    limit2, sigmas = (CALM_LIMIT2, SUM_CALM) if watch["on"] > 0 else (SHIFT_LIMIT2, SUM_LIMIT)
    largest, short, long, rows = 0.0, 0.0, 0.0, 0
    learning = watch["on"] == 0 and watch["hold"] == 0.0 and watch["doubted"] == 0.0
    warm = watch["age"] > WARM_S
    for g in range(groups.shape[0]):
        group = groups[g]
        group["weight"] = 0.0
        if group["seen"] == 0 or not whole:
            continue
        _take(group, group["away"], learning)
        group["away"] = 0.0
        if group["learnt"] > 0:
            one, two, three = _shift(group)
            largest, short, long, rows = max(largest, one), short + two, long + three, rows + group["rows"]
            if group["learnt"] >= 10 and _contradicts(group, lasting2):
                watch["contradicted"] = LASTING_SAID_S
        if group["images"] >= 10 and _is_noisy(group):
            watch["noisy"] = SAID_S
    shifted = warm and (largest > limit2 or max(short, long) > _sum_limit(max(rows, 1), sigmas))
    if whole and learning:
        watch["age"], watch["unproven"] = watch["age"] + dt, max(0.0, watch["unproven"] - dt)
    if whole and watch["contradicted"] > dt:  # nothing ends unwatched
        watch["contradicted"] -= dt
    elif whole and watch["contradicted"] > 0.0:  # stays until that start
        watch["restart"] = 1
    late = whole and warm and watch["jumped"] < JUMP_S and watch["hold"] == 0.0 and _looks_late(watch, groups)
    if late:
        watch["clock"] = 1
    if shifted or late:
        watch["quiet"], watch["on"], watch["restart"] = 0.0, 1, watch["clock"]
    elif watch["on"] > 0 and whole:
        watch["quiet"] += dt
        if watch["quiet"] > QUIET_S:
            watch["restart"] = 1
    if watch["on"] == 0 and watch["hold"] == 0.0:
        watch["clock"] = 0
    write_alarm(watch)


@kernel
def write_alarm(watch: Record) -> None:
    """Write the alarm, STUCK apart."""
    watch["alarm"] = (
        (SHIFTED if watch["on"] > 0 else 0)
        | (CONTRADICTED if watch["contradicted"] > 0.0 or watch["unproven"] > 0.0 else 0)
        | (NOISY if watch["noisy"] > 0.0 else 0)
        | (CLOCK if watch["clock"] > 0 or watch["doubted"] > 0.0 else 0)
        | (RESTARTED if watch["hold"] > 0.0 else 0)
    )
