"""What a pair of spots taken for a pair of stars is asked first: whether other spots fall on stars as well.

Almost every pair is a wrong one, so that a hopeless frame spends its time here. Spots are written once in the triad of
their pair. A pair of stars has its triad too, one for both orders (half a turn apart) and both fields; the products of
the two tell where a spot would look, and one look into `SkyArrays.near` mostly that there is nothing.
"""

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.rotation import triad
from relnav.sensors.dual_field.matching import (
    LOOSEST_CHORD2,
    Frame,
    aberrate_into,
    aberration_undone,
    loose_chord2,
    slip_variance,
)
from relnav.sensors.dual_field.sky import SkyArrays, nearest_star, none_near

FEW_SPOTS = 12
"""Up to so many spots of two fields (half of one) all of them are asked."""

QUESTIONS = FEW_SPOTS
"""Rows of a table of questions (QUESTIONS, 5): a spot's direction in the triad of its pair, the square of the
tolerance, the magnitude."""


@kernel
def spot_triad(W: Matrix, p: int, q: int, out: Matrix, work: Matrix) -> bool:
    """Write the triad (3, 3) of the sum and the difference of rows p and q of `W`; work (2, 3) is scratch."""
    for k in range(3):
        work[0, k], work[1, k] = W[p, k] + W[q, k], W[p, k] - W[q, k]
    return triad(work[0], work[1], out)


@kernel
def star_triad(stars: Matrix, beta: Vector, a: int, c: int, out: Matrix, work: Matrix) -> bool:
    """Write the triad (3, 3) of the sum and the difference of stars a and c as they are seen; work (4, 3) is scratch.

    The triad of c and a is the same with rows 1 and 2 turned round: what is called `sign` below.
    """
    aberrate_into(stars[a, 0], stars[a, 1], stars[a, 2], beta, 1.0, work[2])
    aberrate_into(stars[c, 0], stars[c, 1], stars[c, 2], beta, 1.0, work[3])
    return spot_triad(work, 2, 3, out, work)


@kernel
def attitude_of_triads(spots: Matrix, stars: Matrix, sign: float, A: Matrix) -> None:
    """Write the attitude (3, 3) that sees the triad of stars along the triad of spots."""
    for r in range(3):
        for k in range(3):
            along = spots[0, r] * stars[0, k] + spots[1, r] * (sign * stars[1, k])
            A[r, k] = along + spots[2, r] * (sign * stars[2, k])


@kernel
def extent(spots: int, fields: int, least: int) -> tuple[int, int, int]:
    """How many of a frame's spots are asked, in how many fields each, and how many of them must find a star.

    A few, in the pair's own field, where they are predicted closely, refuse all but a few wrong pairs; a right one that
    is refused is followed by others. Among few spots all are asked, in either field, and `least` must find one.
    """
    if spots <= FEW_SPOTS // fields:
        return spots - 2, fields, least
    return min(spots - 2, 2 + fields), 1, 1


@kernel
def prepare_questions(
    frame: Frame,
    i: int,
    j: int,
    field: int,
    pair: Matrix,
    asked: int,
    ways: int,
    questions: Matrix,
) -> None:
    """Write what is asked of spots i and j, taken to lie in a field, with their triad (3, 3): `ways` rows a spot.

    The spots asked change with the pair, so that a few bright false ones do not stand in every pair's way.
    """
    W, n = frame.W, frame.sigma2.shape[0]
    p, q = field * n + i, field * n + j
    m0, m1, m2 = W[p, 0] + W[q, 0], W[p, 1] + W[q, 1], W[p, 2] + W[q, 2]
    row, step = 0, 0
    while row < ways * asked:
        step += 1
        k = (j + step) % n
        if k in (i, j):
            continue
        for way in range(ways):
            w = (field if way == 0 else 1 - field) * n + k
            for axis in range(3):
                questions[row, axis] = pair[axis, 0] * W[w, 0] + pair[axis, 1] * W[w, 1] + pair[axis, 2] * W[w, 2]
            questions[row, 3] = loose_chord2(W, w, frame.sigma2[k], m0, m1, m2)
            if way == 1:
                questions[row, 3] = min(LOOSEST_CHORD2, questions[row, 3] + 16.0 * slip_variance(frame))
            questions[row, 4] = frame.magnitude[w]
            row += 1


@kernel
def promising(
    frame: Frame,
    sky: SkyArrays,
    questions: Matrix,
    asked: int,
    ways: int,
    least: int,
    pair: Matrix,
    sign: float,
) -> bool:
    """Whether `least` of the spots asked find a star, were the spots' triad that of a pair of stars (3, 3)."""
    b = frame.beta
    missing = least
    for spot in range(asked):
        if missing > asked - spot:
            return False
        for way in range(ways):
            row = ways * spot + way
            c0, c1, c2 = questions[row, 0], sign * questions[row, 1], sign * questions[row, 2]
            x, y, z = aberration_undone(
                c0 * pair[0, 0] + c1 * pair[1, 0] + c2 * pair[2, 0],
                c0 * pair[0, 1] + c1 * pair[1, 1] + c2 * pair[2, 1],
                c0 * pair[0, 2] + c1 * pair[1, 2] + c2 * pair[2, 2],
                b,
            )
            t2, magnitude = questions[row, 3], questions[row, 4]
            if none_near(sky.near, x, y, z, t2):
                continue
            if nearest_star(sky.stars, sky.cells, x, y, z, t2, magnitude, frame.gate) >= 0:
                missing -= 1
                break
        if missing <= 0:
            return True
    return missing <= 0
