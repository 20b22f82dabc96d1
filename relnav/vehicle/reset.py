"""What is known of the errors about one estimate, referred to another one.

An update moves the estimate, and errors are told anew about where it is. Two turns no image of lights tells: one of
target, chaser and the path between them together, and one of the lights' places against the target's own turn. A filter
whose errors are told in axes of their own, each slope taken where the estimate was then, sees these turns a little
differently at every image, and takes the difference for a measurement: its covariance shrinks where nothing was
measured (Huang, Mourikis, Roumeliotis 2010, "Observability-based rules for designing consistent EKF SLAM estimators").

So errors are referred such that these turns stay what they are (Barrau, Bonnabel 2017, "The invariant extended Kalman
filter as a stable observer"). With the chaser's error phi in `lvlh_ccsds`, and the target's error less the chaser's in
the target's axes, b,

    phi, b, rho - phi x r, v - phi x u, dw + b x w, m + b x p

are the same about both estimates, where r and u are position and velocity, w the target's rate, p the place of a light,
and rho, v, dw, m their errors. The third and the fourth are told in axes that turn by R with the estimate's path, if it
turns (`retraction`): images tell them in the chaser's axes, along the line of sight less well than across it. What this
changes is a correction times an error: little for a filter that knows its attitudes, and all that is wrong where
nothing but a hand-over tells them.
"""

import numpy as np

from relnav.arrays import Codes, Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.vehicle.layout import (
    CHASER_ATTITUDE,
    DRIVING,
    POSITION,
    TARGET_ATTITUDE,
    TARGET_RATE,
    VELOCITY,
)
from relnav.vehicle.pivot import (
    change_about_lights,
    lever_into,
    mean_place_into,
    move_about_lights,
    pivot_scratch,
    row_about_lights,
)
from relnav.vehicle.retraction import LEAST_SHARE, find_turn, path_feels, retraction_scratch, turned_into

TURNS = 6
"""Errors of both attitudes, on which alone the others' references depend: the target's three, then the chaser's."""

_POSITION, _VELOCITY, _RATE = POSITION.start, VELOCITY.start, TARGET_RATE.start
_TARGET, _CHASER = TARGET_ATTITUDE.start, CHASER_ATTITUDE.start
_TOUCHED = TURNS
"""Column of a change that says whether its row is not zero."""


def reset_scratch(n: int) -> Record:
    """Scratch (1,) for resets of n errors."""
    fields = [
        ("attitudes", np.float64, (2, 3, 3)),
        ("change", np.float64, (n, TURNS + 1)),
        ("to_lvlh", np.float64, (TURNS, 3)),
        ("bent", np.float64, (3, 3)),
        ("turns", np.float64, (TURNS, n)),
        ("carried", np.float64, (TURNS, n)),
        *retraction_scratch(n),
        *pivot_scratch(n),
    ]
    scratch = np.zeros(1, np.dtype(fields))
    scratch["unit"] = np.eye(3)
    return scratch


