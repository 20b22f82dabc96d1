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
from relnav.navigation.marker_monitors import gather_markers, let_pass, watch_markers, watch_new_track
from relnav.navigation.marker_observation import aim_camera, has_spot, observe_markers
from relnav.navigation.pose_epoch import SETTLED_S
from relnav.navigation.pose_exchange import gates_share, is_exchanged
from relnav.navigation.pose_memory import POSE, PoseMemory, pose_views
from relnav.navigation.pose_propagation import advance_bank, copy_pose, copy_rows, is_wide
from relnav.navigation.propagation import prepare_step
from relnav.navigation.status import EXCHANGED, PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING

DROP = 2.0 * math.log(1e6)
RENEWED_S, RENEWED_BLURRED_S = 10.0, 0.4
"""How often roots are looked for that no hypothesis covers; the second while the leading one is wide and after."""
BLURRED = 0.5
"""Of ln |R| by the second order of an image: the leading hypothesis then may cover roots that it cannot tell apart."""
JOINED = 1.0  # chi-square of twelve: two hypotheses this near are one
TELLING_SHARE = 0.01
"""Of the image that a spot's gate may cover where it is to confirm a start, or the exchange of markers."""
LONE_SHARE = 0.001
"""Of the image that the gate of a spot may cover that is seen alone."""
SETTLING_S = 10.0
"""After a pose was taken up beside others: what it learns of velocity and rate is not held against it."""
AGREED = 2
"""Images that must confirm a trial which is to replace a track that is contradicted."""

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
    for i in range(POSE):
        for j in range(POSE):
            g[i, j] = 1.0 if i == j else 0.0
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
def _noise_log_determinant(image: Observed) -> float:
    """Of the noise of all rows that the last sweep took in."""
    total = 0.0
    for i in range(image.groups.shape[0]):
        if image.independent[i]["tested"] > 0:
            variance = image.independent[i]["variance"]
            total += math.log(variance[0]) + math.log(variance[1])
    return total


