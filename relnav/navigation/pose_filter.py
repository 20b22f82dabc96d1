"""One epoch of the marker filter: a bank of hypotheses predicted, corrected, started and started again.

A flat pattern has up to four poses that explain an image; a filter on the most credible one alone may follow the wrong
one for ever. Each root starts a hypothesis, its covariance widened (seen head-on the misfit is no parabola, and the
truth lies up to 3 sigma off). A hypothesis falls when its latest spots are a million times less likely than another's;
every ten seconds roots that no hypothesis covers start new ones; two that have become one are joined.

Start: the roots of one image open a trial; the next image of three markers or more that the trial's leading hypothesis
predicts, all spots inside the gate and the gates small, confirms it. An image that contradicts the trial opens another
one. Lock-out: after `restart after` epochs in a row with at least half of what was seen rejected, or when after a gap
errors no longer count as small, trials run beside the bank, and a confirmed one replaces it.

Roots come from the closed form, which is not compiled in here: `wants` says what the caller is to look for.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import kernel, shared_entry, straight_line
from relnav.codegen.trace import Shape
from relnav.estimation.considered import update_sensitivities
from relnav.estimation.factored import orthogonalise, spread
from relnav.estimation.rows import Observed, copy_track, gate_groups, log_determinant, pair_covariance, sweep
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector
from relnav.navigation.marker_observation import aim_camera, has_spot, observe_markers
from relnav.navigation.pose_memory import POSE, PoseMemory, pose_views
from relnav.navigation.pose_propagation import advance_bank, copy_pose, copy_rows, is_wide
from relnav.navigation.propagation import prepare_step
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING

DROP = 2.0 * math.log(1e6)
RENEWED_S = 10.0
JOINED = 1.0  # chi-square of twelve: two hypotheses this near are one
TELLING_SHARE = 0.01
"""Of the image that a spot's gate may cover where it is to confirm a start."""

NOTHING, ROOTS, NEW_ROOTS = 0, 1, 2
"""What the caller is to look for: poses to open a trial with; poses that no hypothesis covers."""

CONTRADICTED, GOES_ON, CONFIRMED = 0, 1, 2
"""What an image says of a trial; one that agrees with it while its gates are large proves nothing, and it goes on."""

_RESET: Shape = tuple(
    "".join("*" if 6 <= i < 9 and 6 <= j < 9 else "1" if i == j else "0" for j in range(POSE)) for i in range(POSE)
)


@straight_line(ld=(POSE, POSE), turn=_RESET)
def turn_errors(ld: Matrix, turn: Matrix) -> None:
    """Replace the factors of P by those of G P G^T."""
    n = ld.shape[0]
    w, weights = np.zeros((n, n)), np.zeros(n)
    spread(turn, ld, w, weights)
    orthogonalise(w, weights, ld)


@kernel
def take_in(scratch: Record, track: Record, sensitivities: Matrix) -> None:
    """Fold the errors that an update has estimated into motion, attitude and rate; covariance then is about these.

    P <- G P G^T and S <- G S, G = I - [theta x] / 2 (Markley and Crassidis 2014, ch. 6).
    """
    x, motion, rate, dcm = track["state"], track["motion"], track["rate"], track["dcm"]
    turned, g = scratch["turned"], scratch["phi"]
    for i in range(6):
        motion[i] += x[i]
    turn_by_rotation_vector(dcm, x[6:9], turned)
    for i in range(3):
        rate[i] += x[9 + i]
        for j in range(3):
            dcm[i, j] = turned[i, j]
    for i in range(6):  # all of it: as plain Python `turn_errors` reads what the last time update left here
        for j in range(6):
            g[i, j] = g[6 + i, 6 + j] = 1.0 if i == j else 0.0
    a, b, c = 0.5 * x[6], 0.5 * x[7], 0.5 * x[8]
    g[6, 7], g[6, 8], g[7, 6], g[7, 8], g[8, 6], g[8, 7] = c, -b, -c, a, b, -a
    turn_errors(track["ld"], g)
    for k in range(sensitivities.shape[0]):
        s = sensitivities[k]
        u, v, w = s[6], s[7], s[8]
        s[6], s[7], s[8] = u + c * v - b * w, v - c * u + a * w, w + b * u - a * v
    for i in range(POSE):
        x[i] = 0.0


