"""The lights of an image, about which a correction turns the target.

One light tells three errors of a place, and no turn of the target about it: its middle is where it was, and the path to
the target's own centre goes with the turn psi, in `lvlh_ccsds`, by psi x C p. The direction of that is another one
about each estimate C of the target's attitude. A filter that corrects path and attitude by addition takes the
difference for a measurement, image by image, and believes in the end that it knows an attitude which nothing told.

So what an image told is where the mean of its lights is seen: p in the target, with m the error of that place. With the
errors of `reset`, this is the same about both estimates, told in axes that turn by R with the path (`retraction`):

    e = rho - phi x r - C (b x p + m),   e_new = R e

b x p + m is the same about both too, so that to the new error of the path is added what the turn R does not explain of
the target's,

    rho_new = phi x r_new + R (rho - phi x r) + D (b x p + m),   D = C_new - R C

and a correction with psi of the target, s phi shared by the path, and m of the place moves it by

    r_new = R (r + rho - s phi x r) + D (p + m) - R ((psi - s phi) x C p)

Any p is true to first order. That of the image before is taken, of all its lights where many are seen: it is what is
known when an image, or the whole of what comes later, corrects the estimate, be it of other lights and by degrees.
"""

import numpy as np

from relnav.arrays import Codes, Matrix, Record, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.geometry.linear_algebra import cross_into
from relnav.vehicle.layout import DRIVING, POSITION, TARGET_ATTITUDE

_POSITION, _TARGET = POSITION.start, TARGET_ATTITUDE.start
WEIGHTS = 3
"""Where in a pivot the weights of the lights begin; before them stands the mean of their stated places."""


def no_pivot(lights: Codes) -> Vector:
    """That before the first image, (3 + l,): the target's centre, which leaves a correction as it is."""
    return np.zeros(WEIGHTS + len(lights))


def pivot_scratch(n: int) -> list[tuple[str, type[np.float64], int | tuple[int, ...]]]:
    """Fields of scratch for n errors.

    middle: p, with its estimated errors; arm: C p; less: (psi - s phi) x C p; lever: D; told: of m and all errors.
    """
    return [
        ("middle", np.float64, 3),
        ("arm", np.float64, 3),
        ("less", np.float64, 3),
        ("lever", np.float64, (3, 3)),
        ("by_lights", np.float64, (3, 3)),
        ("told", np.float64, (3, n)),
    ]


@entry
def pivot_into(points: Matrix, places: Codes, lights: Codes, spots: Vector, out: Vector) -> None:
    """Write the pivot (3 + l,) of an image: of points (k, 3) whose spots (2 k,) are not NaN; at least one is not.

    places (k,), lights (l,): where the errors of the sensor's own lights, and of all lights, begin.
    """
    for i in range(len(out)):
        out[i] = 0.0
    seen = 0
    for k in range(len(places)):
        if np.isfinite(spots[2 * k]):
            seen += 1
    for k in range(len(places)):
        if np.isfinite(spots[2 * k]):
            for i in range(3):
                out[i] += points[k, i] / seen
            for j in range(len(lights)):
                if lights[j] == places[k]:
                    out[WEIGHTS + j] += 1.0 / seen


@kernel
def mean_place_into(values: Vector, lights: Codes, pivot: Vector, middle: Vector) -> None:
    """Write the mean of the lights' places as estimated, (3,), target axes; values (n,)."""
    for i in range(3):
        middle[i] = pivot[i]
    for j in range(len(lights)):
        for i in range(3):
            middle[i] += pivot[WEIGHTS + j] * values[lights[j] + i]


@kernel
def lever_into(correction: Vector, target: Matrix, new_target: Matrix, scratch: Record) -> None:
    """Write D, C p and (psi - s phi) x C p; p, R and s phi in scratch, both attitudes of the target (3, 3)."""
    middle, arm, less, D = scratch["middle"], scratch["arm"], scratch["less"], scratch["lever"]
    turn, phi, psi = scratch["turn"], scratch["phi"], scratch["own"]
    for i in range(3):
        C = target[i]
        arm[i] = C[0] * middle[0] + C[1] * middle[1] + C[2] * middle[2]
        psi[i] = C[0] * correction[_TARGET] + C[1] * correction[_TARGET + 1] + C[2] * correction[_TARGET + 2] - phi[i]
        for c in range(3):
            D[i, c] = new_target[i, c]
            D[i, c] -= turn[i, 0] * target[0, c] + turn[i, 1] * target[1, c] + turn[i, 2] * target[2, c]
    cross_into(psi, arm, less)


