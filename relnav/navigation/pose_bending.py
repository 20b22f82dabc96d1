"""The second order of a long gap for hypotheses of the marker filter: as `attitude.bending` says, in little memory.

The pairs of points are x +- s_j, s_j sqrt(6) sigmas of what is known of attitude and rate. Over each step s_j goes as
slopes say; e_j, the even part of a pair, goes so too, and gains what the step itself bends:

    s <- Phi s,      e <- Phi e + (f(x + s) + f(x - s)) / 2,      P = L D L^T + sum e e^T / 6

f: errors about x after the step. So what a gap does adds up, in however many steps. L D L^T, by slopes alone, remains
the hypothesis' own until an image comes; then the sum is taken into it, and points are drawn anew. A trial has none.
Errors of the inertia have a pair each, s_k what sqrt(6) sigmas of them have done, in bodies of such an inertia.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.dynamics.error_state import POSE, ROTATION, THETA
from relnav.dynamics.inertia_error import ENTRIES, INERTIA_ENTRIES
from relnav.dynamics.rigid_body import FRAME_RATE, INERTIA, INVERSE, ORBIT, TORQUE, step_count, turn_body
from relnav.estimation.factored import add_three_rank_ones, compose_into, factorize_into
from relnav.estimation.rows import copy_rows
from relnav.geometry.linear_algebra import invert_three
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector
from relnav.navigation.attitude.bending import LEAST_SHARE, thinnest_variance

POSE_BENT = np.dtype(
    [
        ("on", np.int64),
        ("age", np.float64),  # s since the latest image
        ("pairs", np.float64, (ROTATION, ROTATION)),  # s_j, a row each
        ("even", np.float64, (ROTATION, ROTATION)),  # e_j, a row each
        ("inertia_even", np.float64, (ENTRIES, ROTATION)),  # of an inertia that is off, a row an entry
        ("rows", np.float64, (3, POSE)),  # scratch
        ("side", np.float64, ROTATION),  # scratch
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
    bent["on"], bent["inertia_even"][:] = 1, 0.0
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
def _land(body: Record, scratch: Record, values: Matrix, track: Record, pair: Vector, dt: float, moved: Vector) -> None:
    """Add half of where a point ends after dt, told from the hypothesis, to moved (6,); pair (6,): where it began.

    values (BODY_ROWS, 3): of its body; `pose` of scratch: attitude and rate of the hypothesis before the step.
    """
    before, dcm, rate, turn = scratch["pose"], scratch["turned"], scratch["point"], scratch["error"]
    inertia, inverse, orbit = values[INERTIA : INERTIA + 3], values[INVERSE : INVERSE + 3], values[ORBIT]
    for i in range(3):
        turn[i], rate[i] = pair[i], before[3, i] + pair[3 + i]
    turn_by_rotation_vector(before, turn, dcm)
    count = step_count(rate, orbit[FRAME_RATE], dt)
    for _ in range(count):
        turn_body(dcm, rate, inertia, inverse, orbit, values[TORQUE], dt / count, body["work"][0:14, 0:3])
    rotation_vector_into(dcm, track["dcm"][:], turn[:3])
    for i in range(3):
        moved[i] += 0.5 * turn[i]
        moved[3 + i] += 0.5 * (rate[i] - track["rate"][i])


@kernel
def carry_pairs(body: Record, scratch: Record, track: Record, inertia: Matrix, bent: Record, dt: float) -> None:
    """Carry pairs over a step that the hypothesis has taken; `pose` of scratch: its attitude and rate before it.

    inertia (k, 12): what the errors of the inertia had done to it then.
    """
    phi, moved, side = body["phi"], bent["rows"], bent["side"]
    for j in range(ROTATION):
        pair, even = bent["pairs"][j], bent["even"][j]
        _times(phi, even, moved[0])
        for sign in (1.0, -1.0):
            for i in range(ROTATION):
                side[i] = sign * pair[i]
            _land(body, scratch, body["values"], track, side, dt, moved[0])
        _times(phi, pair, moved[1])
        for i in range(ROTATION):
            even[i], pair[i] = moved[0, i], moved[1, i]
    for k in range(inertia.shape[0]):
        even = bent["inertia_even"][k]
        _times(phi, even, moved[0])
        for sign in (1.0, -1.0):
            for i in range(ROTATION):
                side[i] = sign * math.sqrt(6.0) * inertia[k, THETA + i]
            _write_body(body["values"], body["inertia_sigma"], k, sign * math.sqrt(6.0), body["other"])
            _land(body, scratch, body["other"], track, side, dt, moved[0])
        for i in range(ROTATION):
            even[i] = moved[0, i]


@kernel
def _write_body(values: Matrix, sigma: Matrix, k: int, size: float, other: Matrix) -> None:
    """Write a body (BODY_ROWS, 3) of which entry k of the inertia is off by some sigmas."""
    copy_rows(values, other)
    a, b = INERTIA_ENTRIES[k]
    other[INERTIA + a, b] = values[INERTIA + a, b] + size * sigma[a, b]
    other[INERTIA + b, a] = other[INERTIA + a, b]
    invert_three(other[INERTIA : INERTIA + 3], other[INVERSE : INVERSE + 3])


@kernel
def _add(even: Matrix, rows: Matrix, ld: Matrix) -> None:
    for first in range(0, even.shape[0], 3):
        for k in range(3):
            for i in range(POSE):
                rows[k, i] = even[first + k, i - THETA] / math.sqrt(6.0) if i >= THETA else 0.0
        add_three_rank_ones(ld, rows)


@kernel
def add_bends(bent: Record, errors: int, ld: Matrix) -> None:
    """Add to factors (12, 12) of a hypothesis what its pairs have bent; errors: how many of the inertia are counted."""
    _add(bent["even"], bent["rows"], ld)
    if errors > 0:
        _add(bent["inertia_even"], bent["rows"], ld)


@kernel
def take_bends(body: Record, bank: Record, bents: Record, count: int) -> None:
    """Let the hypotheses of a bank take them into their factors: an image has come."""
    for k in range(bents.shape[0]):
        if k < count and bents[k]["on"] > 0:
            add_bends(bents[k], body["inertia_errors"], bank[k]["ld"])
        bents[k]["on"], bents[k]["age"] = 0, 0.0
