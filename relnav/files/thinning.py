"""A long record made short enough to look at: extremes and sums of neighbouring epochs, gathered as they pass.

No peak is lost: of the epochs that become one, the least and the greatest value of every column are kept, in the order
in which they came.
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Flags, Matrix, Vector

ENVELOPE_CUT = 0.03
"""Share of epochs whose envelope may reach beyond its axis: of a start it would flatten all that follows."""


@dataclass(frozen=True)
class Thin:
    """What is left of n epochs in b groups, in the order of time.

    Attributes
    ----------
    begin, end : (b,)
        First and last time of each group.
    low, high : (k, b)
        Least and greatest value of each column in each group; NaN where it has none.
    rising : (k, b)
        Whether the least came first.
    sums : (j, b)
        Sums of other columns over each group; NaN counts as nothing.
    epochs : int
        n.
    """

    begin: Vector
    end: Vector
    low: Matrix
    high: Matrix
    rising: Flags
    sums: Matrix
    epochs: int

    @property
    def whole(self) -> bool:
        """Whether every epoch is still there."""
        return len(self.begin) == self.epochs

    def times(self) -> Vector:
        """Times of `line`: two a group, or one where nothing was joined."""
        if self.whole:
            return self.begin
        step = 0.25 * (self.end - self.begin)
        return np.stack([self.begin + step, self.end - step], axis=1).ravel()

    def line(self, column: int) -> Vector:
        """Values of a column to draw over `times`: both extremes of each group, in their order."""
        if self.whole:
            alone: Vector = self.low[column]
            return alone
        first = np.where(self.rising[column], self.low[column], self.high[column])
        second = np.where(self.rising[column], self.high[column], self.low[column])
        return np.stack([first, second], axis=1).ravel()

    def largest(self, column: int) -> Vector:
        """The greatest value of each group, over `times`."""
        greatest: Vector = self.high[column]
        return greatest if self.whole else np.repeat(greatest, 2)


class Thinning:
    """Epochs go in part after part; no more than 2 `most` groups are ever kept."""

    def __init__(self, most: int) -> None:
        self._most, self._size, self._epochs, self._groups = most, 1, 0, 0
        self._parts: list[tuple[Vector, Vector, Matrix, Matrix, Flags, Matrix]] = []
        self._rest: tuple[Vector, Matrix, Matrix] | None = None

    def take(self, t: Vector, columns: Matrix, summed: Matrix) -> None:
        """Go on with the next epochs: times (n,), columns (k, n) and columns to be summed (j, n)."""
        self._epochs += len(t)
        for begin in range(0, len(t), self._most):
            cut = slice(begin, begin + self._most)
            piece = t[cut], columns[:, cut], summed[:, cut]
            if self._rest is not None:
                piece = (
                    np.concatenate([self._rest[0], piece[0]]),
                    np.concatenate([self._rest[1], piece[1]], axis=1),
                    np.concatenate([self._rest[2], piece[2]], axis=1),
                )
            self._group(*piece)

    def _group(self, t: Vector, columns: Matrix, summed: Matrix) -> None:
        whole = len(t) - len(t) % self._size
        self._rest = t[whole:], columns[:, whole:], summed[:, whole:]
        if whole:
            self._parts.append(_grouped(t[:whole], columns[:, :whole], summed[:, :whole], self._size))
            self._groups += whole // self._size
        while self._groups >= 2 * self._most:
            self._join()

    def _join(self) -> None:
        """Make one of every two groups; an odd last one stays as it is."""
        begin, end, low, high, rising, sums = self._all()
        odd = [] if len(begin) % 2 == 0 else [(begin[-1:], end[-1:], low[:, -1:], high[:, -1:], rising[:, -1:])]
        n = len(begin) // 2 * 2
        a, b = slice(0, n, 2), slice(1, n, 2)
        low_in_a, high_in_a = ~(low[:, a] > low[:, b]), ~(high[:, a] < high[:, b])
        low_in_a &= ~(np.isnan(low[:, a]) & ~np.isnan(low[:, b]))
        high_in_a &= ~(np.isnan(high[:, a]) & ~np.isnan(high[:, b]))
        within = np.where(low_in_a, rising[:, a], rising[:, b])
        joined = [
            begin[a],
            end[b],
            np.fmin(low[:, a], low[:, b]),
            np.fmax(high[:, a], high[:, b]),
            np.where(low_in_a == high_in_a, within, low_in_a),
        ]
        for last in odd:
            joined = [np.concatenate([x, y], axis=-1) for x, y in zip(joined, last, strict=True)]
        summed = sums[:, a] + sums[:, b]
        summed = np.concatenate([summed, sums[:, n:]], axis=1)
        self._parts = [(joined[0], joined[1], joined[2], joined[3], joined[4], summed)]
        self._groups, self._size = len(joined[0]), 2 * self._size

    def _all(self) -> tuple[Vector, Vector, Matrix, Matrix, Flags, Matrix]:
        begin, end, low, high, rising, sums = (np.concatenate(x, axis=-1) for x in zip(*self._parts, strict=True))
        return begin, end, low, high, rising, sums

    def thin(self) -> Thin:
        """What has passed so far; at least one epoch."""
        parts = self._parts
        if self._rest is not None and len(self._rest[0]):
            self._parts = [*parts, _grouped(*self._rest, len(self._rest[0]))]
        out = Thin(*self._all(), self._epochs)
        self._parts = parts
        return out


def _grouped(
    t: Vector, columns: Matrix, summed: Matrix, size: int
) -> tuple[Vector, Vector, Matrix, Matrix, Flags, Matrix]:
    """Groups of so many epochs: begin, end, low, high, rising, sums."""
    groups = columns.reshape(len(columns), -1, size)
    unseen = np.isnan(groups)
    first_low = np.where(unseen, np.inf, groups).argmin(axis=2)
    first_high = np.where(unseen, -np.inf, groups).argmax(axis=2)
    sums = np.nan_to_num(summed).reshape(len(summed), groups.shape[1], size).sum(axis=2)
    low, high = np.fmin.reduce(groups, axis=2), np.fmax.reduce(groups, axis=2)
    return t[::size].copy(), t[size - 1 :: size].copy(), low, high, first_low <= first_high, sums


def envelope_limits(values: Vector, around: Vector, share: float) -> tuple[float, float]:
    """Limits of an axis: all values, and what lies around nearly all of them, but for how a filter starts."""
    known = np.isfinite(values)
    if not known.any():
        return -1.0, 1.0
    values, around = values[known], np.where(np.isfinite(around[known]), around[known], 0.0)
    low = min(float(values.min()), float(np.quantile(values - around, ENVELOPE_CUT)))
    high = max(float(values.max()), float(np.quantile(values + around, 1.0 - ENVELOPE_CUT)))
    room = share * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room
