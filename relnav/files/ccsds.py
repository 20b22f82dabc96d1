"""What CCSDS messages in keyword = value notation share: their head, their times, the epochs that have a state."""

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from relnav.arrays import Codes
from relnav.dynamics.in_frame import OWN, frame_words
from relnav.errors import UsageError
from relnav.files.wording import printable


def creation() -> str:
    """The date of creation, which a message must state."""
    return datetime.now(UTC).replace(tzinfo=None).isoformat(timespec="seconds")


def epoch_of(settings: dict[str, Any], what: str) -> datetime:
    """The UTC of the log's t = 0.

    Raises
    ------
    UsageError
        If it is missing or no date.
    """
    text = settings.get("epoch")
    if not text:
        raise UsageError(f"{what} needs the date of the log's t = 0: epoch='2026-07-02T12:00:00' (--epoch), UTC")
    try:
        moment = datetime.fromisoformat(str(text))
    except ValueError:
        raise UsageError(f"epoch is an ISO date and time, 2026-07-02T12:00:00; got '{printable(text)}'") from None
    return moment.astimezone(UTC).replace(tzinfo=None) if moment.tzinfo else moment


def orientation_of(settings: dict[str, Any], what: str) -> tuple[float, float, float]:
    """The orientation of the target's orbit, which inertial axes need, deg.

    Raises
    ------
    UsageError
        If it is missing, or not three numbers.
    """
    given = settings["orientation_deg"]
    if given is None:
        raise UsageError(
            f"{what} is in inertial axes and needs the orientation of the target's orbit: orientation_deg=(51.6, "
            "130.0, 40.0) (--orbit-deg 51.6 130 40), inclination, right ascension of the ascending node, argument of "
            "perigee"
        )
    frame_words("eci_relative", settings["model"], given)
    inclination, node, perigee = map(float, given)
    return inclination, node, perigee


def check_attitude(settings: dict[str, Any], what: str, instead: str) -> None:
    """Refuse to write attitudes where there are none, or in another frame than the format's.

    Raises
    ------
    UsageError
        Saying what to write instead.
    """
    if not settings["attitude"]:
        raise UsageError(
            f"{what} holds attitudes, which a three-beacon track does not estimate; write its states, {instead}"
        )
    if settings["frame"] != OWN:
        raise UsageError(f"{what} holds attitudes against inertial axes alone: leave frame {settings['frame']!r} out")


def stamps(epoch: datetime, t_s: Any, what: str) -> list[str]:
    """Times as CCSDS writes them, to a microsecond.

    Raises
    ------
    UsageError
        For times beyond the calendar, or closer than a microsecond.
    """
    try:
        out = [(epoch + timedelta(seconds=float(t))).isoformat(timespec="microseconds") for t in t_s]
    except OverflowError:
        raise UsageError(f"{what}: the epoch plus {float(np.max(t_s)):.9g} s lies beyond the year 9999") from None
    if len(set(out)) < len(out):
        raise UsageError(f"{what}: rows less than a microsecond apart cannot be told apart in it")
    return out


def known_epochs(solution: Any, what: str) -> Codes:
    """Numbers of the epochs that have a state.

    Raises
    ------
    UsageError
        If none has: the format has no word for that.
    """
    known = np.flatnonzero(np.isfinite(np.asarray(solution.state)[:, 0]))
    if not known.size:
        raise UsageError(f"{what} holds states, and this track has none: the filter never started")
    return known


def name_of(text: object) -> str:
    """A name as a value of a message: one line of plain characters."""
    return "".join(c if c.isascii() and c.isprintable() else "_" for c in str(text))
