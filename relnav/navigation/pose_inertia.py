"""What an inertia of the target that is not quite known does to a hypothesis of the marker filter.

An error that lasts, considered and not estimated (Schmidt 1966), as `attitude.prediction` has it. C (6, 12), the last
rows of S, is what one sigma of each entry of the inertia has done to the estimate. It works in the motion,

    C <- Phi C + B          over a step, B what it does meanwhile (`dynamics/inertia_error.py`)

and images must work against it, so that the gain counts it: it is that of P + C^T C, without what C adds to the noise.
Of the filter's own factors this leaves

    P <- P' + V^T V,   V = L^-1 H C^T C+,   H P H^T + R = L L^T

P' those by the gain that knows nothing of C, C+ what C becomes: P+ = (1 - K H) P (1 - K H)^T + K R K^T, summed up from
parts none of which is negative.
"""

import math

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.dynamics.error_state import POSE, ROTATION, THETA
from relnav.dynamics.inertia_error import inertia_effect_into, second_order_square, turn_time
from relnav.dynamics.rigid_body import FRAME_RATE, ORBIT, carry_transition, propagate_into, step_count
from relnav.estimation.considered import join_considered, update_sensitivities
from relnav.estimation.factored import add_rank_one
from relnav.estimation.rows import Observed, copy_track, sweep
from relnav.geometry.linear_algebra import cholesky
from relnav.navigation.pose_memory import PoseMemory

STEPS_A_PIECE = 4
"""Runge-Kutta steps in which what the inertia does is followed as one: a turn of 0.2 rad (`attitude.prediction`)."""


@kernel
def _push(before: Matrix, after: Matrix, phi: Matrix, dt: float, pushed: Matrix, moved: Vector) -> None:
    """Carry `pushed` (6, 6) over a piece of dt s: half of it at each end, where the acceleration is before or after.

    before, after (3, 6); moved (6,) scratch.
    """
    for k in range(pushed.shape[0]):
        row = pushed[k]
        for i in range(3):
            row[3 + i] += 0.5 * dt * before[i, k]
        for i in range(ROTATION):
            moved[i] = 0.0
            for j in range(ROTATION):
                moved[i] += phi[i, j] * row[j]
        for i in range(3):
            row[i], row[3 + i] = moved[i], moved[3 + i] + 0.5 * dt * after[i, k]


@kernel
def turn_uncertain(body: Record, dt: float, dcm: Matrix, rate: Vector) -> bool:
    """`rigid_body.propagate_into` over dt s of a body whose inertia is off; what that does goes into `pushed`.

    Second order is noise, as it cannot be carried with the errors.
    """
    values, sigma, work, pushed = body["values"], body["inertia_sigma"], body["work"], body["pushed"]
    before, after, phi, noise = body["before"], body["after"], body["phi"], body["noise"]
    piece_phi, piece_noise, n = body["piece_phi"], body["piece_noise"], values[ORBIT, FRAME_RATE]
    steps = step_count(rate, n, dt)
    if steps == 0:
        return False
    for i in range(ROTATION):
        for j in range(ROTATION):
            phi[i, j], noise[i, j] = 1.0 if i == j else 0.0, 0.0
        for k in range(pushed.shape[0]):
            pushed[k, i] = 0.0
    pieces = (steps + STEPS_A_PIECE - 1) // STEPS_A_PIECE
    h = dt / pieces
    for _ in range(pieces):
        inertia_effect_into(values, sigma, dcm, rate, before)
        density = body["noise_density"] + second_order_square(values, sigma, before) * turn_time(rate, n)
        if not propagate_into(values, h, dcm, rate, density, piece_phi, piece_noise, work):
            return False
        inertia_effect_into(values, sigma, dcm, rate, after)
        _push(before, after, piece_phi, h, pushed, work[0])
        carry_transition(piece_phi, phi, noise, work[0:12])
        for i in range(ROTATION):
            for j in range(ROTATION):
                noise[i, j] += piece_noise[i, j]
    return True


@kernel
def push_sensitivities(body: Record, sensitivities: Matrix) -> None:
    """Add to what lasting errors have done to a hypothesis, (m, 12), what its inertia did in the step."""
    count = body["inertia_errors"]
    first = sensitivities.shape[0] - count
    for k in range(count):
        for i in range(ROTATION):
            sensitivities[first + k, THETA + i] += body["pushed"][k, i]


@kernel
def _write_apart(m: PoseMemory, track: Record, count: int) -> int:
    """Write R of `count` groups without the inertia's part, and L^-1 H C^T of the used rows; returns how many.

    Into `plain_noise` and `shown`; nothing where H P H^T + R is not positive definite.
    """
    ld, first, rows, by = track["ld"], m.lasting["shown"], 0, m.by_error
    S, G, along, plain = m.spread, m.shown, m.along, m.plain_noise
    for i in range(2 * count):
        for k in range(i + 1):
            total = m.noise[i, k]
            for c in range(first, by.shape[1]):
                total -= by[i, c] * by[k, c]
            plain[i, k], plain[k, i] = total, total
    for i in range(2 * count):
        if m.groups[i // 2]["tested"] == 0:
            continue
        h, place = m.groups[i // 2]["gradient"][i % 2], 0
        for j in range(POSE):
            along[rows, j] = h[j]
            for k in range(j + 1, POSE):
                along[rows, j] += ld[k, j] * h[k]
        for c in range(first, by.shape[1]):
            G[rows, c] = by[i, c]
        for k in range(i + 1):
            if m.groups[k // 2]["tested"] > 0:
                S[rows, place] = plain[i, k]
                for j in range(POSE):
                    S[rows, place] += along[rows, j] * ld[j, j] * along[place, j]
                place += 1
        rows += 1
    if not cholesky(S[:rows, :rows], 0.0, S[:rows, :rows]):
        return 0
    for i in range(rows):
        for c in range(first, by.shape[1]):
            for k in range(i):
                G[i, c] -= S[i, k] * G[k, c]
            G[i, c] /= S[i, i]
    return rows


@kernel
def take_against_inertia(m: PoseMemory, track: Record, sensitivities: Matrix, count: int) -> None:
    """Correct a hypothesis by the used of `count` groups with the gain that counts its inertia; S (m, 12) with it.

    The errors that it estimates stand in its state, to be folded in.
    """
    n, first, joint, row = 2 * count, m.lasting["shown"], m.joint, m.scratch["error"]
    rows = _write_apart(m, track, count)
    image = Observed(m.groups[:count], m.plain_noise[:n, :n], m.factor[:n, :n], m.independent[:count])
    nis, _ = sweep(track, track["state"], image, m.work)
    if not math.isfinite(nis) or rows == 0:
        return
    copy_track(track, joint)
    copy_track(m.work, track)
    join_considered(joint["ld"], sensitivities[first:])
    sweep(joint, joint["state"], image, m.work)
    for i in range(POSE):
        track["state"][i] = m.work["state"][i]
    update_sensitivities(m.work["ld"], image, m.by_error[:n], m.news, sensitivities)
    for k in range(rows):
        for i in range(POSE):
            row[i] = 0.0
            for c in range(first, sensitivities.shape[0]):
                row[i] += m.shown[k, c] * sensitivities[c, i]
        add_rank_one(track["ld"], row)
