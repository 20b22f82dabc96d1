"""Errors that last, considered and not estimated (Schmidt 1966), for rows whose noise is correlated.

An error e that keeps its value through a run is seen in every image: a row reads z = h(x) + E e + noise. A filter that
takes E e for new noise averages it and becomes overconfident. Beside the filter's own factors L D L^T runs S (m, n):
row c is what one sigma of error c has done to the estimate, estimate minus truth. Being linear in the measurements, S
is carried as the estimate itself is:

    S <- Phi S                           from image to image
    S <- S + P+ H^T R^-1 (E - H S)       at an update, P+ after it
    S <- S - sigma a x dx                where an update moves the estimate by dx, of a turn of the sensor about a
    P  = L D L^T + S^T S                 reported

The fourth is what a linear filter does not have: a wrong attitude turns all that a sensor finds, position and velocity,
about the target. Far away the range moves by metres as it becomes known, and what is found beside it by the error of
the attitude times that. A turn of the camera in its mounting does the same.

The innovation shows E e less what the estimate has taken up of it, (E - H S) e: gate and gain hold that part in R.
"""

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, square, straight_line, vector
from relnav.codegen.together import anywhere, held, select
from relnav.codegen.trace import Shape
from relnav.estimation.factored import add_rank_one, add_three_rank_ones
from relnav.estimation.rows import Observed, row_pattern


@kernel
def is_felt(row: Vector) -> bool:
    """Whether an error moves the estimate at all."""
    felt = False
    for i in range(row.shape[0]):
        felt = felt | (row[i] != 0.0)
    return felt


def _rows(n: int) -> Shape:
    """The rows of a group."""
    return 3, n


@straight_line(of=_rows, h=row_pattern, s=vector)
def _shown(of: Matrix, h: Vector, s: Vector) -> float:  # noqa: ARG001  (tells the compiler how many errors there are)
    """What a row h, one of the rows of a group, shows of an error of the state s (n,)."""
    total: float = h[0] * s[0]
    for j in range(1, s.shape[0]):
        total += h[j] * s[j]
    return total


@straight_line(of=_rows, h=row_pattern, total=vector)
def _add_row(of: Matrix, h: Vector, weight: float, total: Vector) -> None:  # noqa: ARG001  (as above)
    """Add a row h, one of the rows of a group, times a weight to total (n,)."""
    for j in range(total.shape[0]):
        total[j] += h[j] * weight


@kernel
def subtract_taken(groups: Record, by_error: Matrix, sensitivities: Matrix, first: int, last: int) -> None:
    """Replace E (rows, m) of groups by E - H S, of the errors first to last - 1; row k of group g is row 2 g + k."""
    for g in range(groups.shape[0]):
        gradient = groups[g]["gradient"]
        for k in range(groups[g]["rows"]):
            for c in range(first, last):
                by_error[2 * g + k, c] -= _shown(gradient, gradient[k], sensitivities[c])


@kernel
def add_lasting_noise(by_error: Matrix, noise: Matrix) -> None:
    """Add the square of what the estimate has not taken up, (rows, m), to the noise of the rows, (rows, rows)."""
    for i in range(by_error.shape[0]):
        for k in range(i + 1):
            total = 0.0
            for c in range(by_error.shape[1]):
                total += by_error[i, c] * by_error[k, c]
            noise[i, k] += total
            if k < i:
                noise[k, i] = noise[i, k]


@straight_line(ld=square, v=vector, out=vector)
def add_covariance_times(ld: Matrix, v: Vector, out: Vector) -> None:
    """Add L D L^T v to out (n,)."""
    n = ld.shape[0]
    for j in range(n):
        along = v[j]
        for i in range(j + 1, n):
            along += ld[i, j] * v[i]
        along *= ld[j, j]
        out[j] += along
        for i in range(j + 1, n):
            out[i] += ld[i, j] * along


@kernel
def update_sensitivities(ld: Matrix, seen: Observed, by_error: Matrix, news: Matrix, sensitivities: Matrix) -> None:
    """Take an image into S (m, n) that has been taken into the state.

    ld (n, n): factors after it; seen: as the last sweep left it, row k of group g being row 2 g + k of by_error
    (rows, m), E - H S of the rows as they were measured, which is used up; news (m, n): scratch.
    """
    for c in range(news.shape[0]):
        for j in range(news.shape[1]):
            news[c, j] = 0.0
    correlated = seen.noise.shape[0] > 0
    for g in range(seen.groups.shape[0]):
        one = seen.independent[g] if correlated else seen.groups[g]
        tested = one["tested"] > 0
        if not anywhere(tested):
            continue
        gradient = one["gradient"]
        for k in range(one["rows"]):
            i, variance = 2 * g + k, one["variance"][k]
            used = tested & (variance > 0.0)
            if not anywhere(used):
                continue
            used = held(used)
            if correlated:
                for j in range(i):
                    if seen.independent[j // 2]["tested"] > 0 and seen.independent[j // 2]["variance"][j % 2] > 0.0:
                        for c in range(news.shape[0]):
                            by_error[i, c] -= seen.factor[i, j] * by_error[j, c]
            for c in range(news.shape[0]):
                weight = select(used, by_error[i, c] / variance, 0.0)
                if anywhere(weight != 0.0):
                    _add_row(gradient, gradient[k], weight, news[c])
    for c in range(news.shape[0]):
        if anywhere(is_felt(news[c])):
            add_covariance_times(ld, news[c], sensitivities[c])


@straight_line(axis=(3,), change=(3,), row=(3,))
def follow_turn(sigma: float, axis: Vector, change: Vector, row: Vector) -> None:
    """Take sigma a x dx from what a turn of the sensor by sigma about a does to a vector that an update moved by dx."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        row[i] -= sigma * (axis[j] * change[k] - axis[k] * change[j])


@kernel
def join_considered(ld: Matrix, sensitivities: Matrix) -> None:
    """Replace a filter's own factors by those of what is reported, L D L^T + S^T S."""
    count = sensitivities.shape[0]
    threes = count - count % 3
    for c in range(0, threes, 3):
        if is_felt(sensitivities[c]) or is_felt(sensitivities[c + 1]) or is_felt(sensitivities[c + 2]):
            add_three_rank_ones(ld, sensitivities[c : c + 3])
    for c in range(threes, count):
        if is_felt(sensitivities[c]):
            add_rank_one(ld, sensitivities[c])
