"""When a fault of markers is over: what a copy of the track from before it says of the images.

Three spots are six numbers and a pose is six unknowns: an error that has come to stay is taken up by the pose, and its
innovations are again what they were. That they are quiet does not say that a fault is over. What says it is a witness:
the track as it was five to ten seconds before the alarm, carried on without any image. The means of spots over five
seconds and ten images are compared with it. That they agree proves something only where they did not before, or never
disagreed: as the witness knows less and less, what is off by a constant fits it better and better. Once the chi-square
has fallen to a third within two windows, and is credible, a new start is asked for, the track having followed what was
wrong. After a minute the witness knows too little, and the alarm stays for good.
"""

import math

from relnav.arrays import Matrix, Stack
from relnav.codegen.kernel import kernel
from relnav.dynamics.error_state import MOTION
from relnav.estimation.rows import Observed, copy_rows, pair_covariance, sweep
from relnav.navigation.observation.marker_rows import new_noise, observe_markers
from relnav.navigation.pose_memory import NEWEST, OLDER, WITNESS, PoseMemory
from relnav.navigation.pose_propagation import advance_pose, carry_sensitivities, copy_pose
from relnav.navigation.propagation import prepare_step

KEPT_S = 5.0
"""How often a copy of the track is kept, of which the one before the last may become the witness."""
WITNESS_S = 60.0
WINDOW_S, WINDOW_IMAGES = 5.0, 10
"""Over which spots are averaged before the witness is asked."""
FALLEN = 1.0 / 3.0
OUTLYING = 100.0
"""Times the gate's limit: a spot so far off is a glint, and no part of a mean."""


@kernel
def remember(m: PoseMemory, t: float) -> None:
    """Keep the track as it is, now and then; motions go along from step to step, the rest when it is needed."""
    past, kept = m.past, m.past_sensitivities
    if t - past[NEWEST]["added"] < KEPT_S or m.clock["usurped"] == m.clock["usurped"]:
        return
    copy_pose(past[NEWEST], past[OLDER])
    copy_rows(kept[NEWEST], kept[OLDER])
    copy_pose(m.bank[0], past[NEWEST])
    copy_rows(m.bank_sensitivities[0], kept[NEWEST])
    past[NEWEST]["added"] = t


@kernel
def call_witness(m: PoseMemory, t: float) -> None:
    """Carry the older copy of the track to t, as what was before the fault."""
    past, kept, clock, motion = m.past, m.past_sensitivities, m.clock, m.scratch["error"]
    witness, since = past[WITNESS], past[OLDER]["added"]
    clock["window"], clock["compared"], clock["over"], clock["windows"] = t, 0, 0, 0
    copy_pose(past[OLDER], witness)
    copy_rows(kept[OLDER], kept[WITNESS])
    if not t - since <= WITNESS_S:
        witness["added"] = math.nan
        return
    for i in range(MOTION):
        motion[i] = witness["motion"][i]
    prepare_step(m.step, m.motion, m.scratch, since, t - since)
    if advance_pose(m.body, m.step, m.scratch, m.motion["orbit"], witness, since, m.step["dt"]):
        carry_sensitivities(m.body, m.scratch["phi"], kept[WITNESS])
    else:
        witness["added"] = math.nan
    for i in range(MOTION):
        witness["motion"][i] = motion[i]
    m.step["dt"] = math.nan  # what was prepared is not of the next step


