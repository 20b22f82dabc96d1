"""By how much what lasting errors show in the rows of `spots` is not what it usually was.

An innovation holds (E - H S) e: what the errors e, which last, do to the row, less what the state has taken up of them
(`beacon_considered.py`). Monitors compare means of innovations with older ones (`estimation/monitors.py`), and as long
as the craft stays where it is (E - H S) e falls out of the difference. Where it moves sideways E - H S changes within
the 20 s between the means, and the difference has the variance |(E - H S) - mean of E - H S|^2 more, errors being of
one sigma. The mean is made with the weights of the monitor's own older mean.
"""

from relnav.arrays import Record, Vector
from relnav.codegen.kernel import kernel
from relnav.navigation.memory import Memory


@kernel
def note_lasting(m: Memory, group: Record, k: int, row: int, h: Vector, first: int, last: int) -> None:
    """Write what lasting errors show in a row, and how much that differs from before into `changed` of its group.

    first, last: rows of errors whose share that the state has taken up is not in `by_error` any more. While an alarm
    lasts the difference is held: what follows is not to explain what was found.
    """
    now, usual, changed = m.lasting_now[row], m.lasting_usual[row], 0.0
    for c in range(now.shape[0]):
        now[c] = m.by_error[row, c]
        if c < first or c >= last:
            s, taken = m.sensitivities[c], 0.0
            for j in range(s.shape[0]):
                taken += h[j] * s[j]
            now[c] -= taken
        changed += (now[c] - usual[c]) * (now[c] - usual[c])
    if m.watch["on"] == 0:
        group["changed"][k] = changed if group["learnt"] > 0 else 0.0


@kernel
def learn_lasting(m: Memory) -> None:
    """Carry the means on, of groups whose image has just gone into the monitor's older mean."""
    for g in range(m.watched.shape[0]):
        weight = m.watched[g]["weight"]
        if weight == 0.0:
            continue
        for row in range(2 * g, 2 * g + 2):
            now, usual = m.lasting_now[row], m.lasting_usual[row]
            for c in range(now.shape[0]):
                usual[c] += weight * (now[c] - usual[c])
