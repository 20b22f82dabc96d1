"""What became of one epoch."""

from enum import IntEnum, IntFlag

from relnav.estimation import monitors


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


WAITING, UPDATED, PARTIAL, REJECTED, PREDICTED, STARTED = map(int, EpochStatus)
LOST = -1
"""Within one step: the track was worthless and has been dropped."""


class Alarm(IntFlag):
    """Result of the monitors at an epoch: do not use the state unless it is NONE."""

    NONE = 0
    """Nothing."""
    SHIFTED = monitors.SHIFTED
    """Innovations of a beacon, a marker or an image are not what they were: something has begun that lasts.

    Of markers it stays until images agree again with what was before, or for good after a minute; it also says that
    another pose has taken the lead from a settled one, or that a spot long refused is used again though it surprises.
    """
    CONTRADICTED = monitors.CONTRADICTED
    """Images contradict the stated attitude, or beacons, by more than their lasting errors explain.

    Of markers also: one of three spots is refused image after image, so that it is bad or the pose is wrong.
    """
    NOISY = monitors.NOISY
    """Innovations scatter more than their noise explains, or more spots are refused than outliers explain."""
    STUCK = monitors.STUCK
    """A spot does not move although the predicted one does."""
    CLOCK = monitors.CLOCK
    """After a long step: the clock has jumped, or images have not decided yet whether it has, where it would matter."""
    RESTARTED = monitors.RESTARTED
    """A new start has replaced the track less than 10 s ago."""
    UNWATCHED = monitors.UNWATCHED
    """The engine has no monitors (filterpy)."""
    EXCHANGED = 128
    """The image fits the state once markers change places: their spots are labelled wrongly, and nothing is started."""
    OUT_OF_VIEW = 256
    """Every pose that explains the image contradicts the expected view and the state: no start is looked for on it."""

    @property
    def words(self) -> str:
        """Names, joined by +; empty for none."""
        return "+".join(str(one.name) for one in Alarm if one & self)


EXCHANGED, OUT_OF_VIEW = int(Alarm.EXCHANGED), int(Alarm.OUT_OF_VIEW)
ALARM_TABLE = "sum of " + ", ".join(f"{int(one)} {one.name}" for one in Alarm) + "; 0: no alarm"
"""Codes of an `alarm` column, for its reader."""
