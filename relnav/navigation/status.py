"""What became of one epoch."""

from enum import IntEnum


class EpochStatus(IntEnum):
    """Outcome of one step of the filter; the compiled code carries the integer."""

    WAITING = 0
    """No state yet: no epoch has been confirmed by a neighbour."""
    UPDATED = 1
    """Every spot seen was used."""
    PARTIAL = 2
    """Some of the spots were rejected, the others used."""
    REJECTED = 3
    """Everything seen was rejected; the state is the prediction."""
    PREDICTED = 4
    """Nothing usable was seen; the state is the prediction."""
    STARTED = 5
    """A start was confirmed at this epoch (the first, or after a lock-out)."""


WAITING = int(EpochStatus.WAITING)
UPDATED = int(EpochStatus.UPDATED)
PARTIAL = int(EpochStatus.PARTIAL)
REJECTED = int(EpochStatus.REJECTED)
PREDICTED = int(EpochStatus.PREDICTED)
STARTED = int(EpochStatus.STARTED)
LOST = -1
"""Within one step: the track was worthless and has been dropped."""