@kernel
def spot_update(
    m: PoseMemory, track: Record, sensitivities: Matrix, spots: Matrix, covariances: Stack
) -> tuple[int, int, int, float]:
    """Correct a hypothesis by an image; (markers seen, groups, groups used, NIS), its score counted on.

    sensitivities (m, 12) of the hypothesis. Which groups were used stands in `groups`. A rejected spot costs what one
    at the gate's limit would. Of an image of which half the spots or more contradict the hypothesis nothing is used:
    those that pass may be glints as well; nor is a lone spot through a wide gate.
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
    taken, wide = nis, seen == 1 and used == 1 and not gates_share(m, track["ld"], 1) < LONE_SHARE
    if (seen > 1 and 2 * used <= seen) or wide:
        used = 0
        for k in range(count):
            m.groups[k]["tested"] = 0
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
        bending, width = m.scratch["bending"], log_determinant(image)
        track["score"] += taken + width
        track["doubt"] += bending + min(1.0, bending) * max(0.0, taken - 2.0 * used)
        if m.clock["t"] - track["added"] <= SETTLING_S:
            track["doubt"] += max(0.0, width - _noise_log_determinant(image))
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
        alone = kept == 0 or one["score"] - one["doubt"] - bank[0]["score"] <= DROP
        for k in range(kept):
            if _distance2(m.scratch["error"], bank[k], one) <= JOINED:
                alone = False
        if alone:
            copy_pose(one, bank[kept])
            copy_rows(m.spare_sensitivities[order[i]], sensitivities[kept])
            kept += 1
    return kept


@kernel
def _correct_bank(
    m: PoseMemory, bank: Record, sensitivities: Stack, count: int, spots: Matrix, covariances: Stack, watched: bool
) -> tuple[int, bool, bool]:
    """Correct all hypotheses; result and `accepted` are of the one that leads; watched: so are the monitors' rows.

    Returns how many remain, whether the leading one's gates were small, so that a glint would hardly pass, and whether
    it is too wide to tell roots apart, or has not led before.
    """
    result, least, telling, blurred = m.result, math.inf, False, False
    for k in range(count):
        copy_pose(bank[k], m.best)
        seen, groups, used, nis = spot_update(m, bank[k], sensitivities[k], spots, covariances)
        if watched and k == 0:
            gather_markers(m, m.best, groups, covariances)
        if k == 0 or bank[k]["score"] < least:
            least = bank[k]["score"]
            result["nis"], result["dof"], result["seen"], result["used"] = nis, 2 * groups, seen, used
            telling = gates_share(m, m.best["ld"], groups) < TELLING_SHARE
            blurred = k > 0 or m.scratch["bending"] >= BLURRED
            for i in range(spots.shape[0]):
                m.accepted[i] = 0.0
            for g in range(groups):
                if m.groups[g]["tested"] > 0:
                    m.accepted[int(m.which[g])] = 1.0
    if result["used"] == 0:
        for i in range(spots.shape[0]):
            m.accepted[i] = 0.0
    return order_bank(m, bank, sensitivities, count), telling, blurred


@kernel
def _clear(result: Record, accepted: Vector) -> None:
    result["nis"], result["dof"], result["seen"], result["used"] = math.nan, 0, 0, 0
    result["status"], result["alarm"] = WAITING, 0
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
    remain, telling, blurred = _correct_bank(
        m, m.trial, m.trial_sensitivities, clock["trial"], spots, covariances, False
    )
    if result["used"] < 3 or result["used"] < result["seen"]:
        clock["trial"] = 0
        return CONTRADICTED
    clock["trial"] = remain
    _mark_used(m.trial_used_s, m.accepted, t)
    clock["agreed"] += 1
    if not telling or ((clock["rejected"] > 0 or m.watch["restart"] > 0) and clock["agreed"] < AGREED):
        return GOES_ON
    for k in range(remain):
        copy_pose(m.trial[k], m.bank[k])
        copy_rows(m.trial_sensitivities[k], m.bank_sensitivities[k])
    for i in range(m.used_s.shape[0]):
        m.used_s[i] = m.trial_used_s[i]
    clock["running"], clock["trial"], clock["rejected"], clock["renewed"] = remain, 0, 0, t
    clock["blurred"] = t if blurred else -math.inf
    return CONFIRMED


@kernel
def _advance(m: PoseMemory, t: float) -> None:
    """Carry bank and trial to t, the control acting."""
    clock, v = m.clock, m.motion["delta_v"]
    dt = t - clock["t"] if clock["t"] == clock["t"] else 0.0
    if (clock["running"] > 0 or clock["trial"] > 0) and (dt > 0.0 or v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0):
        prepare_step(m.step, m.motion, m.scratch, clock["t"], dt)
        body, step, scratch, orbit, at, taken = m.body, m.step, m.scratch, m.motion["orbit"], clock["t"], m.step["dt"]
        clock["running"] = advance_bank(
            body, step, scratch, orbit, m.bank, m.bank_sensitivities, clock["running"], at, taken
        )
        clock["trial"] = advance_bank(
            body, step, scratch, orbit, m.trial, m.trial_sensitivities, clock["trial"], at, taken
        )
        let_pass(m, dt)
    if math.isnan(clock["begun"]):
        clock["begun"] = t
    clock["t"] = t


@kernel
def _use(m: PoseMemory, t: float, spots: Matrix, covariances: Stack, seen: int) -> int:
    """Correct the bank with an image; what is then to be looked for: nothing, poses to restart from, or others."""
    clock, result = m.clock, m.result
    clock["running"], _, blurred = _correct_bank(
        m, m.bank, m.bank_sensitivities, clock["running"], spots, covariances, True
    )
    used = result["used"]
    result["status"] = REJECTED if used == 0 else (UPDATED if used == result["seen"] else PARTIAL)
    if used > 0:
        _mark_used(m.used_s, m.accepted, t)
        if blurred:
            clock["blurred"] = t
    watch_markers(m, t, spots, covariances)
    anew = m.watch["restart"] > 0
    if 2 * used <= seen:
        clock["rejected"] += 1
    else:
        clock["rejected"] = 0
        if not anew:
            clock["trial"] = 0
    if seen - used >= 2:
        lead, effects = m.bank[0], m.bank_sensitivities[0]
        if is_exchanged(m, lead, effects, spots, covariances, seen, TELLING_SHARE):
            result["alarm"], clock["trial"] = EXCHANGED, 0
            return NOTHING
    if clock["rejected"] >= m.fixed["restart_after"] or anew:
        return ROOTS
    # of an image that was used whole alone: another one's poses are those of its glints
    often = RENEWED_BLURRED_S if t - clock["blurred"] <= SETTLED_S else RENEWED_S
    if seen >= 3 and used == seen and t - clock["renewed"] >= often:
        clock["renewed"] = t
        return NEW_ROOTS
    return NOTHING


@kernel
def _look(m: PoseMemory, t: float, spots: Matrix, covariances: Stack) -> int:
    """Use the spots, or look for a start on them; what the caller is to look for."""
    clock, result, seen = m.clock, m.result, 0
    for i in range(spots.shape[0]):
        seen += 1 if has_spot(spots, i) else 0
    running = clock["running"] > 0
    if not running:
        clock["rejected"] = 0
    if seen == 0:
        result["status"] = PREDICTED if running else WAITING
        return NOTHING
    if running and seen >= 3 and is_wide(m.bank[0]):
        result["seen"], result["status"] = seen, PREDICTED
    elif running:
        wants = _use(m, t, spots, covariances, seen)
        if wants != ROOTS:
            return wants
    if seen < 3:
        return NOTHING
    nis, dof, used, status = result["nis"], result["dof"], result["used"], result["status"]
    for i in range(spots.shape[0]):
        m.accepted_aside[i] = m.accepted[i]
    outcome = _confirm(m, t, spots, covariances)
    if outcome == CONFIRMED:
        watch_new_track(m, running)
        result["status"] = STARTED
        return NOTHING
    result["nis"], result["dof"], result["used"], result["status"] = nis, dof, used, status
    result["seen"] = seen
    for i in range(spots.shape[0]):
        m.accepted[i] = m.accepted_aside[i]
    return NOTHING if outcome == GOES_ON else ROOTS


@shared_entry
def pose_step(block: Vector, t: float, chaser: Matrix, spots: Matrix, covariances: Stack) -> int:
    """Go on to t and use the spots (n, 2) px of an image taken there, (0, 2) = none; what to look for afterwards.

    The control in `motion` acts since the last event: the acceleration all the time, the impulse at its end. chaser
    (3, 3): its attitude. covariances (n, 2, 2) or (0, 2, 2). The status stands in the result.
    """
    m = pose_views(block)
    _clear(m.result, m.accepted)
    _advance(m, t)
    aim_camera(m.camera, chaser)
    wants = _look(m, t, spots, covariances)
    if m.clock["running"] > 0:
        m.result["alarm"] |= m.watch["alarm"]
    return wants
