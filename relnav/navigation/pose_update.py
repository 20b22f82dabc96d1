"""One hypothesis of the marker filter corrected by an image: gate, update, score, errors folded into the state."""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.dynamics.error_state import MOTION, POSE, RATE, ROTATION, THETA, VELOCITY
from relnav.estimation.considered import follow_turn, update_sensitivities
from relnav.estimation.factored import orthogonalise, spread
from relnav.estimation.lasting_evidence import surprise
from relnav.estimation.rows import Observed, copy_rows, copy_track, gate_groups, log_determinant, pair_covariance, sweep
from relnav.geometry.rotation_vector import turn_by_rotation_vector
from relnav.navigation.blocks import CHASER_ATTITUDE, MOUNTING
from relnav.navigation.observation.marker_exchange import gates_share
from relnav.navigation.observation.marker_rows import observe_markers
from relnav.navigation.pose_inertia import take_against_inertia
from relnav.navigation.pose_memory import PoseMemory

LONE_SHARE = 0.001
"""Of the image that the gate of a spot may cover that is seen alone."""
SETTLING_S = 10.0
"""After a pose was taken up beside others: what it learns of velocity and rate is not held against it."""


@straight_line(ld=(POSE, POSE), half=(3,))
def turn_errors(ld: Matrix, half: Vector) -> None:
    """Replace the factors of P by those of G P G^T, G = I - [half x] for the attitude's errors, I for the others.

    Of L, G mixes three rows alone. Their square is factored anew; what stands below in its columns goes along.
    """
    turn, attitude = np.zeros((3, 3)), ld[THETA:RATE]
    turn[0, 1], turn[0, 2], turn[1, 2] = half[2], -half[1], half[0]
    for i in range(3):
        turn[i, i] = 1.0
        for j in range(i):
            turn[i, j] = -turn[j, i]
    for k in range(THETA):
        x, y, z = attitude[0, k], attitude[1, k], attitude[2, k]
        for i in range(3):
            attitude[i, k] = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z
    square, below = ld[THETA:RATE, THETA:RATE], ld[RATE:, THETA:RATE]
    w, weights, turned = np.zeros((ROTATION, 3)), np.zeros(3), np.zeros((ROTATION, ROTATION))
    spread(turn, square, w[:3], weights)
    for i in range(3):
        for k in range(3):
            w[3 + i, k] = below[i, k]
    orthogonalise(w, weights, turned)
    for k in range(3):
        for i in range(3):
            below[i, k] = turned[3 + i, k]
            if i >= k:
                square[i, k] = turned[i, k]


@kernel
def take_in(scratch: Record, track: Record, sensitivities: Matrix) -> None:
    """Fold the errors that an update has estimated into motion, attitude and rate; covariance then is about these.

    P <- G P G^T and S <- G S, G = I - [theta x] / 2 (Markley and Crassidis 2014, ch. 6).
    """
    x, motion, rate, dcm = track["state"], track["motion"], track["rate"], track["dcm"]
    turned, half = scratch["turned"], scratch["point"]
    for i in range(MOTION):
        motion[i] += x[i]
    turn_by_rotation_vector(dcm, x[THETA:RATE], turned)
    for i in range(3):
        rate[i] += x[RATE + i]
        for j in range(3):
            dcm[i, j] = turned[i, j]
    a, b, c = 0.5 * x[6], 0.5 * x[7], 0.5 * x[8]
    half[0], half[1], half[2] = a, b, c
    turn_errors(track["ld"], half)
    for k in range(sensitivities.shape[0]):
        s = sensitivities[k]
        u, v, w = s[6], s[7], s[8]
        s[6], s[7], s[8] = u + c * v - b * w, v - c * u + a * w, w + b * u - a * v
    for i in range(POSE):
        x[i] = 0.0


@kernel
def _follow(sigma: float, axis: Vector, track: Record, row: Vector) -> None:
    """Let what a turn by sigma about an axis, `lvlh_ccsds`, does to an estimate follow the errors that correct it.

    It turns the attitude by C^T a, and where C is corrected by theta what follows is that - theta x C^T a: one half is
    `take_in`'s, the other is here.
    """
    x, dcm = track["state"], track["dcm"]
    follow_turn(sigma, axis, x[:VELOCITY], row[:VELOCITY])
    follow_turn(sigma, axis, x[VELOCITY:MOTION], row[VELOCITY:MOTION])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        along_j, along_k = 0.0, 0.0
        for n in range(3):
            along_j += dcm[n, j] * axis[n]
            along_k += dcm[n, k] * axis[n]
        row[THETA + i] += 0.5 * sigma * (x[THETA + j] * along_k - x[THETA + k] * along_j)


