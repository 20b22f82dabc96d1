"""An epoch as a user writes it, as a Julian year."""

from datetime import UTC, datetime

from relnav.errors import UsageError

J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)


def julian_year(text: str) -> float:
    """Julian year of "2026.5" or of an ISO date and time (UTC unless it says otherwise; the minute to TDB is dropped).

    Raises
    ------
    UsageError
        For anything else, and outside 1900 to 2200.
    """
    try:
        year = float(text)
    except ValueError:
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            raise UsageError(
                f"--epoch takes a Julian year or an ISO date, 2026.5 or 2026-07-02T12:00; got '{text}'"
            ) from None
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        year = 2000.0 + (moment - J2000).total_seconds() / (365.25 * 86400.0)
    if not 1900.0 <= year < 2200.0:
        raise UsageError(f"--epoch {text} is the year {year:g}; the catalogue's proper motions serve 1900 to 2200")
    return year
