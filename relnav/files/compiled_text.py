"""Tables of numbers to text and back by compiled code (`relnav.decimals`), where there are many of them.

The text is what Python's `repr` writes and the numbers are what its `float` reads. A short table is left to Python,
unless the code is at hand: compiling takes some seconds.
"""

from collections.abc import Iterator
from functools import cache

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import is_at_hand, is_compiled
from relnav.decimals import LONGEST_NUMBER, groups_of_digits, powers_of_ten, read_rows, write_rows
from relnav.files import text_table
from relnav.files.text_table import TextTable

MANY_NUMBERS = 150_000
"""In one piece of a table: there are more pieces then, and Python's own way takes seconds, as compiling does, once."""
CHARACTERS_EACH = 10
ROWS_AT_ONCE = 250
"""Written together: numbers and text of a track stay in the processor's second cache."""
MOST_ASKED = 1_000
"""Numbers of a block that Python may be asked for: with more it reads them all."""


def worth_writing(numbers: int) -> bool:
    """Whether compiled code writes a piece of so many numbers."""
    return is_at_hand(write_rows) or (numbers >= MANY_NUMBERS and is_compiled())


def worth_reading(numbers: int) -> bool:
    """Whether it reads one."""
    return is_at_hand(read_rows) or (numbers >= MANY_NUMBERS and is_compiled())


def prepare() -> None:
    """Have the code that writes and reads rows at hand, compiled now if need be: for what is followed row by row."""
    if is_at_hand(write_rows, read_rows) or not is_compiled():  # asked in this order: the second imports numba
        return
    for _ in texts_of([np.zeros(1)], ()):
        pass
    text, cells, state = np.frombuffer(b"0.0\n", dtype=np.uint8), np.zeros(1, dtype=np.int64), np.array([0, 1, 0, 0, 0])
    values, lines, ask = np.empty((1, 1)), np.empty(1, dtype=np.int64), np.empty((MOST_ASKED, 4), dtype=np.int64)
    read_rows(text, cells, _powers(), values, lines, ask, state)


def texts_of(columns: list[Vector] | Matrix, integers: tuple[int, ...]) -> Iterator[memoryview]:
    """The rows of a table as lines of text, some hundred at once; columns of equal length, some of integers.

    What is given is ASCII, in memory that the next piece is written into.
    """
    rows, whole = len(columns[0]), _whole(len(columns), integers)
    room = ROWS_AT_ONCE if rows > 1 else 1  # one row: what is followed; what many need would be mapped anew for each
    out = np.empty(room * len(columns) * LONGEST_NUMBER, dtype=np.uint8)
    state, powers, groups = np.empty(3, dtype=np.int64), _powers(), groups_of_digits()
    for begin in range(0, rows, ROWS_AT_ONCE):
        cut = columns if rows <= ROWS_AT_ONCE else [column[begin : begin + ROWS_AT_ONCE] for column in columns]
        if isinstance(cut, list):
            cut = np.concatenate(cut, dtype=np.float64).reshape(len(columns), -1)
        table = np.ascontiguousarray(cut.T)
        state[:] = 0
        while not write_rows(table, whole, powers, groups, out, state):
            row, column, place = state.tolist()
            number = float(table[row, column])
            said = (str(int(number)) if whole[column] else repr(number)).encode()
            out[place : place + len(said)] = np.frombuffer(said, dtype=np.uint8)
            state[1:] = column + 1, place + len(said)
        yield out[: state[2]].data


@cache
def _whole(columns: int, integers: tuple[int, ...]) -> Codes:
    """1 for a column of integers."""
    return np.array([int(k in integers) for k in range(columns)], dtype=np.int64)


@cache
def _powers() -> Matrix:
    return powers_of_ten()


class BlockReader:
    """Reads the blocks of a text table."""

    def __init__(self, table: TextTable, cells: list[int]) -> None:
        """cells: which of a row are wanted, in the order of the columns."""
        self._table, self._cells = table, cells
        self._column = np.full(len(table.names), -1, dtype=np.int64)
        self._column[cells] = np.arange(len(cells))
        self._ask, self._state = np.empty((MOST_ASKED, 4), dtype=np.int64), np.empty(5, dtype=np.int64)

    def read(self, block: bytes, place: int, line: int, most_rows: int) -> tuple[Matrix, Vector, int, int] | None:
        """Values (n, columns) of rows of a block from `place`, in line number `line`, on, up to `most_rows`.

        Returns
        -------
        Values, the rows' line numbers (n,), and place and line number to go on with; None where Python has to read it.

        Raises
        ------
        LogError
            For a cell that is no number.
        """
        if not worth_reading(len(block) // CHARACTERS_EACH):
            return None
        table, state = self._table, self._state
        rows = min(most_rows, block.count(b"\n", place))
        values, lines = np.empty((rows, len(self._cells))), np.empty(rows, dtype=np.int64)
        state[:3] = place, line, table.last_row
        text = np.frombuffer(block, dtype=np.uint8)
        if not read_rows(text, self._column, _powers(), values, lines, self._ask, state):
            return None
        place, line, last, count, asked = state.tolist()
        values, lines = values[:count], lines[:count]
        most = text_table.MOST_EMPTY_LINES
        if line - table.last_row > most and np.diff(lines, prepend=table.last_row, append=line).max() > most:
            return None
        for row, column, begin, end in self._ask[:asked].tolist():
            cell, name = block[begin:end].decode("ascii"), table.names[self._cells[column]]
            values[row, column] = table.number(cell, int(lines[row]), name)
        table.last_row = last
        return values, lines.astype(np.float64), place, line