@kernel
def refer_turns(m: PoseMemory, track: Record, sensitivities: Matrix) -> None:
    """Let what turns of chaser and camera do to a hypothesis follow the errors (12,) that correct it."""
    for axis in range(3):
        _follow(m.lasting["attitude"], m.camera["chaser"][axis], track, sensitivities[CHASER_ATTITUDE + axis])
        if m.lasting["shown"] > MOUNTING:
            _follow(m.lasting["mounting"], m.camera["cam_from_lvlh"][axis], track, sensitivities[MOUNTING + axis])


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
def _lasting_surprise(m: PoseMemory, track: Record, evidence: Matrix, count: int) -> float:
    """Minus twice the logarithm of how likely the innovations of the used of `count` groups are: `surprise`.

    Their covariance without lasting errors is H P H^T + R - G G^T, as R of the rows holds G G^T.
    """
    ld, rows = track["ld"], 0
    S, G, along = m.spread, m.shown, m.along
    for i in range(2 * count):
        if m.groups[i // 2]["tested"] == 0:
            continue
        h = m.groups[i // 2]["gradient"][i % 2]
        for j in range(POSE):
            along[rows, j] = h[j]
            for k in range(j + 1, POSE):
                along[rows, j] += ld[k, j] * h[k]
        for c in range(G.shape[1]):
            G[rows, c] = m.by_error[i, c]
        place = 0
        for k in range(i + 1):
            if m.groups[k // 2]["tested"] > 0:
                S[rows, place] = m.noise[i, k]
                for j in range(POSE):
                    S[rows, place] += along[rows, j] * ld[j, j] * along[place, j]
                for c in range(G.shape[1]):
                    S[rows, place] -= G[rows, c] * G[place, c]
                place += 1
        m.innovation[rows] = m.groups[i // 2]["residual"][i % 2]
        rows += 1
    return surprise(evidence, S[:rows, :rows], m.innovation[:rows], G[:rows], m.told)


@kernel
def spot_update(
    m: PoseMemory,
    track: Record,
    sensitivities: Matrix,
    evidence: Matrix,
    spots: Matrix,
    covariances: Stack,
    leads: bool,
) -> tuple[int, int, int, float]:
    """Correct a hypothesis by an image; (markers seen, groups, groups used, NIS), its score counted on.

    sensitivities (m, 12) of the hypothesis, evidence (m + 1, m) of lasting errors by it, or (0, m); leads: whether it
    is the leading one, which comes first. Which groups were used stands in `groups`. A rejected spot costs what one at
    the gate's limit would, but an image no more than all of it would: the gate rejects good spots too. Of an image of
    which half the spots or more contradict the hypothesis nothing is used: those that pass may be glints as well; nor
    is a lone spot through a wide gate.
    """
    limit, scratch = m.gate[1], m.scratch
    if leads:
        scratch["lead_used"] = 0
    seen, count = observe_markers(m, track, sensitivities, spots, covariances)
    track["score"] += (seen - count) * (limit + 4.0 * math.log(m.camera["noise"]))
    if count == 0:
        return seen, 0, 0, math.nan
    n = 2 * count
    image = Observed(m.groups[:count], m.noise[:n, :n], m.factor[:n, :n], m.independent[:count])
    nis, dof = sweep(track, track["state"], image, m.work)
    whole, cost = nis + log_determinant(image), 0.0
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
                cost += limit + math.log(xx * yy - xy * xy)
        if used > 0:
            taken, _ = sweep(track, track["state"], image, m.work)
    if used > 0:
        bending, width = scratch["bending"], log_determinant(image)
        cost += _lasting_surprise(m, track, evidence, count) if evidence.shape[0] > 0 else taken + width
        track["doubt"] += bending + min(1.0, bending) * max(0.0, taken - 2.0 * used)
        if leads:
            scratch["lead_used"], scratch["lead_width"] = used, width
            copy_rows(m.by_error[:n], m.left)
        if m.clock["t"] - track["added"] <= SETTLING_S:
            known = _noise_log_determinant(image)
            if not leads and scratch["lead_used"] == used:
                known = max(known, scratch["lead_width"])
            track["doubt"] += max(0.0, width - known)
        if m.lasting["shown"] < sensitivities.shape[0]:
            take_against_inertia(m, track, sensitivities, count)
        else:
            copy_track(m.work, track)
            update_sensitivities(track["ld"], image, m.by_error[:n], m.news, sensitivities)
        refer_turns(m, track, sensitivities)
        take_in(m.scratch, track, sensitivities)
    track["score"] += cost if used == count else min(whole, cost)
    return seen, count, used, nis
