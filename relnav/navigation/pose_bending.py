"""The second order of a long gap for hypotheses of the marker filter: as `attitude.bending` says, in little memory.

The pairs of points are x +- s_j, s_j sqrt(6) sigmas of what is known of attitude and rate. Over each step s_j goes as
slopes say; e_j, the even part of a pair, goes so too, and gains what the step itself bends:

    s <- Phi s,      e <- Phi e + (f(x + s) + f(x - s)) / 2,      P = L D L^T + sum e e^T / 6

f: errors about x after the step. So what a gap does adds up, in however many steps. L D L^T, by slopes alone, remains
the hypothesis' own until an image comes; then the sum is taken into it, and points are drawn anew. A trial has none.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.dynamics.error_state import POSE, ROTATION, THETA
from relnav.dynamics.rigid_body import FRAME_RATE, INERTIA, INVERSE, ORBIT, TORQUE, step_count, turn_body
from relnav.estimation.factored import add_three_rank_ones, compose_into, factorize_into
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector
from relnav.navigation.attitude.bending import LEAST_SHARE, thinnest_variance

POSE_BENT = np.dtype(
    [
        ("on", np.int64),
        ("age", np.float64),  # s since the latest image
        ("pairs", np.float64, (ROTATION, ROTATION)),  # s_j, a row each
        ("even", np.float64, (ROTATION, ROTATION)),  # e_j, a row each
        ("rows", np.float64, (3, POSE)),  # scratch
    ]
)
"""Beside a hypothesis of the bank."""


@kernel
def draw_pairs(body: Record, scratch: Record, track: Record, bent: Record, reach: float, dt: float) -> None:
    """Draw pairs of points about a hypothesis if errors that reach so far, rad, bend over dt, and none are carried yet.

    The thinnest axis is that of attitude and rate where position and velocity are known: thinner than without. What has
    turned by a small angle since the latest image bends by that share: those of a flat pattern are wide all the time.
    """
    ld, factors, P, rate = track["ld"], body["factors"], scratch["noise"], track["rate"]
    for i in range(ROTATION):
        for j in range(ROTATION):
            factors[i, j] = ld[THETA + i, THETA + j] if j <= i else 0.0
    speed = math.sqrt(rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2])
    fastest = max(speed, body["values"][ORBIT, FRAME_RATE])
    bent["age"] += dt
    leak = 0.5 * reach * reach * min(1.0, fastest * bent["age"])
    if bent["on"] > 0 or not leak * leak > LEAST_SHARE * LEAST_SHARE * thinnest_variance(factors, fastest):
        return
    compose_into(ld, P)
    if not factorize_into(P[THETA:, THETA:], factors):
        return
    bent["on"] = 1
    for j in range(ROTATION):
        size = math.sqrt(6.0 * factors[j, j])
        for i in range(ROTATION):
            bent["pairs"][j, i] = size if i == j else (size * factors[i, j] if i > j else 0.0)
            bent["even"][j, i] = 0.0


@kernel
def _times(phi: Matrix, row: Vector, out: Vector) -> None:
    """Write Phi row."""
    for i in range(ROTATION):
        out[i] = 0.0
        for k in range(ROTATION):
            out[i] += phi[i, k] * row[k]


@kernel
def carry_pairs(body: Record, scratch: Record, track: Record, bent: Record, dt: float) -> None:
    """Carry pairs over a step that the hypothesis has taken; `pose` of scratch: its attitude and rate before it."""
    values, before, phi = body["values"], scratch["pose"], body["phi"]
    dcm, rate, turn, moved = scratch["turned"], scratch["point"], scratch["error"], bent["rows"]
    inertia, inverse, orbit = values[INERTIA : INERTIA + 3], values[INVERSE : INVERSE + 3], values[ORBIT]
    for j in range(ROTATION):
        pair, even = bent["pairs"][j], bent["even"][j]
        _times(phi, even, moved[0])
        for side in range(2):
            sign = 1.0 if side == 0 else -1.0
            for i in range(3):
                turn[i], rate[i] = sign * pair[i], before[3, i] + sign * pair[3 + i]
            turn_by_rotation_vector(before, turn, dcm)
            count = step_count(rate, orbit[FRAME_RATE], dt)
            for _ in range(count):
                turn_body(dcm, rate, inertia, inverse, orbit, values[TORQUE], dt / count, body["work"][0:14, 0:3])
            rotation_vector_into(dcm, track["dcm"][:], turn[:3])
            for i in range(3):
                moved[0, i] += 0.5 * turn[i]
                moved[0, 3 + i] += 0.5 * (rate[i] - track["rate"][i])
        _times(phi, pair, moved[1])
        for i in range(ROTATION):
            even[i], pair[i] = moved[0, i], moved[1, i]


@kernel
def add_bends(bent: Record, ld: Matrix) -> None:
    """Add to factors (12, 12) of a hypothesis what its pairs have bent."""
    rows = bent["rows"]
    for first in range(0, ROTATION, 3):
        for k in range(3):
            for i in range(POSE):
                rows[k, i] = bent["even"][first + k, i - THETA] / math.sqrt(6.0) if i >= THETA else 0.0
        add_three_rank_ones(ld, rows)


@kernel
def take_bends(bank: Record, bents: Record, count: int) -> None:
    """Let the hypotheses of a bank take them into their factors: an image has come."""
    for k in range(bents.shape[0]):
        if k < count and bents[k]["on"] > 0:
            add_bends(bents[k], bank[k]["ld"])
        bents[k]["on"], bents[k]["age"] = 0, 0.0
