"""One epoch of the marker filter: a bank of hypotheses predicted, corrected, started and started again.

A flat pattern has up to four poses that explain an image; a filter on the most credible one alone may follow the wrong
one for ever. Each root starts a hypothesis, its covariance widened (seen head-on the misfit is no parabola, and the
truth lies up to 3 sigma off). One of these that is beaten, so that the leading one could be relied on, falls. Was it
new, or is some of what it lost in doubt, its pose gets a second one at once: what was wrong may have been the first's
linearisation. Only when that one is beaten too is the leading one relied on.

All roots of three spots fit them, in every image, and most move as bodies can. Every ten seconds hypotheses start on
roots that none covers: of the image, and of the spots that the leading one predicts. A pose that was beaten has none
for 50 s. Beside a leading one that is relied on they begin a million times less likely, and remain until they fall or
images speak for them. Otherwise they begin as likely as the best and fall when they are a million times less likely.
Two that have become one are joined.

Start: the roots of one image open a trial; the next image of three markers or more that the trial's leading hypothesis
predicts, all spots inside the gate and the gates small, confirms it. An image that contradicts the trial opens another
one. Lock-out: after `restart after` epochs in a row with at least half of what was seen rejected, or when after a gap
errors no longer count as small, trials run beside the bank, and a confirmed one replaces it.

A spot that is refused image after image, others being used, is bad or tells that the pose is wrong. After `restart
after` images in a row poses are looked for that explain all spots: of four or more a bad one leaves none. Three always
have one; a hypothesis of it starts only if that spot has not been used since the leading one was too wide to tell roots
apart. While two spots bear a pose that a third contradicts so, the alarm is CONTRADICTED.

Roots come from the closed form, which is not compiled in here: `wants` says what the caller is to look for.
"""

import math

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import kernel, shared_entry
from relnav.dynamics.error_state import POSE
from relnav.estimation.monitors import CONTRADICTED as CONTRADICTS
from relnav.estimation.rows import copy_rows
from relnav.navigation.blocks import MOUNTING
from relnav.navigation.observation.marker_exchange import gates_share, is_exchanged
from relnav.navigation.observation.marker_monitors import gather_markers, let_pass, watch_markers, watch_new_track
from relnav.navigation.observation.marker_rows import aim_camera, has_spot
from relnav.navigation.pose_bending import take_bends
from relnav.navigation.pose_epoch import SETTLED_S, is_contested
from relnav.navigation.pose_memory import MOST_POSES, PoseMemory, pose_views
from relnav.navigation.pose_propagation import (
    advance_bank,
    copy_pose,
    errors_between,
    is_wide,
    odds_against,
)
from relnav.navigation.pose_update import SETTLING_S, spot_update
from relnav.navigation.propagation import prepare_step
from relnav.navigation.status import EXCHANGED, PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT

DROP = 2.0 * math.log(1e6)
"""How far behind the best a pose of a trial may be, or one taken up later."""
MARGIN = DROP - AMBIGUITY_LIMIT
"""By how much one taken up beside a leading one that is relied on has to gain to put that in doubt, or lose to fall."""
RENEWED_S, RENEWED_BLURRED_S = 10.0, 0.4
"""How often roots are looked for that no hypothesis covers; the second while the leading one is wide and after."""
BLURRED = 0.5
"""Of ln |R| by the second order of an image: the leading hypothesis then may cover roots that it cannot tell apart."""
JOINED, JOINED_LATE = 1.0, 6.3
"""Chi-square of twelve: two hypotheses this near are one, by the covariance of the better one, or by that of one that
was taken up beside it and has settled: nine of ten that are draws of its own errors are farther off."""
CHANCE = 1.0
"""Twice a log-likelihood: one of the start that has so little of what it lost in doubt has had its chance."""
TELLING_SHARE = 0.01
"""Of the image that a spot's gate may cover where it is to confirm a start, or the exchange of markers."""
AGREED = 2
"""Images that must confirm a trial which is to replace a track that is contradicted."""

NOTHING, ROOTS, NEW_ROOTS = 0, 1, 2
"""What the caller is to look for: poses to open a trial with; poses that no hypothesis covers."""

CONTRADICTED, GOES_ON, CONFIRMED = 0, 1, 2
"""What an image says of a trial; one that agrees with it while its gates are large proves nothing, and it goes on."""


@kernel
def _distance2(e: Vector, one: Record, other: Record) -> float:
    """Chi-square of twelve between two hypotheses, by the covariance of the first; e (12,) is scratch."""
    ld, total = one["ld"], 0.0
    errors_between(one, other, e)
    for i in range(POSE):
        for j in range(i):
            e[i] -= ld[i, j] * e[j]
        total += e[i] * e[i] / ld[i, i]
    return total