@kernel
def _compare(m: PoseMemory, t: float, spots: Matrix, covariances: Stack) -> int:
    """Add what spots are off the witness' to their sums; returns how many were observed, as `groups` hold them."""
    clock, witness = m.clock, m.past[WITNESS]
    if clock["compared"] == 0:
        clock["window"] = t
        for i in range(m.spots.shape[0]):
            m.spots[i]["sums"][0], m.spots[i]["sums"][1], m.spots[i]["count"] = 0.0, 0.0, 0.0
    clock["compared"] += 1
    _, count = observe_markers(m, witness, m.past_sensitivities[WITNESS], spots, covariances)
    for g in range(count):
        group, spot = m.groups[g], m.spots[int(m.which[g])]
        sums = spot["sums"]
        x, y = group["residual"][0], group["residual"][1]
        xx, xy, yy = pair_covariance(witness["ld"], group["gradient"], group["variance"], m.noise[2 * g, 2 * g + 1])
        if x * x * yy - 2.0 * x * y * xy + y * y * xx <= OUTLYING * m.gate[1] * (xx * yy - xy * xy):
            sums[0], sums[1], spot["count"] = sums[0] + x, sums[1] + y, spot["count"] + 1.0
    return count


@kernel
def _end_window(m: PoseMemory, count: int, covariances: Stack) -> bool:
    """Write the means of a window, and the noise of means; False where fewer than three spots tell."""
    telling, least = 0, math.inf
    for i in range(m.spots.shape[0]):
        means = m.spots[i]["means"]
        for k in range(2):
            means[2, k], means[1, k], means[0, k] = means[1, k], means[0, k], math.nan
    for g in range(count):
        spot, group = m.spots[int(m.which[g])], m.groups[g]
        sums, images, group["tested"] = spot["sums"], spot["count"], 0
        if 2.0 * images > m.clock["compared"]:
            telling, least, group["tested"] = telling + 1, min(least, images), 1
            spot["means"][0, 0], spot["means"][0, 1] = sums[0] / images, sums[1] / images
    if telling < 3:
        return False
    for i in range(2 * count):
        for j in range(i + 1):
            m.noise[i, j] -= (1.0 - 1.0 / least) * new_noise(m, i, j, covariances)
            m.noise[j, i] = m.noise[i, j]
        m.groups[i // 2]["variance"][i % 2] = m.noise[i, i]
    return True


@kernel
def _contrast(m: PoseMemory, count: int, window: int) -> tuple[float, int]:
    """Chi-square of the means of a window against the witness as it is now, and its degrees of freedom.

    NaN of an earlier window where a spot that tells now had no mean.
    """
    for g in range(count):
        mean, group = m.spots[int(m.which[g])]["means"][window], m.groups[g]
        group["residual"][0], group["residual"][1] = mean[0], mean[1]
    n = 2 * count
    image = Observed(m.groups[:count], m.noise[:n, :n], m.factor[:n, :n], m.independent[:count])
    return sweep(m.past[WITNESS], m.past[WITNESS]["state"], image, m.work)


@kernel
def _agrees(m: PoseMemory, count: int, covariances: Stack) -> bool:
    """Whether the means of a window agree with the witness, as those before did not, or always did.

    All are compared by what the witness knows now: by what it knew then, what is off by a constant falls too.
    """
    windows = m.clock["windows"]
    m.clock["windows"] += 1
    if not _end_window(m, count, covariances):
        return False
    nis, dof = _contrast(m, count, 0)
    if windows == 0:
        return bool(nis <= dof + 2.0 * math.sqrt(2.0 * dof))  # mean and two sigma
    highest = 0.0
    for window in range(1, min(windows, 2) + 1):
        before, _ = _contrast(m, count, window)
        highest = before if before > highest else highest
    return bool(nis <= m.gate[dof - 1] and nis <= FALLEN * highest)


@kernel
def ask_witness(m: PoseMemory, t: float, spots: Matrix, covariances: Stack) -> None:
    """Let the witness say whether the fault is over."""
    clock, watch = m.clock, m.watch
    watch["quiet"] = 0.0  # says nothing here
    if t - m.past[WITNESS]["added"] <= WITNESS_S:
        count = _compare(m, t, spots, covariances)
        if clock["compared"] >= WINDOW_IMAGES and t - clock["window"] >= WINDOW_S:
            clock["compared"] = 0
            if _agrees(m, count, covariances):
                clock["over"] = 1
        if clock["over"] > 0:
            watch["restart"] = 1
