"""What the marker filter has noticed at an epoch beyond its status."""

from enum import IntEnum


class PoseAlarm(IntEnum):
    """Why an image was not used; the compiled code carries the integer."""

    NONE = 0
    EXCHANGED = 1
    """The image fits the state once markers change places: their spots are labelled wrongly, and nothing is started."""
    OUT_OF_VIEW = 2
    """Every pose that explains the image contradicts the expected view and the state: no start is looked for on it."""


EXCHANGED = int(PoseAlarm.EXCHANGED)
OUT_OF_VIEW = int(PoseAlarm.OUT_OF_VIEW)
