"""By how much what lasting errors show in the rows of an image is not what it usually was.

An innovation holds (E - H S) e: what the errors e, which last, do to the row, less what the state has taken up of them
(`considered.py`). Monitors compare means of innovations with older ones (`monitors.py`), and as long as the craft stays
where it is (E - H S) e falls out of the difference. Where it moves E - H S changes within the 20 s between the means,
and the difference has the variance |(E - H S) - mean of E - H S|^2 more, errors being of one sigma. The mean is made
with the weights of the monitor's own older mean. Their scatter about the mean of the last second has the same of that
mean: after a start the state takes up within seconds what is far more than the noise.
"""

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.codegen.together import anywhere


@kernel
def lasting_change(now: Vector, usual: Vector, fast: Vector) -> tuple[float, float]:
    """By how much what lasting errors show in a row, (m,), differs from before, squared.

    From what it usually was, and from what it was in the last second.
    """
    changed, moved = 0.0, 0.0
    for c in range(now.shape[0]):
        changed += (now[c] - usual[c]) * (now[c] - usual[c])
        moved += (now[c] - fast[c]) * (now[c] - fast[c])
    return changed, moved


@kernel
def learn_lasting(groups: Record, now: Matrix, usual: Matrix, fast: Matrix) -> None:
    """Carry the means on, (2 groups, m), of groups of two rows whose image has just gone into the monitor's own."""
    for g in range(groups.shape[0]):
        weight, fast_weight = groups[g]["weight"], groups[g]["fast_weight"]
        if not anywhere(fast_weight > 0.0):
            continue
        for row in range(2 * g, 2 * g + 2):
            for c in range(now.shape[1]):
                usual[row, c] += weight * (now[row, c] - usual[row, c])
                fast[row, c] += fast_weight * (now[row, c] - fast[row, c])
