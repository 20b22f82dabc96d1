"""Gyro samples in the order of their times, whatever the order in which they came, and which of them hold when."""

import math
import struct
from collections.abc import Sequence

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import entry, kernel, plain

Sample = tuple[float, float, float, float]
"""From when on it holds, s, and the rate about the chaser's axes, rad/s."""

ROOM = 1024
"""Samples before the first that are too old are forgotten."""
ROW = struct.Struct("4d")


@kernel
def holding_at(samples: Matrix, count: int, t: float) -> int:
    """Which of the first `count` samples (n, 4) in order, t s and rate, is the last that is not later than t."""
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        if samples[middle, 0] <= t:
            low = middle
        else:
            high = middle
    return low


@entry
def lost_at(samples: Matrix, count: int, holds: float, t: float, end: float) -> float:
    """When a gyro that is not lost at t falls silent: no sample for `holds` s before `end`; infinite if it does not."""
    k = holding_at(samples, count, t)
    silent = max(samples[k, 0] + holds, t)
    while silent < end and k + 1 < count and samples[k + 1, 0] <= silent:
        k += 1
        silent = samples[k, 0] + holds
    return silent if silent < end else math.inf


@entry
def found_at(samples: Matrix, count: int, t: float) -> float:
    """When a gyro that was lost at t speaks again; infinite if it does not."""
    k = holding_at(samples, count, t) + 1
    return samples[k, 0] if k < count else math.inf


class GyroSamples:
    """The samples of the last seconds, in order of time and content.

    Attributes
    ----------
    array, count : (n, 4), int
        t s and rate (3,) rad/s; the first `count` rows are samples, the first of them from -inf on until it is
        forgotten: the rate before any came.
    room : int
        Samples that the array holds: more has to be made before another one.
    """

    def __init__(self, rate_before_any: Vector) -> None:
        self._hold(np.empty((ROOM, 4)), 1)
        self.array[0] = -math.inf, *rate_before_any
        self._last_s = -math.inf

    def _hold(self, array: Matrix, count: int) -> None:
        self.array, self.count, self.room, self._memory = array, count, len(array), array.data

    def insert(self, sample: Sample) -> int:
        """Take a sample in where it belongs; how many come after it, -1 and nothing done if it is here already."""
        count, t_s = self.count, sample[0]
        if t_s > self._last_s:
            ROW.pack_into(self._memory, ROW.size * count, *sample)  # a tenth of the time that numpy takes
            self.count, self._last_s = count + 1, t_s
            return 0
        at = int(np.searchsorted(self.array[:count, 0], t_s))
        while at < count and tuple(self.array[at]) < sample:
            at += 1
        if at < count and tuple(self.array[at]) == sample:
            return -1
        self.array[at + 1 : count + 1] = self.array[at:count]
        self.array[at] = sample
        self.count = count + 1
        return count - at

    def fill(self, samples: Sequence[Sample] | Matrix) -> None:
        """Take a whole flight's samples in, in order and none twice, instead of those that are there."""
        array = np.concatenate([self.array[:1], np.reshape(np.array(samples, dtype=np.float64), (-1, 4))])
        self._hold(array, len(array))
        self._last_s = math.inf

    def remove(self, sample: Sample) -> None:
        """Undo an insertion."""
        at, count = self.array[: self.count].tolist().index(list(sample)), self.count
        self.array[at : count - 1] = self.array[at + 1 : count]
        self.count -= 1
        self._last_s = float(self.array[self.count - 1, 0])

    def make_room(self, before_s: float) -> None:
        """Forget samples that no longer hold at before_s; where that is not half of them, take more room."""
        first = self._holding_at(before_s)
        left, room = self.array[first : self.count], self.room
        array = np.empty((room if 2 * len(left) <= room else 2 * room, 4))
        array[: len(left)] = left
        self._hold(array, len(left))

    def rate_at(self, t_s: float) -> Vector:
        """Rate (3,) of the sample that holds at t_s."""
        rate: Vector = self.array[self._holding_at(t_s), 1:].copy()
        return rate

    def silent_before(self, t_s: float) -> float:
        """How long before the sample that holds at t_s the one before it was taken; 0 if it is the first."""
        at = self._holding_at(t_s)
        while at > 0 and self.array[at - 1, 0] == t_s:
            at -= 1
        return t_s - float(self.array[at - 1, 0]) if at > 0 and self.array[at - 1, 0] > -math.inf else 0.0

    def _holding_at(self, t_s: float) -> int:
        return plain(holding_at)(self.array, self.count, t_s)
