"""Gyro samples in the order of their times, whatever the order in which they came, and which of them hold when."""

import math
from collections.abc import Sequence

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import entry, kernel, plain

Sample = tuple[float, float, float, float]
"""From when on it holds, s, and the rate about the chaser's axes, rad/s."""

ROOM = 1024
"""Samples before the first that are too old are forgotten."""
TREND = 8
"""Samples before the last one over which a change of the rate is looked for.

Their noise then adds less than a hundredth (2 / 8^2 / 4) to the variance of a sample.
"""
SURE = 14.0
"""By how much, over the square root of their number, the mean square of changes has to be more than noise makes it.

Relative to what noise does. With one change noise exceeds it once in ten thousand times, with eight more seldom.
"""
FASTEST_RAD_S = 1e3
"""More is a mistake."""


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


@entry
def append_into(samples: Matrix, count: int, t: float, rate: Vector) -> bool:
    """Write a sample, t s and rate (3,), behind the first `count` of samples (n, 4).

    False, and nothing of use written, unless it is later, no faster than FASTEST_RAD_S, and there is room.
    """
    if count == len(samples) or not t > samples[count - 1, 0]:
        return False
    samples[count, 0] = t
    for i in range(3):
        samples[count, 1 + i] = rate[i]
        if not abs(rate[i]) <= FASTEST_RAD_S:
            return False
    return True


class GyroSamples:
    """The samples of the last seconds, in order of time and content.

    Attributes
    ----------
    array, count : (n, 4), int
        t s and rate (3,) rad/s; the first `count` rows are samples, the first of them from -inf on until it is
        forgotten: the rate before any came.
    """

    def __init__(self, rate_before_any: Vector) -> None:
        self.array, self.count = np.empty((ROOM, 4)), 1
        self.array[0] = -math.inf, *rate_before_any

    @property
    def is_full(self) -> bool:
        """Whether room has to be made before another sample."""
        return self.count == len(self.array)

    def append(self, t_s: float, rate: Vector) -> bool:
        """Take a sample in that is later than all others, at a fraction of what `insert` takes.

        False, and nothing done, if it is not, if it is none, if there is no room, or if it is no array in one piece.
        """
        flags = rate.flags
        if rate.shape != (3,) or not (flags.c_contiguous and flags.aligned):
            return False
        taken = append_into(self.array, self.count, t_s, rate)
        self.count += taken
        return taken

    def insert(self, sample: Sample) -> int:
        """Take a sample in where it belongs; how many come after it, -1 and nothing done if it is here already."""
        count, t_s = self.count, sample[0]
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
        self.array = np.concatenate([self.array[:1], np.reshape(np.array(samples, dtype=np.float64), (-1, 4))])
        self.count = len(self.array)

    def remove(self, sample: Sample) -> None:
        """Undo an insertion."""
        at, count = self.array[: self.count].tolist().index(list(sample)), self.count
        self.array[at : count - 1] = self.array[at + 1 : count]
        self.count -= 1

    def make_room(self, before_s: float) -> None:
        """Forget samples of which nothing is asked from before_s on; where that is not half of them, take more room."""
        first = max(0, self._holding_at(before_s) - TREND)
        left, room = self.array[first : self.count], len(self.array)
        array = np.empty((room if 2 * len(left) <= room else 2 * room, 4))
        array[: len(left)] = left
        self.array, self.count = array, len(left)

    def rate_at(self, t_s: float) -> Vector:
        """Rate (3,) of the sample that holds at t_s."""
        rate: Vector = self.array[self._holding_at(t_s), 1:].copy()
        return rate

    def held_at(self, t_s: float) -> float:
        """Time of the sample that holds at t_s; -inf if none came before."""
        return float(self.array[self._holding_at(t_s), 0])

    def trend_at(self, t_s: float) -> Vector:
        """How far (3,) the rate at t_s is from the mean of its sample, rad/s, if it changes as over `TREND` samples.

        The mean is that of the middle of the sample's period. Zero for the first samples.
        """
        at = self._holding_at(t_s)
        if at < TREND or not self.array[at - TREND, 0] > -math.inf:
            return np.zeros(3)
        first, last = self.array[at - TREND], self.array[at]
        period_s = (last[0] - first[0]) / TREND
        if not period_s > 0.0:
            return np.zeros(3)
        trend: Vector = (last[1:] - first[1:]) / TREND * ((t_s - last[0]) / period_s - 0.5)
        return trend

    def unsteady_at(self, t_s: float, period_s: float, sigma_rad_s: float) -> Vector:
        """How far (3,) the rate at t_s may be off its sample, rad/s, 1-sigma, if it changes as in the last periods.

        Two means of a rate with the slope s differ by d = s T, and by noise: E d^2 = s^2 T^2 + 2 sigma^2. At u within a
        period the rate is off its mean by s (u - T/2): the variance is (u/T - 1/2)^2 (E d^2 - 2 sigma^2). E d^2 is the
        mean over the last `TREND` changes, as an even trend is zero where a rate turns back, or the last of them where
        that is more, as a slope grows from there on. Zero where noise does as much (`SURE`), and before two samples.

        Parameters
        ----------
        t_s, period_s : float
            When, and the gyro's period: changes over a gap do not count.
        sigma_rad_s : float
            Of a sample's noise.
        """
        at = self._holding_at(t_s)
        steps: Matrix = np.diff(self.array[max(0, at - TREND) : at + 1], axis=0)
        squares, noise = steps[np.abs(steps[:, 0] - period_s) < 0.5 * period_s, 1:] ** 2, 2.0 * sigma_rad_s**2
        variance = np.zeros(3)
        for last in (squares, squares[-1:]):
            if len(last):
                more = np.mean(last, axis=0) - noise
                variance = np.where(more > noise * SURE / len(last) ** 0.5, np.maximum(variance, more), variance)
        return np.abs((t_s - self.array[at, 0]) / period_s - 0.5) * np.sqrt(variance) if len(squares) else variance

    def silent_before(self, t_s: float) -> float:
        """How long before the sample that holds at t_s the one before it was taken; 0 if it is the first."""
        at = self._holding_at(t_s)
        while at > 0 and self.array[at - 1, 0] == t_s:
            at -= 1
        return t_s - float(self.array[at - 1, 0]) if at > 0 and self.array[at - 1, 0] > -math.inf else 0.0

    def _holding_at(self, t_s: float) -> int:
        return plain(holding_at)(self.array, self.count, t_s)
