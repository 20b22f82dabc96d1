"""A reading that repeats to the last bit: it has no noise, and where it should have moved too, it is stuck."""

from relnav.arrays import Record
from relnav.codegen.kernel import kernel

REPEATS, LEAST_MOTION = 10, 0.1
"""So often alike, and moved by so many sigmas of its noise meanwhile."""


@kernel
def repeats(group: Record, x: float, y: float, dt: float) -> bool:
    """Note a reading dt s after the last; whether it now has been the same ten times or more, for `since` s."""
    reading = group["reading"]
    if x == reading[0] and y == reading[1]:
        group["repeated"] += 1
        group["since"] += dt
    else:
        reading[0], reading[1] = x, y
        group["repeated"], group["since"] = 0, 0.0
    return bool(group["repeated"] >= REPEATS)
