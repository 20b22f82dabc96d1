"""How a correction moves an estimate, and which correction leads from one estimate to another.

What images have told is where the target is in the chaser's axes. A later correction phi of the chaser's attitude, in
`lvlh_ccsds`, then turns the path r between them as a rigid body, and the velocity u with it: r + phi x r is off by half
of phi^2 r, 30 mm at 30 m and 2.6 deg, where an image tells a few. Before there is an image the path is known in
`lvlh_ccsds`, whatever the chaser's attitude is, and no correction of that may turn it. The correction rho of the path
itself says how much of the turn it shares, as the covariance knows how both are correlated; with v that of u,

    s = (phi x r) . rho / |phi x r|^2, within 0 and 1,   R = exp(s [phi x]),
    r_new = R (r + rho - s phi x r),   u_new = R (u + v - s phi x u)

After an image rho is phi x r and little more: s is 1, and r and u keep their components in the chaser's axes. Where
path and attitude are not correlated s is near 0, and corrections add. Both are the same to first order, so that rows
and gains need not know of it; the covariance of rho - phi x r and v - phi x u turns with R (`reset`).

The target's own correction does not turn the path but about the lights that were seen (`pivot`). In the target's axes
images tell it less well than in the chaser's, by the ratio of the distance to the size of the pattern. Lights and the
target's rate are corrected by addition: what images leave free is a turn of the lights by no more than the angle to
which they are placed, a hundredth, and half its square of their distances is less than a hundredth of their sigma.
"""

import numpy as np

from relnav.arrays import Codes, Matrix, Record, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics.error_state import MOTION
from relnav.geometry.linear_algebra import cross_into, invert_three
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector
from relnav.vehicle.layout import CHASER_ATTITUDE, GYRO_BIAS, POSITION, TARGET_ATTITUDE, VELOCITY
from relnav.vehicle.pivot import lever_into, mean_place_into, move_about_lights

LEAST_SHARE = 1e-3
"""Of a sigma: what moves no error by more than this share of its own is left out."""
SHARPEST = 0.01
"""Of the sigma of a position, 1 mm of 0.1 m: that relative to the chaser counts as no less, which spares finding it."""
PASSES = 4
"""Over the share of a turn, from two estimates; what is left falls by the square of the turn in each."""

_POSITION, _VELOCITY = POSITION.start, VELOCITY.start
_TARGET, _CHASER = TARGET_ATTITUDE.start, CHASER_ATTITUDE.start
_TURNS = GYRO_BIAS.stop - CHASER_ATTITUDE.start
"""Errors of the chaser's attitude and rate, next to one another."""


def retraction_scratch(n: int) -> list[tuple[str, type[np.float64], int | tuple[int, ...]]]:
    """Fields of scratch for n errors.

    unit: one; phi: the turn that the path shares, rad, lvlh; turn: R; path: R r and R u; moved: new values less old
    ones, of position and velocity less turned ones.
    """
    return [
        ("unit", np.float64, (3, 3)),
        ("phi", np.float64, 3),
        ("own", np.float64, 3),
        ("across", np.float64, 3),
        ("turn", np.float64, (3, 3)),
        ("path", np.float64, MOTION),
        ("moved", np.float64, n),
        ("axes", np.float64, (3, 3)),
        ("by_turns", np.float64, (2, 3, _TURNS)),
        ("apart", np.float64, (3, 3)),
    ]


@kernel
def find_turn(correction: Vector, values: Vector, chaser: Matrix, frame: Matrix, scratch: Record) -> float:
    """Write phi, as far as the path shares it, and return its square; correction and values (n,), before it.

    chaser, frame (3, 3): dcm_inertial_from_chaser before it, dcm_lvlh_from_inertial.
    """
    phi, own, across = scratch["phi"], scratch["own"], scratch["across"]
    for i in range(3):
        own[i] = chaser[i, 0] * correction[_CHASER]
        own[i] += chaser[i, 1] * correction[_CHASER + 1] + chaser[i, 2] * correction[_CHASER + 2]
    for i in range(3):
        phi[i] = frame[i, 0] * own[0] + frame[i, 1] * own[1] + frame[i, 2] * own[2]
    cross_into(phi, values[_POSITION : _POSITION + 3], across)
    seen, whole = 0.0, 0.0
    for i in range(3):
        seen += across[i] * correction[_POSITION + i]
        whole += across[i] * across[i]
    share = min(seen / whole, 1.0) if seen > 0.0 else 0.0
    for i in range(3):
        phi[i] *= share
    return float(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])


@kernel
def bends(P: Matrix, values: Vector, angle2: float, chaser: Matrix, frame: Matrix, scratch: Record) -> bool:
    """Whether a turn by an angle of this square is more than addition, by LEAST_SHARE of a sigma; values (n,)."""
    if not angle2 > 0.0:
        return False
    for at in (_POSITION, _VELOCITY):
        most, length2 = P[at, at], values[at] * values[at]
        for i in range(at + 1, at + 3):
            most, length2 = max(most, P[i, i]), length2 + values[i] * values[i]
        if path_feels(P, values, at, angle2 * max(0.25 * angle2 * length2, most), chaser, frame, scratch):
            return True
    return False


