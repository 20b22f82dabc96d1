"""By how much what lasting errors show in the rows of `spots` is not what it usually was.

An innovation holds (E - H S) e: what the errors e, which last, do to the row, less what the state has taken up of them
(`beacon_considered.py`). Monitors compare means of innovations with older ones (`estimation/monitors.py`), and as long
as the craft stays where it is (E - H S) e falls out of the difference. Where it moves sideways E - H S changes within
the 20 s between the means, and the difference has the variance |(E - H S) - mean of E - H S|^2 more, errors being of
one sigma. The mean is made with the weights of the monitor's own older mean. Their scatter about the mean of the last
second has the same of that mean: after a start the state takes up within seconds what is far more than the noise.
"""

from relnav.arrays import Vector
from relnav.codegen.kernel import kernel
from relnav.codegen.together import anywhere, select
from relnav.navigation.memory import Memory


@kernel
def lasting_change(m: Memory, row: int, h: Vector, first: int, last: int, seen: bool) -> tuple[float, float]:
    """Write what lasting errors show in a row, where it is seen; returns by how much that differs from before, squared.

    From what it usually was, and from what it was in the last second. first, last: rows of errors whose share that the
    state has taken up is not in `by_error` any more.
    """
    now, usual, fast, changed, moved = m.lasting_now[row], m.lasting_usual[row], m.lasting_fast[row], 0.0, 0.0
    for c in range(now.shape[0]):
        shown = m.by_error[row, c]
        if c < first or c >= last:
            s, taken = m.sensitivities[c], 0.0
            for j in range(s.shape[0]):
                taken += h[j] * s[j]
            shown -= taken
        now[c] = select(seen, shown, now[c])
        changed += (now[c] - usual[c]) * (now[c] - usual[c])
        moved += (now[c] - fast[c]) * (now[c] - fast[c])
    return changed, moved


@kernel
def learn_lasting(m: Memory) -> None:
    """Carry the means on, of groups whose image has just gone into the monitor's own."""
    for g in range(m.watched.shape[0]):
        weight, fast_weight = m.watched[g]["weight"], m.watched[g]["fast_weight"]
        if not anywhere(fast_weight > 0.0):
            continue
        for row in range(2 * g, 2 * g + 2):
            now, usual, fast = m.lasting_now[row], m.lasting_usual[row], m.lasting_fast[row]
            for c in range(now.shape[0]):
                usual[c] += weight * (now[c] - usual[c])
                fast[c] += fast_weight * (now[c] - fast[c])