@kernel
def spot_update(
    m: PoseMemory, track: Record, sensitivities: Matrix, spots: Matrix, covariances: Stack
) -> tuple[int, int, int, float]:
    """Correct a hypothesis by an image; (markers seen, groups, groups used, NIS), its score counted on.

    sensitivities (m, 12) of the hypothesis. Which groups were used stands in `groups`. A rejected spot costs what one
    at the gate's limit would.
    """
    limit = m.gate[1]
    seen, count = observe_markers(m, track, sensitivities, spots, covariances)
    track["score"] += (seen - count) * (limit + 4.0 * math.log(m.camera["noise"]))
    if count == 0:
        return seen, 0, 0, math.nan
    n = 2 * count
    image = Observed(m.groups[:count], m.noise[:n, :n], m.factor[:n, :n], m.independent[:count])
    nis, dof = sweep(track, track["state"], image, m.work)
    used = gate_groups(track, image, m.gate, m.work, nis, dof)
    taken = nis
    if used < count:
        for k in range(count):
            if m.groups[k]["tested"] == 0:
                xx, xy, yy = pair_covariance(
                    track["ld"], m.groups[k]["gradient"], m.groups[k]["variance"], m.noise[2 * k, 2 * k + 1]
                )
                track["score"] += limit + math.log(xx * yy - xy * xy)
        if used > 0:
            taken, _ = sweep(track, track["state"], image, m.work)
    if used > 0:
        track["score"] += taken + log_determinant(image)
        copy_track(m.work, track)
        update_sensitivities(track["ld"], image, m.by_error[:n], m.news, sensitivities)
        take_in(m.scratch, track, sensitivities)
    return seen, count, used, nis


@kernel
def _distance2(e: Vector, one: Record, other: Record) -> float:
    """Chi-square of twelve between two hypotheses, by the covariance of the first; e (12,) is scratch."""
    ld = one["ld"]
    for i in range(6):
        e[i] = other["motion"][i] - one["motion"][i]
    rotation_vector_into(other["dcm"], one["dcm"], e[6:9])
    for i in range(3):
        e[9 + i] = other["rate"][i] - one["rate"][i]
    total = 0.0
    for i in range(POSE):
        for j in range(i):
            e[i] -= ld[i, j] * e[j]
        total += e[i] * e[i] / ld[i, i]
    return total


@kernel
def order_bank(m: PoseMemory, bank: Record, sensitivities: Stack, count: int) -> int:
    """The most credible first, those far behind and those that have become one with a better one left out."""
    if count < 2:
        return count
    order, spare, kept = m.scratch["order"], m.spare, 0
    for i in range(count):
        order[i] = i
        copy_pose(bank[i], spare[i])
        copy_rows(sensitivities[i], m.spare_sensitivities[i])
    for i in range(1, count):
        k, j = order[i], i
        while j > 0 and spare[order[j - 1]]["score"] > spare[k]["score"]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = k
    for i in range(count):
        one = spare[order[i]]
        if kept > 0 and one["score"] - bank[0]["score"] > DROP:
            break
        alone = True
        for k in range(kept):
            if _distance2(m.scratch["error"], bank[k], one) <= JOINED:
                alone = False
        if alone:
            copy_pose(one, bank[kept])
            copy_rows(m.spare_sensitivities[order[i]], sensitivities[kept])
            kept += 1
    return kept


@kernel
def _telling(m: PoseMemory, ld: Matrix, count: int) -> bool:
    """Whether the gates of the spots in the groups are small on the image, so that a glint would hardly pass."""
    size = m.camera["size"]
    for k in range(count):
        xx, xy, yy = pair_covariance(ld, m.groups[k]["gradient"], m.groups[k]["variance"], m.noise[2 * k, 2 * k + 1])
        area = math.pi * m.gate[1] * math.sqrt(max(0.0, xx * yy - xy * xy))
        if not area < TELLING_SHARE * size[0] * size[1]:
            return False
    return True


@kernel
def _correct_bank(
    m: PoseMemory, bank: Record, sensitivities: Stack, count: int, spots: Matrix, covariances: Stack
) -> tuple[int, bool]:
    """Correct all hypotheses; result and `accepted` are of the one that leads; (how many remain, a small gate)."""
    result, least, telling = m.result, math.inf, False
    for k in range(count):
        copy_pose(bank[k], m.best)
        seen, groups, used, nis = spot_update(m, bank[k], sensitivities[k], spots, covariances)
        if k == 0 or bank[k]["score"] < least:
            least = bank[k]["score"]
            result["nis"], result["dof"], result["seen"], result["used"] = nis, 2 * groups, seen, used
            telling = _telling(m, m.best["ld"], groups)
            for i in range(spots.shape[0]):
                m.accepted[i] = 0.0
            for g in range(groups):
                if m.groups[g]["tested"] > 0:
                    m.accepted[int(m.which[g])] = 1.0
    if result["used"] == 0:
        for i in range(spots.shape[0]):
            m.accepted[i] = 0.0
    return order_bank(m, bank, sensitivities, count), telling