@kernel
def _turn_with(v: Vector, by_chaser: Matrix, by_target: bool, change: Matrix, at: int) -> None:
    """Write three rows of a change, from `at` on: K theta_C x v, or (K theta_C - theta_T) x v; K (3, 3) by_chaser."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for c in range(3):
            change[at + i, 3 + c] = by_chaser[j, c] * v[k] - by_chaser[k, c] * v[j]
        if by_target:
            change[at + i, j], change[at + i, k] = -v[k], v[j]
        change[at + i, _TOUCHED] = 1.0


@kernel
def _bend_with(A: Matrix, scratch: Record) -> None:
    """Add to a change what the turn R of the path adds: (1 - R) A theta_C x R r, and of the velocity."""
    change, bent, turn, path = scratch["change"], scratch["bent"], scratch["turn"], scratch["path"]
    for i in range(3):
        for c in range(3):
            bent[i, c] = A[i, c] - turn[i, 0] * A[0, c] - turn[i, 1] * A[1, c] - turn[i, 2] * A[2, c]
    for at in (_POSITION, _VELOCITY):
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            for c in range(3):
                change[at + i, 3 + c] += bent[j, c] * path[at + k] - bent[k, c] * path[at + j]


@kernel
def change_into(
    moved: Vector,
    turned: bool,
    target: Matrix,
    chaser: Matrix,
    new_target: Matrix,
    new_chaser: Matrix,
    frame: Matrix,
    lights: Codes,
    scratch: Record,
) -> None:
    """Write change, N (n, TURNS + 1): errors about the new estimate = B errors + N (theta_T, theta_C) of the old ones.

    moved (n,): new less old values; both attitudes of both estimates, (3, 3); frame (3, 3): dcm_lvlh_from_inertial;
    lights (l,): where the three errors of each light begin. turned: position and velocity are less turned old ones, of
    which there are turn and path in scratch, and B turns their errors; else B is one.
    """
    change, to_lvlh = scratch["change"], scratch["to_lvlh"]
    A, K = to_lvlh[0:3], to_lvlh[3:6]
    for i in range(len(moved)):
        for c in range(TURNS + 1):
            change[i, c] = 0.0
    for i in range(3):
        for c in range(3):
            A[i, c] = frame[i, 0] * chaser[0, c] + frame[i, 1] * chaser[1, c] + frame[i, 2] * chaser[2, c]
    for i in range(3):
        change[_TARGET + i, _TOUCHED] = change[_CHASER + i, _TOUCHED] = 1.0
        for c in range(3):
            K[i, c] = target[0, i] * A[0, c] + target[1, i] * A[1, c] + target[2, i] * A[2, c]
            same = new_chaser[0, i] * chaser[0, c] + new_chaser[1, i] * chaser[1, c] + new_chaser[2, i] * chaser[2, c]
            change[_CHASER + i, 3 + c] = same - (1.0 if i == c else 0.0)
            there = new_target[0, i] * A[0, c] + new_target[1, i] * A[1, c] + new_target[2, i] * A[2, c]
            change[_TARGET + i, 3 + c] = there - K[i, c]
    _turn_with(moved[_POSITION : _POSITION + 3], A, False, change, _POSITION)
    _turn_with(moved[_VELOCITY : _VELOCITY + 3], A, False, change, _VELOCITY)
    if turned:
        _bend_with(A, scratch)
    _turn_with(moved[_RATE : _RATE + 3], K, True, change, _RATE)
    for first in lights:
        if moved[first] != 0.0 or moved[first + 1] != 0.0 or moved[first + 2] != 0.0:
            _turn_with(moved[first : first + 3], K, True, change, first)


@kernel
def is_felt(
    P: Matrix, moved: Vector, values: Vector, chaser: Matrix, frame: Matrix, lights: Codes, scratch: Record
) -> bool:
    """Whether a reset over moved (n,), turns in place of attitudes, moves any error by LEAST_SHARE of its own sigma.

    values (n,), chaser (3, 3): of the estimate before it, dcm_inertial_from_chaser.
    """
    turn, both = 0.0, 0.0
    for i in range(3):
        turn, both = max(turn, P[_CHASER + i, _CHASER + i]), max(both, P[_TARGET + i, _TARGET + i])
    both += turn
    if _feels(P, moved, _CHASER, turn) or _feels(P, moved, _TARGET, turn):
        return True
    for at in (_POSITION, _VELOCITY):
        shift2 = _length2(moved, at) * turn
        if shift2 > 0.0 and path_feels(P, values, at, shift2, chaser, frame, scratch):
            return True
    if _feels(P, moved, _RATE, both):
        return True
    for first in lights:  # noqa: SIM110  (a generator cannot be compiled)
        if _feels(P, moved, first, both):
            return True
    return False


@kernel
def is_pivot_felt(
    P: Matrix, correction: Vector, values: Vector, target: Matrix, chaser: Matrix, frame: Matrix, scratch: Record
) -> bool:
    """Whether what a turn about the lights adds is LEAST_SHARE of what is known of the position; p, s phi in scratch.

    P (n, n), correction and values (n,), both attitudes (3, 3) of the estimate before it.
    """
    middle, phi = scratch["middle"], scratch["phi"]
    length2 = middle[0] * middle[0] + middle[1] * middle[1] + middle[2] * middle[2]
    turn2, most, more = 0.0, 0.0, 0.0
    for i in range(3):
        C = target[i]
        psi = C[0] * correction[_TARGET] + C[1] * correction[_TARGET + 1] + C[2] * correction[_TARGET + 2] - phi[i]
        turn2 += psi * psi
        most, more = max(most, P[_TARGET + i, _TARGET + i]), max(more, P[_CHASER + i, _CHASER + i])
    shift2 = turn2 * length2 * max(0.25 * turn2, most + more)
    return bool(shift2 > 0.0 and path_feels(P, values, _POSITION, shift2, chaser, frame, scratch))


@kernel
def _length2(moved: Vector, at: int) -> float:
    """Square of the length of three components from `at` on."""
    return float(moved[at] * moved[at] + moved[at + 1] * moved[at + 1] + moved[at + 2] * moved[at + 2])


@kernel
def _feels(P: Matrix, moved: Vector, at: int, turn: float) -> bool:
    """Whether a turn of this variance moves three errors, by what has moved, by a share of the least of them."""
    length2 = _length2(moved, at)
    if length2 == 0.0:
        return False
    least = min(P[at, at], P[at + 1, at + 1], P[at + 2, at + 2])
    return bool(length2 * turn > LEAST_SHARE * LEAST_SHARE * least)


@kernel
def _turn_covariance(P: Matrix, turn: Matrix, own: Vector) -> None:
    """Replace P (n, n) by B P B^T, where B turns position and velocity; own (3,) scratch."""
    for at in (_POSITION, _VELOCITY):
        for c in range(P.shape[0]):
            for i in range(3):
                own[i] = P[at + i, c]
            for i in range(3):
                P[at + i, c] = turn[i, 0] * own[0] + turn[i, 1] * own[1] + turn[i, 2] * own[2]
    for at in (_POSITION, _VELOCITY):
        for r in range(DRIVING):
            for i in range(3):
                own[i] = P[r, at + i]
            for i in range(3):
                P[r, at + i] = turn[i, 0] * own[0] + turn[i, 1] * own[1] + turn[i, 2] * own[2]


@kernel
def refer_into(P: Matrix, turned: bool, scratch: Record) -> None:
    """Replace P (n, n) by that of the changed errors, G P G^T with G = B + N; B and N as of `change_into`.

    The first DRIVING rows are whole, of the others what stands right of the diagonal.
    """
    n, change, turns, carried = P.shape[0], scratch["change"], scratch["turns"], scratch["carried"]
    if turned:
        _turn_covariance(P, scratch["turn"], scratch["own"])
    for k in range(3):
        for c in range(n):
            turns[k, c], turns[3 + k, c] = P[_TARGET + k, c], P[_CHASER + k, c]
    for c in range(n):
        for k in range(TURNS):
            carried[k, c] = turns[k, c]
        if change[c, _TOUCHED] > 0.0:
            for k in range(TURNS):
                for m in range(3):
                    own = turns[k, _TARGET + m] * change[c, m] + turns[k, _CHASER + m] * change[c, 3 + m]
                    carried[k, c] += own
    for r in range(n):
        touched = change[r, _TOUCHED] > 0.0
        for c in range(r, n):
            if not touched and not change[c, _TOUCHED] > 0.0:
                continue
            total = P[r, c]
            for k in range(TURNS):
                total += change[r, k] * carried[k, c] + change[c, k] * turns[k, r]
            P[r, c] = total
            if c < DRIVING:
                P[c, r] = total


@entry
def refer_rows_into(
    H: Stack,
    corrections: Matrix,
    values: Matrix,
    targets: Stack,
    chasers: Stack,
    new_targets: Stack,
    new_chasers: Stack,
    frame: Matrix,
    lights: Codes,
    pivot: Matrix,
    scratch: Record,
) -> None:
    """Replace rows H (k, m, n) of k filters, about corrected estimates, by rows about the errors before: H G.

    corrections, values before (k, n); pivot (k, 3 + l) (`pivot`); the rest as of `change_into`, one of each a filter;
    scratch (1,) of `reset_scratch`.
    """
    own = scratch[0]
    change, total, turn, moved = own["change"], own["to_lvlh"][0:2], own["turn"], own["moved"]
    for f in range(len(H)):
        find_turn(corrections[f], values[f], chasers[f], frame, own)
        turned_into(corrections[f], values[f], own)
        mean_place_into(values[f], lights, pivot[f], own["middle"])
        lever_into(corrections[f], targets[f], new_targets[f], own)
        move_about_lights(corrections[f], lights, pivot[f], own, moved)
        change_into(moved, True, targets[f], chasers[f], new_targets[f], new_chasers[f], frame, lights, own)
        change_about_lights(own)
        for i in range(H.shape[1]):
            row = H[f, i]
            for k in range(3):
                total[0, k] = total[1, k] = 0.0
                for c in range(len(row)):
                    if change[c, _TOUCHED] > 0.0:
                        total[0, k] += row[c] * change[c, k]
                        total[1, k] += row[c] * change[c, 3 + k]
            for k in range(3):
                row[_TARGET + k] += total[0, k]
                row[_CHASER + k] += total[1, k]
            row_about_lights(row, lights, pivot[f], own)
            for at in (_POSITION, _VELOCITY):
                x, y, z = row[at], row[at + 1], row[at + 2]
                for k in range(3):
                    row[at + k] = x * turn[0, k] + y * turn[1, k] + z * turn[2, k]