@kernel
def move_about_lights(correction: Vector, lights: Codes, pivot: Vector, scratch: Record, moved: Vector) -> None:
    """Add to moved (n,) what a turn about the lights adds to the position; the rest in scratch, as of `lever_into`."""
    turn, D, less, place = scratch["turn"], scratch["lever"], scratch["less"], scratch["arm"]
    for i in range(3):
        place[i] = scratch["middle"][i]
    for j in range(len(lights)):
        for i in range(3):
            place[i] += pivot[WEIGHTS + j] * correction[lights[j] + i]
    for i in range(3):
        moved[_POSITION + i] += D[i, 0] * place[0] + D[i, 1] * place[1] + D[i, 2] * place[2]
        moved[_POSITION + i] -= turn[i, 0] * less[0] + turn[i, 1] * less[1] + turn[i, 2] * less[2]


@kernel
def change_about_lights(scratch: Record) -> None:
    """Add D (b x p), with b = theta_T - K theta_C, to the position's rows of a change (`reset.change_into`)."""
    change, K, p, D = scratch["change"], scratch["to_lvlh"][3:6], scratch["middle"], scratch["lever"]
    for i in range(3):
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            by_b = D[i, e] * p[d] - D[i, d] * p[e]
            change[_POSITION + i, c] += by_b
            for m in range(3):
                change[_POSITION + i, 3 + m] -= by_b * K[c, m]


@kernel
def refer_about_lights(P: Matrix, lights: Codes, pivot: Vector, scratch: Record) -> None:
    """Replace P (n, n) by that with R^T D m added to the position's error, before R turns it; P as of `refer_into`."""
    n, told, turn, D, by_lights = P.shape[0], scratch["told"], scratch["turn"], scratch["lever"], scratch["by_lights"]
    for i in range(3):
        for c in range(3):
            by_lights[i, c] = turn[0, i] * D[0, c] + turn[1, i] * D[1, c] + turn[2, i] * D[2, c]
        for c in range(n):
            told[i, c] = 0.0
    for j in range(len(lights)):
        weight, first = pivot[WEIGHTS + j], lights[j]
        if weight > 0.0:
            for i in range(3):
                for c in range(n):
                    told[i, c] += weight * (P[c, first + i] if c < first + i else P[first + i, c])
    _add_to_position(P, lights, pivot, by_lights, told)


@kernel
def _add_to_position(P: Matrix, lights: Codes, pivot: Vector, by_lights: Matrix, told: Matrix) -> None:
    """Add what comes with by_lights m to the position's rows; told (3, n): of m and all errors."""
    for i in range(3):
        B = by_lights[i]
        for c in range(i, 3):
            a, b, own = _POSITION + i, _POSITION + c, by_lights[c]
            total = B[0] * told[0, b] + B[1] * told[1, b] + B[2] * told[2, b]
            total += own[0] * told[0, a] + own[1] * told[1, a] + own[2] * told[2, a]
            for j in range(len(lights)):
                weight, first = pivot[WEIGHTS + j], lights[j]
                for k in range(3):
                    for m in range(3):
                        total += weight * B[k] * told[k, first + m] * own[m]
            P[a, b] += total
            P[b, a] = P[a, b]
        for c in range(POSITION.stop, P.shape[0]):
            P[_POSITION + i, c] += B[0] * told[0, c] + B[1] * told[1, c] + B[2] * told[2, c]
            if c < DRIVING:
                P[c, _POSITION + i] = P[_POSITION + i, c]


@kernel
def row_about_lights(row: Vector, lights: Codes, pivot: Vector, scratch: Record) -> None:
    """Add to a row (n,) about a corrected estimate, not yet turned back, what its position's part tells of lights."""
    D, x, y, z = scratch["lever"], row[_POSITION], row[_POSITION + 1], row[_POSITION + 2]
    for j in range(len(lights)):
        for i in range(3):
            row[lights[j] + i] += pivot[WEIGHTS + j] * (x * D[0, i] + y * D[1, i] + z * D[2, i])
