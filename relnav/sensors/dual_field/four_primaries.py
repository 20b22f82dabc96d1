"""The patent's identification (claim 4): four brightest spots, eight field cases, two pair tables.

The patent is You, Xing, Dong (2004), "Dual-field star sensor and star identification with it", patent CN 1609549.
As the patent has it, with two things it lacks: the exact angle between stars of different fields (`literal=True` takes
its 90 deg -+ alpha instead, which a mirror does not obey), and handedness, which alone tells a solution from the one
with its fields swapped: all six angles are the same in both.
"""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.wahba import solve_wahba
from relnav.sensors.dual_field.fold import fold_rays
from relnav.sensors.dual_field.pair_table import Indices, PairTable, build_pair_table, k_range
from relnav.sensors.dual_field.solution import StarSolution, StarStatus, no_solution

MOST_FOUND = 64
MOST_CANDIDATES = 40_000


@dataclass(frozen=True, eq=False)
class FourSky:
    """Apparent directions of the stars (they hold for one velocity) with the patent's two tables.

    Attributes
    ----------
    directions, hip : (n, 3), (n,)
        The stars.
    table_one, table_two : PairTable
        Angles of 0 to F and of 90 deg - F to 90 deg + F, F the width of the field.
    """

    directions: Matrix
    hip: Indices
    table_one: PairTable
    table_two: PairTable


def build_four_sky(directions: Matrix, hip: Indices, field_width_rad: float) -> FourSky:
    """Both tables for a field of full width F (a square one: its diagonal)."""
    return FourSky(
        np.ascontiguousarray(directions),
        hip,
        build_pair_table(directions, 0.0, field_width_rad),
        build_pair_table(directions, 0.5 * math.pi - field_width_rad, 0.5 * math.pi + field_width_rad),
    )


@kernel
def allowed_cosines(
    W: Matrix, i: int, j: int, field_i: int, field_j: int, tolerance: float, literal: bool, out: Matrix
) -> None:
    """Write up to two ranges of the cosine between the stars of primaries i and j: rows (low, high) of out (2, 2)."""
    a, b = field_i * 4 + i, field_j * 4 + j
    if literal and field_i != field_j:
        alpha = math.acos(min(1.0, W[i, 0] * W[j, 0] + W[i, 1] * W[j, 1] + W[i, 2] * W[j, 2]))
        for k in range(2):
            angle = 0.5 * math.pi + (alpha if k == 1 else -alpha)
            out[k, 0], out[k, 1] = math.cos(angle + tolerance), math.cos(angle - tolerance)
        return
    cosine = W[a, 0] * W[b, 0] + W[a, 1] * W[b, 1] + W[a, 2] * W[b, 2]
    angle = math.acos(max(-1.0, min(1.0, cosine)))
    out[0, 0], out[0, 1] = math.cos(angle + tolerance), math.cos(max(0.0, angle - tolerance))
    out[1, 0], out[1, 1] = 2.0, -2.0


@kernel
def candidates(ranges: Matrix, cosines: Vector, pairs: Indices, k: Indices, line: Vector, out: Indices) -> int:
    """Write the star pairs of both ranges into out (m, 2), each in both orders; how many."""
    count = 0
    for r in range(2):
        if ranges[r, 0] > ranges[r, 1]:
            continue
        first, last = k_range(cosines, k, line, ranges[r, 0], ranges[r, 1])
        for p in range(first, last):
            if count + 2 > out.shape[0]:
                return count
            out[count, 0], out[count, 1] = pairs[p, 0], pairs[p, 1]
            out[count + 1, 0], out[count + 1, 1] = pairs[p, 1], pairs[p, 0]
            count += 2
    return count


@kernel
def within(directions: Matrix, a: int, b: int, ranges: Matrix) -> bool:
    """Whether two stars' cosine lies in one of two ranges: what a look into the table says."""
    cosine = (
        directions[a, 0] * directions[b, 0] + directions[a, 1] * directions[b, 1] + directions[a, 2] * directions[b, 2]
    )
    return bool(ranges[0, 0] <= cosine <= ranges[0, 1] or ranges[1, 0] <= cosine <= ranges[1, 1])