@kernel
def _rank(track: Record) -> float:
    """Minus twice the logarithm of how likely a hypothesis is, up to a constant."""
    return float(track["score"] + track["prior"])


@kernel
def order_bank(
    m: PoseMemory, bank: Record, sensitivities: Stack, evidence: Stack, count: int, far_behind: float
) -> int:
    """The most credible first, those far behind and those that have become one with a better one left out.

    far_behind: for hypotheses of the start; DROP for those taken up beside others.
    """
    if count < 2:
        return count
    order, fell, spare, kept = m.scratch["order"], m.scratch["fell"], m.spare, 0
    for i in range(count):
        order[i], fell[i] = i, 0
        copy_pose(bank[i], spare[i])
        copy_rows(sensitivities[i], m.spare_sensitivities[i])
        copy_rows(evidence[i], m.spare_evidence[i])
    for i in range(1, count):
        k, j = order[i], i
        while j > 0 and _rank(spare[order[j - 1]]) > _rank(spare[k]):
            order[j] = order[j - 1]
            j -= 1
        order[j] = k
    for i in range(count):
        one = spare[order[i]]
        limit = far_behind
        if one["added"] > -math.inf:
            limit = max(DROP, one["prior"] - bank[0]["prior"] + MARGIN)
        alone = kept == 0 or odds_against(one, bank[0]) <= limit
        if not alone:
            fell[order[i]] = 1
        settled = -math.inf < one["added"] < m.clock["t"] - SETTLING_S
        for k in range(kept):
            if _distance2(m.scratch["error"], bank[k], one) <= JOINED:
                alone = False
            if settled and _distance2(m.scratch["error"], one, bank[k]) <= JOINED_LATE:
                alone = False
        if alone:
            copy_pose(one, bank[kept])
            copy_rows(m.spare_sensitivities[order[i]], sensitivities[kept])
            copy_rows(m.spare_evidence[order[i]], evidence[kept])
            kept += 1
    return kept


@kernel
def _correct_bank(
    m: PoseMemory,
    bank: Record,
    sensitivities: Stack,
    evidence: Stack,
    count: int,
    far_behind: float,
    spots: Matrix,
    covariances: Stack,
    watched: bool,
) -> tuple[int, bool, bool]:
    """Correct all hypotheses, those left out that are far behind; result and `accepted` are of the one that leads.

    watched: so are the monitors' rows.

    Returns how many remain, whether the leading one's gates were small, so that a glint would hardly pass, and whether
    it is too wide to tell roots apart, or has not led before.
    """
    result, least, telling, blurred = m.result, math.inf, False, False
    for k in range(count):
        copy_pose(bank[k], m.best)
        # nothing is compared with one alone; of the attitude alone, which the pose takes up, spots show nothing
        told = evidence[k] if count > 1 and sensitivities.shape[1] > MOUNTING else evidence[k, :0]
        seen, groups, used, nis = spot_update(m, bank[k], sensitivities[k], told, spots, covariances, k == 0)
        if watched and k == 0:
            gather_markers(m, m.best, groups, covariances)
        if k == 0 or _rank(bank[k]) < least:
            least = _rank(bank[k])
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
    return order_bank(m, bank, sensitivities, evidence, count, far_behind), telling, blurred


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
        m, m.trial, m.trial_sensitivities, m.trial_evidence, clock["trial"], DROP, spots, covariances, False
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
        copy_rows(m.trial_evidence[k], m.bank_evidence[k])
    for i in range(m.used_s.shape[0]):
        m.used_s[i] = m.trial_used_s[i]
    for k in range(MOST_POSES):
        m.beaten[k]["t"] = -math.inf
    clock["running"], clock["trial"], clock["rejected"], clock["renewed"] = remain, 0, 0, t
    clock["confirmed"] = t
    clock["blurred"], clock["doubted"] = t if blurred else -math.inf, -math.inf
    return CONFIRMED