@kernel
def _clear(result: Record, accepted: Vector) -> None:
    result["nis"], result["dof"], result["seen"], result["used"] = math.nan, 0, 0, 0
    result["status"] = WAITING
    for i in range(accepted.shape[0]):
        accepted[i] = 0.0


@kernel
def _mark_used(used_s: Vector, accepted: Vector, t: float) -> None:
    for i in range(used_s.shape[0]):
        if accepted[i] > 0.0:
            used_s[i] = t


@kernel
def _confirm(m: PoseMemory, t: float, spots: Matrix, covariances: Stack) -> int:
    """Test the trial with an image of three markers or more; if it is confirmed it now is the bank."""
    clock, result = m.clock, m.result
    if clock["trial"] == 0:
        return CONTRADICTED
    remain, telling = _correct_bank(m, m.trial, m.trial_sensitivities, clock["trial"], spots, covariances)
    if result["used"] < 3 or result["used"] < result["seen"]:
        clock["trial"] = 0
        return CONTRADICTED
    clock["trial"] = remain
    _mark_used(m.trial_used_s, m.accepted, t)
    if not telling:
        return GOES_ON
    for k in range(remain):
        copy_pose(m.trial[k], m.bank[k])
        copy_rows(m.trial_sensitivities[k], m.bank_sensitivities[k])
    for i in range(m.used_s.shape[0]):
        m.used_s[i] = m.trial_used_s[i]
    clock["running"], clock["trial"], clock["rejected"], clock["renewed"] = remain, 0, 0, t
    return CONFIRMED


@shared_entry
def pose_step(block: Vector, t: float, chaser: Matrix, spots: Matrix, covariances: Stack) -> int:
    """Go on to t and use the spots (n, 2) px of an image taken there, (0, 2) = none; what to look for afterwards.

    The control in `motion` acts since the last event: the acceleration all the time, the impulse at its end. chaser
    (3, 3): its attitude. covariances (n, 2, 2) or (0, 2, 2). The status stands in the result.
    """
    m = pose_views(block)
    clock, result = m.clock, m.result
    _clear(result, m.accepted)
    dt = t - clock["t"] if clock["t"] == clock["t"] else 0.0
    v = m.motion["delta_v"]
    if (clock["running"] > 0 or clock["trial"] > 0) and (dt > 0.0 or v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0):
        prepare_step(m.step, m.motion, m.scratch, clock["t"], dt)
        body, step, scratch, orbit, at, taken = m.body, m.step, m.scratch, m.motion["orbit"], clock["t"], m.step["dt"]
        clock["running"] = advance_bank(
            body, step, scratch, orbit, m.bank, m.bank_sensitivities, clock["running"], at, taken
        )
        clock["trial"] = advance_bank(
            body, step, scratch, orbit, m.trial, m.trial_sensitivities, clock["trial"], at, taken
        )
    clock["t"] = t
    aim_camera(m.camera, chaser)
    seen = 0
    for i in range(spots.shape[0]):
        seen += 1 if has_spot(spots, i) else 0
    running = clock["running"] > 0
    if not running:
        clock["rejected"] = 0
    if seen == 0:
        result["status"] = PREDICTED if running else WAITING
        return NOTHING
    search = not running
    if running and seen >= 3 and is_wide(m.bank[0]):
        search = True
        result["seen"], result["status"] = seen, PREDICTED
    elif running:
        clock["running"], _ = _correct_bank(m, m.bank, m.bank_sensitivities, clock["running"], spots, covariances)
        used = result["used"]
        result["status"] = REJECTED if used == 0 else (UPDATED if used == result["seen"] else PARTIAL)
        if used > 0:
            _mark_used(m.used_s, m.accepted, t)
        if 2 * used <= seen:
            clock["rejected"] += 1
        else:
            clock["rejected"], clock["trial"] = 0, 0
        search = clock["rejected"] >= m.fixed["restart_after"]
    if not search:
        if seen >= 3 and t - clock["renewed"] >= RENEWED_S:
            clock["renewed"] = t
            return NEW_ROOTS
        return NOTHING
    if seen < 3:
        return NOTHING
    nis, dof, used, status = result["nis"], result["dof"], result["used"], result["status"]
    for i in range(spots.shape[0]):
        m.accepted_aside[i] = m.accepted[i]
    outcome = _confirm(m, t, spots, covariances)
    if outcome == CONFIRMED:
        result["status"] = STARTED
        return NOTHING
    result["nis"], result["dof"], result["used"], result["status"] = nis, dof, used, status
    result["seen"] = seen
    for i in range(spots.shape[0]):
        m.accepted[i] = m.accepted_aside[i]
    return NOTHING if outcome == GOES_ON else ROOTS