@kernel
def chain(count: int, lists: Indices, head: Indices, following: Indices) -> None:
    """Link the candidates that begin with the same star: head (n,) and following (m,), -1 ends a chain."""
    for c in range(count):
        star = lists[c, 0]
        following[c] = head[star]
        head[star] = c


@kernel
def unchain(count: int, lists: Indices, head: Indices) -> None:
    """Take the links off the heads again."""
    for c in range(count):
        head[lists[c, 0]] = -1


@kernel
def four_primaries(
    W: Matrix,
    directions: Matrix,
    cos1: Vector,
    pairs1: Indices,
    k1: Indices,
    line1: Vector,
    cos2: Vector,
    pairs2: Indices,
    k2: Indices,
    line2: Vector,
    tolerance: float,
    literal: bool,
    lists: Indices,
    heads: Indices,
    following: Indices,
    ranges: Matrix,
    found: Indices,
) -> int:
    """All quadruples of stars whose six angles fit, over the eight cases: rows of found (m, 8), stars, fields.

    Returns how many. W (8, 3): the primaries' directions in field 0, then in field 1. lists (3 m, 2), heads (2, n) full
    of -1, following (2, m), ranges (12, 2) are scratch.
    """
    m = lists.shape[0] // 3
    count = 0
    for case in range(8):
        fields = (0, case & 1, (case >> 1) & 1, (case >> 2) & 1)
        row = 0
        sizes = (0, 0, 0)
        for i in range(3):
            for j in range(i + 1, 4):
                allowed_cosines(W, i, j, fields[i], fields[j], tolerance, literal, ranges[row : row + 2])
                if i == 0:
                    part = lists[(j - 1) * m : j * m]
                    if fields[j] == 0:
                        size = candidates(ranges[row : row + 2], cos1, pairs1, k1, line1, part)
                    else:
                        size = candidates(ranges[row : row + 2], cos2, pairs2, k2, line2, part)
                    sizes = (size, sizes[0], sizes[1])
                row += 2
        chain(sizes[1], lists[m : 2 * m], heads[0], following[0])
        chain(sizes[0], lists[2 * m : 3 * m], heads[1], following[1])
        for p in range(sizes[2]):
            a, b = lists[p, 0], lists[p, 1]
            q = heads[0, a]
            while q >= 0:
                c = lists[m + q, 1]
                if c != b and within(directions, b, c, ranges[6:8]):
                    r = heads[1, a]
                    while r >= 0:
                        d = lists[2 * m + r, 1]
                        fits = within(directions, b, d, ranges[8:10]) and within(directions, c, d, ranges[10:12])
                        if d not in (b, c) and fits and count < found.shape[0]:
                            found[count, 0], found[count, 1], found[count, 2], found[count, 3] = a, b, c, d
                            for k in range(4):
                                found[count, 4 + k] = fields[k]
                            count += 1
                        r = following[1, r]
                q = following[0, q]
        unchain(sizes[1], lists[m : 2 * m], heads[0])
        unchain(sizes[0], lists[2 * m : 3 * m], heads[1])
    return count


def right_handed(w: Matrix, v: Matrix) -> bool:
    """Whether a rotation can lead from v (4, 3) to w (4, 3): the widest triple has the same handedness in both."""
    triples = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    volumes = [(np.linalg.det(w[list(t)]), np.linalg.det(v[list(t)])) for t in triples]
    seen, known = max(volumes, key=lambda pair: abs(pair[0]))
    return bool(seen * known > 0.0)