@kernel
def _advance(m: PoseMemory, t: float) -> None:
    """Carry bank and trial to t, the control acting."""
    clock, v = m.clock, m.motion["delta_v"]
    dt = t - clock["t"] if clock["t"] == clock["t"] else 0.0
    if (clock["running"] > 0 or clock["trial"] > 0) and (dt > 0.0 or v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0):
        prepare_step(m.step, m.motion, m.scratch, clock["t"], dt)
        body, step, scratch, orbit, at, taken = m.body, m.step, m.scratch, m.motion["orbit"], clock["t"], m.step["dt"]
        by, told, bents, running = m.bank_sensitivities, m.bank_evidence, m.bents, clock["running"]
        clock["running"] = advance_bank(body, step, scratch, orbit, m.bank, by, told, bents, running, at, taken)
        by, told, trial = m.trial_sensitivities, m.trial_evidence, clock["trial"]
        clock["trial"] = advance_bank(body, step, scratch, orbit, m.trial, by, told, bents[:0], trial, at, taken)
        let_pass(m, dt)
    if math.isnan(clock["begun"]):
        clock["begun"] = t
    clock["t"] = t


@kernel
def _count_first(bank: Record, count: int) -> int:
    """How many of the hypotheses are of the start."""
    first = 0
    for k in range(count):
        if bank[k]["added"] == -math.inf:
            first += 1
    return first


@kernel
def keep_beaten(m: PoseMemory, t: float, before: int) -> int:
    """Keep the poses of those of the bank that fell and have had their chance; how many of these were of the start.

    Of another leading one's nothing is kept.
    """
    clock, lead, first = m.clock, m.bank[0]["dcm"], 0
    if before > 1 and m.scratch["order"][0] != 0:
        for k in range(MOST_POSES):
            m.beaten[k]["t"] = -math.inf
    for k in range(before if before > 1 else 0):
        one, late = m.spare[k], m.spare[k]["added"] > -math.inf
        tracked = one["doubt"] <= CHANCE and t - clock["confirmed"] > SETTLING_S
        if m.scratch["fell"][k] > 0 and (late or tracked):
            first += 0 if late else 1
            kept, dcm = m.beaten[clock["beaten"]], one["dcm"]
            clock["beaten"] = (clock["beaten"] + 1) % MOST_POSES
            kept["t"] = t
            for i in range(3):
                for j in range(3):
                    kept["dcm"][i, j] = lead[0, i] * dcm[0, j] + lead[1, i] * dcm[1, j] + lead[2, i] * dcm[2, j]
    return first


@kernel
def _is_denied(m: PoseMemory, spots: Matrix) -> bool:
    """Count how often in a row each spot was refused, others not; whether one was too often, and tells of the pose.

    Of three spots it does so only if it was not used since the leading hypothesis was too wide to tell roots apart.
    """
    used, seen, lasts, tells = m.result["used"], m.result["seen"], False, False
    for i in range(m.spots.shape[0]):
        spot = m.spots[i]
        if m.accepted[i] > 0.0:
            spot["denied"] = 0
        elif used > 0 and has_spot(spots, i):
            spot["denied"] += 1
        if spot["denied"] >= m.fixed["restart_after"]:
            lasts = True
            tells = tells or seen > 3 or not m.used_s[i] > m.clock["blurred"]
    if used > 0:
        m.clock["denied"] = 1 if lasts and used < 3 else 0
    return tells


@kernel
def _use(m: PoseMemory, t: float, spots: Matrix, covariances: Stack, seen: int) -> int:
    """Correct the bank with an image; what is then to be looked for: nothing, poses to restart from, or others."""
    clock, result = m.clock, m.result
    before, first = clock["running"], _count_first(m.bank, clock["running"])
    clock["running"], _, blurred = _correct_bank(
        m, m.bank, m.bank_sensitivities, m.bank_evidence, before, AMBIGUITY_LIMIT, spots, covariances, True
    )
    if _count_first(m.bank, clock["running"]) + keep_beaten(m, t, before) < first:
        clock["renewed"] = -math.inf
    used = result["used"]
    result["status"] = REJECTED if used == 0 else (UPDATED if used == result["seen"] else PARTIAL)
    if used > 0:
        _mark_used(m.used_s, m.accepted, t)
        if blurred:
            clock["blurred"] = t
    tells = _is_denied(m, spots)
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
    # of an image that was used whole: another one's poses are those of its glints, unless the same spot is refused long
    often = RENEWED_BLURRED_S if t - clock["blurred"] <= SETTLED_S else RENEWED_S
    if seen >= 3 and (used == seen or (used > 0 and tells)) and t - clock["renewed"] >= often:
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
    take_bends(m.body, m.bank, m.bents, clock["running"])
    if running and seen >= 3 and is_wide(m.bank[0], m.bank_sensitivities[0, m.lasting["shown"] :]):
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
        m.result["alarm"] |= m.watch["alarm"] | (CONTRADICTS if m.clock["denied"] > 0 else 0)
        if is_contested(m):
            m.clock["doubted"] = t
    return wants
