"""Monitors: whether what a filter's images say stays what it was, and within what is stated, from image to image.

NIS of single images does not see an error that is small in each image and lasts. Here the innovations of each row are
averaged with their sign over a second and over five, and compared with two things. With what they were before (their
mean over some 20 s): an error that lasts from the start, of attitude, mountings or beacons, is in both and falls out of
the difference, so that the limit needs no knowledge of it; what is left has the variance

    N + N' + (H P H' + H P' H') / 2

with N, N' the sums of R with squared weights, each image's own, in the two means, P' the covariance when the older one
was made. Innovations of a filter that weighs rightly are white, and means of them need N alone while H P H' is small
beside R. One that takes lasting errors for noise weighs its images less, and its innovations, as all residuals of the
updated state, share the state's error for as long as the filter remembers (30 to 50 s): what of it differs over 20 s is
half of 2 H P H'. And the older mean is compared with zero: it has the variance N' + H P H' + c, c what lasting errors
may leave in the row, not divided by the number of images: E - H S squared (`considered.py`), their effect less what the
state has taken up, its sigma averaged as the innovations are. After a start H P H' falls by powers of ten, and means
still hold innovations from before: instead of H P H' they have its sum with squared weights, where that is more.
Scatter takes all of it, and what lasting errors show otherwise than in that second.

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
from relnav.codegen.together import anywhere, held, select
from relnav.estimation.watched_means import take_value

SHIFTED, CONTRADICTED, NOISY, STUCK, CLOCK, RESTARTED, UNWATCHED = 1, 2, 4, 8, 16, 32, 64

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
TOO_LONG = 2.5
"""Usual times between images: one image is often lost, so that two such are usual."""
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
        ("judged", _I),  # images in the mean of `over`
        ("over", _F),  # mean share of spots that are refused, less that which may be
        ("over_noise", _F),  # its variance
        ("refusing", _F),  # left of what is said of it
        ("interval", _F),  # usual time between images
        ("since", _F),  # since the last image
        ("longest", _F),  # steps of late, the three longest; they fade
        ("second", _F),
        ("third", _F),
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
    changed since the older mean was made; moved, since that of the last second was.
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
            ("moved", _F, 3),
            ("weight", _F),  # of this image in the older mean; 0: not learnt
            ("fast_weight", _F),  # and in that of the last second; 0: not taken
            ("offset", _F, 3),  # mean of value over a second, watched or not
            ("fast", _F, 3),
            ("middle", _F, 3),
            ("usual", _F, 3),
            ("usual_state", _F, 3),
            ("usual_spread", _F, 3),  # mean 1-sigma of lasting errors
            ("usual_white", _F, 3),  # H P H' in it, as of white innovations
            ("fast_white", _F, 3),
            ("middle_white", _F, 3),
            ("fast_state", _F, 3),
            ("scatter", _F),
            ("fast_noise", _F, 3),  # variance of each mean by its images' noise
            ("middle_noise", _F, 3),
            ("usual_noise", _F, 3),
            ("scatter_share", _F),  # sum of squared weights
            ("scatter_moved", _F),  # share of `moved` in the variance that scatter is measured by
            ("reading", _F, 2),
            ("repeated", _I),
            ("since", _F),
        ]
    )


@kernel
def forget(watch: Record, groups: Record, where: bool) -> None:
    """Learn anew what is usual, where that is wanted."""
    watch["age"] = select(where, 0.0, watch["age"])
    watch["on"], watch["clock"] = select(where, 0, watch["on"]), select(where, 0, watch["clock"])
    watch["restart"] = select(where, 0, watch["restart"])
    for g in range(groups.shape[0]):
        group = groups[g]
        group["images"], group["learnt"] = select(where, 0, group["images"]), select(where, 0, group["learnt"])


@kernel
def watch_start(watch: Record, groups: Record, again: bool, comparable: bool) -> None:
    """A track has started; again: it replaced one. What was usual before is kept then, if rows of both can be compared.

    They can where a row hardly depends on how the track took lasting errors up.
    """
    if not again:
        forget(watch, groups, True)
        watch["hold"], watch["alarm"], watch["jumped"], watch["interval"] = 0.0, 0, math.inf, 0.0
        watch["since"] = 0.0
        watch["longest"], watch["second"], watch["third"] = 0.0, 0.0, 0.0
        watch["contradicted"], watch["noisy"], watch["pause"] = 0.0, 0.0, 0.0
        watch["doubted"], watch["unproven"], watch["pulled"], watch["returned"] = 0.0, 0.0, 0, 0
        return
    watch["doubted"] = 0.0
    clock = 1 if watch["clock"] > 0 or watch["jumped"] < JUMP_S else 0
    watch["hold"], watch["alarm"] = HOLD_S, RESTARTED | (CLOCK if clock > 0 else 0)
    watch["alarm"] |= NOISY if watch["refusing"] > 0.0 else 0
    if watch["restart"] > 0:  # asked for: what was wrong is over
        watch["unproven"] = WARM_S if watch["contradicted"] > 0.0 else 0.0
        watch["contradicted"], watch["noisy"] = 0.0, 0.0
    if not comparable or not watch["age"] > WARM_S:
        forget(watch, groups, True)
    watch["on"], watch["restart"], watch["quiet"], watch["clock"] = 0, 0, 0.0, clock
    watch["pulled"], watch["returned"] = 0, 0
    for g in range(groups.shape[0]):
        groups[g]["images"] = 0


@kernel
def _shift(group: Record) -> tuple[float, float, float]:
    """How far means of the group are from what they usually were, in squared sigmas.

    The largest of all rows and both means, and the sums over rows of the shorter and of the longer mean.
    """
    mean, longer, usual = group["fast"], group["middle"], group["usual"]
    largest, short, long = 0.0, 0.0, 0.0
    for k in range(group["rows"]):
        state = 0.5 * (group["state"][k] + group["usual_state"][k])
        known = group["usual_noise"][k] + group["changed"][k]
        off = mean[k] - usual[k]
        one = off * off / (group["fast_noise"][k] + known + max(state, group["fast_white"][k]))
        off = longer[k] - usual[k]
        two = off * off / (group["middle_noise"][k] + known + max(state, group["middle_white"][k]))
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
    found = False
    for k in range(group["rows"]):
        usual = group["usual"][k]
        state = max(group["state"][k], group["usual_white"][k])
        known = group["usual_noise"][k] + state + group["usual_spread"][k] ** 2
        found = found | (usual * usual > limit2 * known)
    return found


@kernel
def _is_noisy(group: Record) -> bool:
    """Whether the group scatters more than its noise explains.

    Variance of a mean of squares over rows: 2 / rows; of what lasting errors do there is one, in all rows and images.
    """
    over, moved = group["scatter"] - 1.0, group["scatter_moved"]
    variance = 2.0 / group["rows"] * group["scatter_share"] + 2.0 * moved * moved
    noisy: bool = (over > 0.0) & (over * over > SCATTER_LIMIT * SCATTER_LIMIT * variance)
    return noisy


@kernel
def _looks_late(watch: Record, groups: Record) -> bool:
    """Whether images that are late, or early, by one time explain most of a shift; the time into `offset`.

    One number is sought, so that it is seen before any single row shows it. After a gap the state's error, which is in
    all rows alike, is in the shorter mean for as long as the first image is: it may look like one time in all of them.
    """
    along, scale, total, alone, shared = 0.0, 0.0, 0.0, 0.0, 0.0
    for g in range(groups.shape[0]):
        group = groups[g]
        if group["present"] == 0 or group["learnt"] == 0 or group["images"] == 0:
            continue
        for k in range(group["rows"]):
            white = group["fast_white"][k]
            variance = group["fast_noise"][k] + group["usual_noise"][k] + group["changed"][k]
            variance += max(0.5 * (group["state"][k] + group["usual_state"][k]), white)
            off, motion = group["fast"][k] - group["usual"][k], group["motion"][k]
            along += off * motion / variance
            scale += motion * motion / variance
            total += off * off / variance
            alone += motion * motion * (variance - white) / (variance * variance)
            shared += abs(motion) * math.sqrt(white) / variance
    if not scale > 0.0:
        return False
    watch["offset"] = along / scale
    return bool(along * along > max(EXPLAINED * total * scale, LATE_LIMIT2 * (alone + shared * shared)))


@kernel
def note_step(watch: Record, dt: float) -> None:
    """Let dt s pass, and notice a step that is much longer than images are usually apart, and than it is at times."""
    watch["jumped"] += dt
    watch["since"] += dt
    watch["hold"] = max(0.0, watch["hold"] - dt)
    watch["noisy"] = max(0.0, watch["noisy"] - dt)
    watch["refusing"] = max(0.0, watch["refusing"] - dt)
    if watch["interval"] > 0.0 and dt > TOO_LONG * max(watch["interval"], watch["third"]):
        watch["jumped"] = 0.0


@kernel
def note_image(watch: Record, seen: bool) -> None:
    """Learn how far apart images are, where there is one: steps to epochs without images may be of any length."""
    since, interval = watch["since"], watch["interval"]
    first = interval == 0.0
    usual = seen & (since > 0.0) & (first | (since <= TOO_LONG * interval))
    longer = select(first, since, interval + 0.1 * (since - interval))
    watch["interval"] = select(usual, longer, interval)
    watch["since"] = select(seen, 0.0, since)


@kernel
def _come_and_go(groups: Record, dt: float) -> tuple[bool, bool]:
    """Count how long groups are away; whether one came or left, and whether those present are seen, as a whole."""
    changed, seen, missing = False, False, False
    for g in range(groups.shape[0]):
        seen = seen | (groups[g]["seen"] > 0)
    for g in range(groups.shape[0]):
        group = groups[g]
        here, present = group["seen"] > 0, group["present"] > 0
        if not anywhere(not (here & present)):
            group["away"], group["gone"] = group["away"] + dt, 0.0
            continue
        came, absent = here & (not present), (not here) & present & seen
        group["away"] = select(came, dt, group["away"] + dt)
        group["gone"] = select(here, 0.0, select(absent, group["gone"] + dt, group["gone"]))
        missing, left = missing | (absent & (group["gone"] > MISSING_S)), absent & (group["gone"] > AWAY_S)
        group["present"] = select(came, 1, select(left, 0, group["present"]))
        group["images"] = select(left, 0, group["images"])
        changed = changed | came | left
    return changed, seen & (not missing)


@kernel
def watch_image(watch: Record, groups: Record, dt: float) -> None:
    """Take what the groups say of an image dt s after the last into the monitors, and write the alarm."""
    changed, whole = _come_and_go(groups, dt)
    paused = watch["pause"] > 0.0
    if anywhere(paused):
        watch["pause"] = select(paused, watch["pause"] - dt, watch["pause"])
        changed, whole = changed | paused, whole & (not paused)
    holding = watch["hold"] > 0.0
    anew = changed & (watch["on"] == 0) & (not holding)
    if anywhere(anew):
        forget(watch, groups, anew)
    alarmed, said = watch["on"] > 0, (watch["contradicted"] > 0.0) | (watch["unproven"] > 0.0)
    lasting2 = select(said, LASTING_CALM2, LASTING_LIMIT2)
    limit2, sigmas = select(alarmed, CALM_LIMIT2, SHIFT_LIMIT2), select(alarmed, SUM_CALM, SUM_LIMIT)
    largest, short, long, rows = 0.0, 0.0, 0.0, 0
    learning = (not alarmed) & (not holding) & (watch["doubted"] == 0.0)
    warm = watch["age"] > WARM_S
    for g in range(groups.shape[0]):
        group = groups[g]
        group["weight"], group["fast_weight"] = 0.0, 0.0
        taken = (group["seen"] > 0) & whole
        if not anywhere(taken):
            continue
        taken = held(taken)
        take_value(group, group["away"], taken, learning)
        group["away"] = select(taken, 0.0, group["away"])
        known = taken & (group["learnt"] > 0)
        if anywhere(known):
            known = held(known)
            one, two, three = _shift(group)
            largest, rows = select(known, max(largest, one), largest), select(known, rows + group["rows"], rows)
            short, long = select(known, short + two, short), select(known, long + three, long)
            says = known & (group["learnt"] >= 10) & _contradicts(group, lasting2)
            if anywhere(says):
                watch["contradicted"] = select(says, LASTING_SAID_S, watch["contradicted"])
        noisy = taken & (group["images"] >= 10) & _is_noisy(group)
        if anywhere(noisy):
            watch["noisy"] = select(noisy, SAID_S, watch["noisy"])
    shifted = warm & ((largest > limit2) | (max(short, long) > _sum_limit(max(rows, 1), sigmas)))
    _say(watch, groups, dt, whole, learning, warm, shifted)


@kernel
def _say(watch: Record, groups: Record, dt: float, whole: bool, learning: bool, warm: bool, shifted: bool) -> None:
    """Let what was found begin and end what is said, and write the alarm."""
    goes_on, left = whole & learning, watch["contradicted"]
    watch["age"] = select(goes_on, watch["age"] + dt, watch["age"])
    if anywhere(watch["unproven"] > 0.0):
        watch["unproven"] = select(goes_on, max(0.0, watch["unproven"] - dt), watch["unproven"])
    if anywhere(left > 0.0):
        lasts = whole & (left > dt)  # nothing ends unwatched
        watch["contradicted"] = select(lasts, left - dt, left)
        watch["restart"] = select(whole & (left > 0.0) & (not lasts), 1, watch["restart"])  # stays until that start
    late = whole & warm & (watch["jumped"] < JUMP_S) & (watch["hold"] == 0.0)
    if anywhere(late):
        late = late & _looks_late(watch, groups)
        watch["clock"] = select(late, 1, watch["clock"])
    begins = shifted | late
    if anywhere(begins | (watch["on"] > 0)):
        stays = (not begins) & (watch["on"] > 0) & whole
        watch["quiet"] = select(begins, 0.0, select(stays, watch["quiet"] + dt, watch["quiet"]))
        ends = stays & (watch["quiet"] > QUIET_S)
        watch["restart"] = select(begins, watch["clock"], select(ends, 1, watch["restart"]))
        watch["on"] = select(begins, 1, watch["on"])
    if anywhere(watch["clock"] > 0):
        watch["clock"] = select((watch["on"] == 0) & (watch["hold"] == 0.0), 0, watch["clock"])
    write_alarm(watch)


@kernel
def write_alarm(watch: Record) -> None:
    """Write the alarm, STUCK apart."""
    said = (watch["contradicted"] > 0.0) | (watch["unproven"] > 0.0)
    watch["alarm"] = (
        select(watch["on"] > 0, SHIFTED, 0)
        | select(said, CONTRADICTED, 0)
        | select((watch["noisy"] > 0.0) | (watch["refusing"] > 0.0), NOISY, 0)
        | select((watch["clock"] > 0) | (watch["doubted"] > 0.0), CLOCK, 0)
        | select(watch["hold"] > 0.0, RESTARTED, 0)
    )
