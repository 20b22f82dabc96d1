"""Other people's words in our sentences: nothing that a terminal obeys, no line that passes for ours, not too long."""

from collections.abc import Iterable

LONGEST = 200
MOST_LISTED = 20


def printable(text: object) -> str:
    """The text in one line: what is no visible character (controls, line ends, direction marks) as an escape."""
    return "".join(c if c.isprintable() else _escape(c) for c in str(text))


def _escape(character: str) -> str:
    return character.encode("unicode_escape", "backslashreplace").decode("ascii")


def shown(value: object, most: int = LONGEST) -> str:
    """The same, only its beginning if it is long."""
    text = str(value)
    return printable(text) if len(text) <= most else f"{printable(text[:most])} ... ({len(text)} characters)"


def columns_are(names: Iterable[object]) -> str:
    """The columns of a header where one is missing; of units in brackets, how they are written here."""
    words = listed(names)
    return f"the columns are {words}" + ("; write a unit without brackets: t_s" if "(" in words or "[" in words else "")


def listed(names: Iterable[object], most: int = MOST_LISTED) -> str:
    """Names after commas; of many only the first, and how many more there are."""
    every = list(names)
    words = ", ".join(shown(name, 80) for name in every[:most])
    return words if len(every) <= most else f"{words} and {len(every) - most} more"