def primaries(u: Matrix, sky: FourSky, fold: Matrix, tolerance_rad: float, *, literal: bool = False) -> Codes:
    """Quadruples for the first four of the rays u (n, 3), after the test of handedness: rows (m, 8) of stars, fields.

    Raises
    ------
    ValueError
        For a fold that is not a mirror: its handedness tells nothing.
    """
    if np.linalg.det(fold) > 0.0:
        raise ValueError("the patent's method is for a mirror; with a turned second field handedness decides nothing")
    W = np.ascontiguousarray(np.concatenate([u[:4], u[:4] @ fold.T]))
    one, two = sky.table_one, sky.table_two
    found = np.empty((MOST_FOUND, 8), dtype=np.int32)
    count = four_primaries(
        W,
        sky.directions,
        *(one.cos, one.stars, one.k, one.line),
        *(two.cos, two.stars, two.k, two.line),
        tolerance_rad,
        literal,
        np.empty((3 * MOST_CANDIDATES, 2), dtype=np.int32),
        np.full((2, len(sky.directions)), -1, dtype=np.int32),
        np.empty((2, MOST_CANDIDATES), dtype=np.int32),
        np.empty((12, 2)),
        found,
    )
    quads = []
    for row in found[:count].astype(np.int64):
        star, field = row[:4], row[4:]
        if not right_handed(fold_rays(u[:4], field, fold), sky.directions[star]):
            field = 1 - field  # the same angles, the other field each: a mirror turns the handedness round
        quads.append(np.concatenate([star, field]))
    return np.unique(np.array(quads, dtype=np.int64).reshape(-1, 8), axis=0)


def identify_patent(u: Matrix, sky: FourSky, *, fold: Matrix, sigma_rad: Vector, literal: bool = False) -> StarSolution:
    """The whole of the patent's method: four primaries, then every other spot by its angles to them.

    Angles are compared within four sigma of a pair. More than one quadruple is AMBIGUOUS, none NO_MATCH: the patent
    has nothing to say on either.
    """
    n = len(u)
    if n < 4:
        return no_solution(StarStatus.TOO_FEW, f"{n} spots; the method needs four", n)
    tolerance = 4.0 * math.sqrt(2.0) * float(np.max(sigma_rad))
    quads = primaries(u, sky, fold, tolerance, literal=literal)
    if len(quads) != 1:
        status = StarStatus.AMBIGUOUS if len(quads) else StarStatus.NO_MATCH
        return no_solution(status, f"{len(quads)} quadruples of stars fit the four brightest spots", n)
    star, field = np.full(n, -1, dtype=np.int64), np.full(n, -1, dtype=np.int64)
    star[:4], field[:4] = quads[0, :4], quads[0, 4:]
    first = fold_rays(u[:4], field[:4], fold)
    dcm = solve_wahba(first, sky.directions[star[:4]], sigma_rad[:4]).dcm
    for f in range(2):
        rays = fold_rays(u, np.full(n, f, dtype=np.int64), fold)
        nearest = np.argmax(rays @ dcm @ sky.directions.T, axis=1)
        seen, known = rays @ first.T, sky.directions[nearest] @ sky.directions[star[:4]].T
        fits = np.all(np.abs(np.arccos(np.clip(seen, -1, 1)) - np.arccos(np.clip(known, -1, 1))) < tolerance, axis=1)
        new = fits & (star < 0)
        star[new], field[new] = nearest[new], f
    used = star >= 0
    w = fold_rays(u[used], field[used], fold)
    solution = solve_wahba(w, sky.directions[star[used]], sigma_rad[used])
    residual = np.full(n, np.nan)
    residual[used] = np.linalg.norm(w - sky.directions[star[used]] @ solution.dcm.T, axis=1)
    return StarSolution(
        status=StarStatus.OK,
        reason="",
        dcm_cam_from_icrs=solution.dcm,
        covariance=solution.covariance,
        hip=np.where(used, sky.hip[star], 0),
        field=field,
        residual_rad=residual,
        log10_false_alarm=math.nan,
        tried=len(quads),
        focal_length_px=math.nan,
    )
