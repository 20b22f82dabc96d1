"""Who chooses what is exchanged in a good file: hypothesis, which makes small what it found, or a seed, which is quick.

The mutators of `fuzzing_bytes.py` ask for whole numbers, members, words and bytes. Any `random.Random` may stand behind
a seed, so also one whose chance is told by a tool that looks at which lines are run (`fuzzing_coverage.py`).
"""

import random
import struct
from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

from hypothesis import strategies as st

T = TypeVar("T")
NUMBERS = ["0", "-0.0", "nan", "inf", "-inf", "1e308", "-1e308", "5e-324", "1e20", "1e-20", "1e999", "0x10", "1_5", "٣"]
WORDS = ["", " ", '"', '""', '"a', "a,b", "#", "\x00", "\x1b[31m", "\r", "\u2028", "\ufeff", "é", "t_s", "=", "[", "]"]
LETTERS = ((0x20, 0x7E), (0x20, 0x7E), (0, 0xFF), (0, 0xD7FF), (0xE000, 0x10FFFF))
"""Ranges of what a text of a seed holds: mostly what a keyboard has, no surrogates."""
CELLS = st.sampled_from(NUMBERS + WORDS) | st.floats().map(repr) | st.integers().map(str) | st.text(max_size=5)


class Choices(Protocol):
    """What a mutator asks for."""

    def whole(self, low: int, high: int) -> int:
        """A whole number, both ends among them."""

    def one(self, members: Sequence[T]) -> T:
        """One of these."""
        return members[self.whole(0, len(members) - 1)]

    def text(self, most: int) -> str:
        """At most so many characters, of any kind but surrogates."""

    def some(self, most: int) -> bytes:
        """At most so many bytes."""

    def cell(self) -> str:
        """What stands in a cell or in its place."""


class Drawn(Choices):
    """As hypothesis draws."""

    def __init__(self, draw: Any) -> None:
        self._draw = draw

    def whole(self, low: int, high: int) -> int:
        """The lower, the simpler."""
        return int(self._draw(st.integers(low, high)))

    def text(self, most: int) -> str:
        """The shorter, the simpler."""
        return str(self._draw(st.text(max_size=most)))

    def some(self, most: int) -> bytes:
        """The shorter, the simpler."""
        return bytes(self._draw(st.binary(max_size=most)))

    def cell(self) -> str:
        """A number or word of the lists is simpler than another."""
        return str(self._draw(CELLS))


class Seeded(Choices):
    """As chance has it: the same file for the same seed."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance

    def whole(self, low: int, high: int) -> int:
        """All alike."""
        return low + int(self._chance.random() * (high - low + 1))

    def text(self, most: int) -> str:
        """Of all lengths, mostly of letters on a keyboard."""
        return "".join(chr(self.whole(*self.one(LETTERS))) for _ in range(self.whole(0, most)))

    def some(self, most: int) -> bytes:
        """Of all lengths."""
        return self._chance.randbytes(self.whole(0, most))

    def cell(self) -> str:
        """A third of the lists, the others any number or text."""
        kind = self.whole(0, 5)
        if kind < 2:
            return self.one(NUMBERS + WORDS)
        if kind == 2:
            return repr(struct.unpack("d", self._chance.randbytes(8))[0])
        if kind == 3:
            return repr(self.whole(-9, 9) * 10.0 ** self.whole(-12, 12))
        return str(self.whole(-99, 99) << self.whole(0, 80)) if kind == 4 else self.text(5)