@kernel
def path_feels(
    P: Matrix, values: Vector, at: int, shift2: float, chaser: Matrix, frame: Matrix, scratch: Record
) -> bool:
    """Whether a shift of the position's errors, or the velocity's, of this square is LEAST_SHARE of what is known.

    Images tell them relative to the chaser, often a hundred times better than the three errors from `at` on themselves;
    what is left out at each of a few hundred images adds up to as much as they told.
    """
    least, share2 = min(P[at, at], P[at + 1, at + 1], P[at + 2, at + 2]), LEAST_SHARE * LEAST_SHARE
    if shift2 > share2 * least:
        return True
    if not shift2 > SHARPEST * SHARPEST * share2 * least:
        return False
    return bool(shift2 > share2 * _least_apart(P, values, at, chaser, frame, scratch))


@kernel
def _least_apart(P: Matrix, values: Vector, at: int, chaser: Matrix, frame: Matrix, scratch: Record) -> float:
    """Least variance of rho - phi x r or of v - phi x u - w x r, within a factor of 3; w: its rate's error."""
    A, M, MP, S = scratch["axes"], scratch["by_turns"][0], scratch["by_turns"][1], scratch["apart"]
    for i in range(3):
        for c in range(3):
            A[i, c] = frame[i, 0] * chaser[0, c] + frame[i, 1] * chaser[1, c] + frame[i, 2] * chaser[2, c]
    turns = _TURNS if at == _VELOCITY else 3
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for c in range(3):
            M[i, c] = values[at + j] * A[k, c] - values[at + k] * A[j, c]
            M[i, 3 + c] = values[_POSITION + k] * A[j, c] - values[_POSITION + j] * A[k, c]
    for i in range(3):
        for m in range(turns):
            total = P[at + i, _CHASER + m]
            for k in range(turns):
                total += M[i, k] * P[_CHASER + k, _CHASER + m]
            MP[i, m] = total
        for j in range(i + 1):
            total = P[at + i, at + j]
            for k in range(turns):
                total += MP[i, k] * M[j, k] + M[i, k] * P[at + j, _CHASER + k]
            S[i, j] = S[j, i] = total
    return 1.0 / (S[0, 0] + S[1, 1] + S[2, 2]) if invert_three(S, S) else 0.0


@kernel
def turned_into(correction: Vector, values: Vector, scratch: Record) -> None:
    """Write R, position and velocity turned by it (path), and what is then added to values (n,): moved.

    phi in scratch as `find_turn` left it.
    """
    phi, own, across, turn = scratch["phi"], scratch["own"], scratch["across"], scratch["turn"]
    path, moved = scratch["path"], scratch["moved"]
    turn_by_rotation_vector(scratch["unit"], phi, turn)
    for i in range(len(moved)):
        moved[i] = correction[i]
    for at in (_POSITION, _VELOCITY):
        cross_into(phi, values[at : at + 3], across)
        for i in range(3):
            own[i] = correction[at + i] - across[i]
        for i in range(3):
            moved[at + i] = turn[i, 0] * own[0] + turn[i, 1] * own[1] + turn[i, 2] * own[2]
            path[at + i] = turn[i, 0] * values[at] + turn[i, 1] * values[at + 1] + turn[i, 2] * values[at + 2]


@entry
def correction_into(
    values: Vector,
    target: Matrix,
    chaser: Matrix,
    new_values: Vector,
    new_target: Matrix,
    new_chaser: Matrix,
    frame: Matrix,
    lights: Codes,
    pivot: Vector,
    scratch: Record,
    out: Vector,
) -> None:
    """Write the correction (n,) that leads from one estimate to another, and into scratch R, p and D (`pivot`).

    values (n,), both attitudes (3, 3), dcm_lvlh_from_target and dcm_inertial_from_chaser, of both of them; lights (l,),
    pivot (3 + l,).
    """
    own, across, phi, turn = scratch["own"], scratch["across"], scratch["phi"], scratch["turn"]
    added = scratch["moved"]
    for i in range(len(out)):
        out[i] = new_values[i] - values[i]
    rotation_vector_into(new_target, target, out[_TARGET : _TARGET + 3])
    rotation_vector_into(new_chaser, chaser, out[_CHASER : _CHASER + 3])
    mean_place_into(values, lights, pivot, scratch["middle"])
    for _ in range(PASSES):
        find_turn(out, values, chaser, frame, scratch)
        turn_by_rotation_vector(scratch["unit"], phi, turn)
        lever_into(out, target, new_target, scratch)
        for i in range(MOTION):
            added[i] = 0.0
        move_about_lights(out, lights, pivot, scratch, added)
        for at in (_POSITION, _VELOCITY):
            cross_into(phi, values[at : at + 3], across)
            for i in range(3):
                own[i] = 0.0
                for c in range(3):
                    own[i] += turn[c, i] * (new_values[at + c] - added[at + c])
                out[at + i] = own[i] - values[at + i] + across[i]
