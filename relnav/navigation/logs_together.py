"""Logs of RUNS runs filtered together: each to the bit as when it is filtered alone.

What is an epoch of one run elsewhere is one of RUNS runs here, at one instruction for all of them (`codegen/lanes.py`).
Where a few do not go the way of the others (one starts later, or leaves an image out) they are stepped alone. Their
lanes then go along with another one's numbers, so that the rest can still be done together.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.codegen.kernel import is_at_hand, kernel, long_entry
from relnav.codegen.together import RUNS, attempt, lanes_of, new_lanes
from relnav.dynamics.error_state import MOTION, factor_size
from relnav.mission import Model
from relnav.navigation.arguments import choose
from relnav.navigation.log import Epochs, Rows, run_rows
from relnav.navigation.memory import lasting_part, starts_at, step_parts, views

EVERY = (1 << RUNS) - 1
"""All lanes, as bits."""
SELDOM, CALM = 10, 3
"""What epochs leave to the next is kept every so many of them, to go back to where runs do not go the same way; every
one right after such an epoch, and one fewer for every so many without."""


SPIKE = 0.03
"""Of the detector's size: a spot that is so far from where it is before and after is a glint, most likely. This only
saves time: whether it is one is for the filter to say."""


class Together(NamedTuple):
    """Memories of RUNS filters, what they are told and what they say.

    block (size, RUNS): the memories side by side; kept (last - first, RUNS): what an epoch left to the next, `first` to
    `last` of block, some epochs ago; alone (RUNS, size): memories to step one of them in; step_first to step_last, and
    on to step_whole what depends on its length alone: where the prepared step stands; rows (n, ..., RUNS): of all; own
    (RUNS, ...): of those that are stepped alone; apart: whether those that do not see a spot had better be; spike2:
    how far a spot jumps, squared, whose run had better be.
    """

    block: Matrix
    kept: Matrix
    alone: Matrix
    first: int
    last: int
    step_first: int
    step_last: int
    step_whole: int
    rows: Rows
    own: Rows
    apart: bool
    spike2: float


@kernel
def _try(w: Together, e: int) -> int:
    """An epoch of all lanes; 0, or how they divided (`attempt`)."""
    rows = w.rows
    told = lanes_of(rows.quaternion), lanes_of(rows.sigma), lanes_of(rows.lasting)
    said = lanes_of(rows.state), lanes_of(rows.factor), lanes_of(rows.innovation)
    of_lanes = Rows(
        rows.t,
        lanes_of(rows.spots),
        lanes_of(rows.control),
        told[0],
        told[1],
        told[2],
        said[0],
        said[1],
        said[2],
        lanes_of(rows.nis),
        lanes_of(rows.codes),
        lanes_of(rows.considered),
    )
    divided, _ = attempt(run_rows, lanes_of(w.block), e, e + 1, of_lanes)
    return divided


@kernel
def _keep(w: Together) -> None:
    """Keep what the last epoch left."""
    now, kept = lanes_of(w.block), lanes_of(w.kept)
    for k in range(kept.shape[0]):
        kept[k] = now[w.first + k]


@kernel
def _go_back(w: Together) -> None:
    """Go back to what was kept."""
    now, kept = lanes_of(w.block), lanes_of(w.kept)
    for k in range(kept.shape[0]):
        now[w.first + k] = kept[k]


@kernel
def _is_odd(spots: Stack, e: int, spike2: float, apart: bool) -> bool:
    """Whether a spot of an image (n, 2), of spots (epochs, n, 2), is elsewhere than before and after, or `apart`."""
    before, after, odd = max(e - 1, 0), min(e + 1, spots.shape[0] - 1), False
    for i in range(spots.shape[1]):
        for k in range(2):
            x = spots[e, i, k]
            odd = odd | (apart & (x != x)) | ((x - spots[before, i, k]) * (x - spots[after, i, k]) > spike2)
    return bool(odd)


@kernel
def _odd_ones(w: Together, e: int) -> int:
    """The lanes, as bits, of which an image is odd; 0 where that is so of all."""
    divided, _ = attempt(_is_odd, lanes_of(w.rows.spots), e, w.spike2, w.apart)
    return divided


@kernel
def _count(bits: int) -> int:
    """How many lanes there are in bits."""
    count = 0
    for lane in range(RUNS):
        count += (bits >> lane) & 1
    return count


@kernel
def _smaller_part(divided: int, left: int) -> int:
    """Of the lanes left, as bits, those that go another way than most of them."""
    held, others = divided & left, left & ~divided
    return held if _count(held) <= _count(others) else others


@kernel
def _take_out(w: Together, e: int, lane: int, guide: int) -> None:
    """Copy a run's memory and inputs to where it is stepped alone; its lane goes along with another one's instead."""
    rows, own, one, block = w.rows, w.own, w.alone[lane], w.block
    same_step = one[w.step_first] == block[w.step_first, lane]  # then what depends on its length alone is there
    for k in range(w.step_first, w.step_last if same_step else w.step_whole):
        one[k] = block[k, lane]
        block[k, lane] = block[k, guide]
    for k in range(w.first, w.last):
        one[k] = block[k, lane]
        block[k, lane] = block[k, guide]
    own.t[lane] = rows.t[e]
    for i in range(own.control.shape[1]):
        own.control[lane, i] = rows.control[e, i, lane]
        rows.control[e, i, lane] = rows.control[e, i, guide]
    for i in range(own.spots.shape[1]):
        for k in range(2):
            own.spots[lane, i, k] = rows.spots[e, i, k, lane]
            rows.spots[e, i, k, lane] = rows.spots[e, i, k, guide]
            if own.sigma.shape[0] > 0:
                own.sigma[lane, i, k] = rows.sigma[e, i, k, lane]
                rows.sigma[e, i, k, lane] = rows.sigma[e, i, k, guide]
        if own.lasting.shape[0] > 0:
            own.lasting[lane, i] = rows.lasting[e, i, lane]
            rows.lasting[e, i, lane] = rows.lasting[e, i, guide]


@kernel
def _put_back(w: Together, e: int, lane: int) -> None:
    """Put a run that was stepped alone back into its lane: its inputs, its memory, and what it says."""
    rows, own, one = w.rows, w.own, w.alone[lane]
    for k in range(w.first, w.last):
        w.block[k, lane] = one[k]
    for k in range(w.step_first, w.step_last):
        w.block[k, lane] = one[k]
    for i in range(own.control.shape[1]):
        rows.control[e, i, lane] = own.control[lane, i]
    for i in range(own.spots.shape[1]):
        for k in range(2):
            rows.spots[e, i, k, lane] = own.spots[lane, i, k]
            if own.sigma.shape[0] > 0:
                rows.sigma[e, i, k, lane] = own.sigma[lane, i, k]
        if own.lasting.shape[0] > 0:
            rows.lasting[e, i, lane] = own.lasting[lane, i]
    for i in range(own.state.shape[1]):
        rows.state[e, i, lane] = own.state[lane, i]
    for i in range(own.factor.shape[1]):
        rows.factor[e, i, lane] = own.factor[lane, i]
    for i in range(own.innovation.shape[1]):
        rows.innovation[e, i, lane] = own.innovation[lane, i]
    for i in range(own.codes.shape[1]):
        rows.codes[e, i, lane] = own.codes[lane, i]
    rows.nis[e, lane] = own.nis[lane]


@kernel
def _try_without(w: Together, e: int, out: int) -> int:
    """Step an epoch, some runs alone (`out`, as bits) and the others together; 0, or how these divide."""
    guide = 0
    while (out >> guide) & 1:
        guide += 1
    for lane in range(RUNS):
        if (out >> lane) & 1:
            _take_out(w, e, lane, guide)
            run_rows(w.alone[lane], lane, lane + 1, w.own)
    divided = _try(w, e)
    for lane in range(RUNS):
        if (out >> lane) & 1:
            _put_back(w, e, lane)
    return divided


@kernel
def _step_each(w: Together, e: int) -> int:
    """Step an epoch, every run alone; returns the bits of all."""
    for lane in range(RUNS):
        _take_out(w, e, lane, lane)
        run_rows(w.alone[lane], lane, lane + 1, w.own)
        _put_back(w, e, lane)
    return EVERY


@kernel
def _step_divided(w: Together, e: int, divided: int) -> int:
    """Step an epoch at which the lanes divide, from what was kept right before it; returns the bits of those alone."""
    out = 0
    while divided != 0:
        odd = _smaller_part(divided, EVERY & ~out)
        out |= odd
        _go_back(w)
        if odd == 0 or _count(out) >= RUNS - 1:
            return _step_each(w, e)
        divided = _try_without(w, e, out)
    return out


@kernel
def _run_all(w: Together) -> int:
    """All epochs; returns how often a run was stepped alone."""
    m, alone, out = views(lanes_of(w.block)), 0, 0
    e, kept_at, failed, found = 0, -SELDOM, -1, 0  # found: how the lanes divided at the epoch that failed
    while e < w.rows.t.shape[0]:
        if e == failed or (e > failed and e - kept_at >= min(SELDOM, 1 + (e - failed) // CALM)):
            kept_at = e
            _keep(w)
        if e == failed:
            out = _step_divided(w, e, found)
            kept_at = e + 1 - SELDOM
        else:
            odd = _odd_ones(w, e)
            out = _smaller_part(odd, EVERY) if odd != 0 else 0
            divided = _try(w, e) if out == 0 else _try_without(w, e, out)
            if divided != 0:  # go back to where all is known, and come here again
                failed, found = e, divided if out == 0 else odd
                _go_back(w)
                m.step["dt"], e = np.nan, kept_at
                continue
        alone += _count(out)
        e += 1
    return alone


@long_entry
def _run_together(
    block: Matrix,
    kept: Matrix,
    alone: Matrix,
    first: int,
    step_first: int,
    step_last: int,
    step_whole: int,
    apart: int,
    spike: float,
    t: Vector,
    spots: Stack,
    control: Stack,
    quaternion: Matrix,
    sigma: Stack,
    lasting: Stack,
    state: Stack,
    factor: Stack,
    innovation: Stack,
    nis: Matrix,
    codes: Codes,
    considered: Stack,
    t_1: Vector,
    spots_1: Stack,
    control_1: Matrix,
    quaternion_1: Matrix,
    sigma_1: Stack,
    lasting_1: Matrix,
    state_1: Matrix,
    factor_1: Matrix,
    innovation_1: Matrix,
    nis_1: Vector,
    codes_1: Codes,
    considered_1: Stack,
) -> int:
    """`_run_all`, of arrays as Python hands them over; what ends in _1 is `own`."""
    rows = Rows(t, spots, control, quaternion, sigma, lasting, state, factor, innovation, nis, codes, considered)
    own = Rows(
        t_1, spots_1, control_1, quaternion_1, sigma_1, lasting_1,
        state_1, factor_1, innovation_1, nis_1, codes_1, considered_1,
    )  # fmt: skip
    last, odd = first + kept.shape[0], (apart > 0, spike * spike)
    return _run_all(
        Together(block, kept, alone, first, last, step_first, step_last, step_whole, rows, own, odd[0], odd[1])
    )


def is_together_at_hand() -> bool:
    """Whether logs can be filtered together without compiling first."""
    return is_at_hand(_run_together)


class LogsTogether:
    """A filter that is fed RUNS logs of as many epochs each, at the same times.

    Attributes
    ----------
    epochs : Epochs
        What it says: arrays (n, ..., RUNS).
    alone : int
        How often a run was stepped alone.
    """

    def __init__(self, model: Model, method: str, epochs: int, *, innovations: bool = True) -> None:
        """Make room for logs of so many epochs; innovations: whether they are kept."""
        n, beacons, self._model, self.alone = epochs, len(model.beacons_lvlh_m), model, 0
        self._fresh = choose(model, method, None, "compiled")
        first, last = lasting_part(self._fresh)
        apart = model.calibration is not None or model.attitude.mode != "lvlh_hold"
        spike = SPIKE * min(model.sensor.detector_size_m) if method == "fix" else math.inf
        self._part = first, *step_parts(), int(apart), spike
        self._block, self._kept = new_lanes(len(self._fresh)), new_lanes(last - first)
        self._memories = np.tile(self._fresh, (RUNS, 1))
        self._t, self._spots, self._control = np.empty(n), new_lanes(0, beacons, 2), new_lanes(n, MOTION)
        self._sigma, self._lasting = new_lanes(0, beacons, 2), new_lanes(0, beacons)
        codes, considered = new_lanes(n, 4, dtype=np.int64), new_lanes(n, 0, MOTION)
        numbers = new_lanes(n, MOTION), new_lanes(n, factor_size(MOTION))
        off = new_lanes(n, 2 * beacons if innovations else 0)
        self.epochs = Epochs(*numbers, off, new_lanes(n), codes, considered)

    def take(self, t_s: Vector, spots_m: Stack, acceleration_m_s2: Stack, sigma_m: Stack | None = None) -> None:
        """Take logs of `new_lanes`: (n,), (n, beacons, 2, RUNS), (n, 3, RUNS), and the spots' noise as these."""
        self._t, self._spots, self._control[:, :3] = t_s, spots_m, acceleration_m_s2
        if sigma_m is not None:
            self._sigma = sigma_m
        if self._model.calibration is not None:
            spots, lasting = self._model.calibration.corrected(np.moveaxis(spots_m, 2, -1))
            self._spots, self._lasting = new_lanes(*spots_m.shape[:-1]), new_lanes(*spots_m.shape[:2])
            self._spots[:], self._lasting[:] = np.moveaxis(spots, -1, 2), lasting

    def run(self) -> None:
        """Filter the logs that were taken."""
        self._block[:], self._memories[:] = self._fresh[:, None], self._fresh
        beacons = self._spots.shape[1]
        one = Epochs.empty(RUNS, self.epochs.innovation.shape[1] // 2)
        sigma, lasting = (np.empty((RUNS if len(told) else 0, beacons, 2)) for told in (self._sigma, self._lasting))
        memories = self._block, self._kept, self._memories, *self._part
        told = self._t, self._spots, self._control, new_lanes(0, 4), self._sigma, self._lasting
        told_one = np.empty(RUNS), np.empty((RUNS, beacons, 2)), np.empty((RUNS, MOTION)), np.empty((0, 4))
        arguments: list[Any] = [*memories, *told, *_arrays(self.epochs)]
        arguments += [*told_one, sigma, np.ascontiguousarray(lasting[..., 0]), *_arrays(one)]
        self.alone = _run_together(*arguments)

    @property
    def restarts(self) -> list[int]:
        """How often a confirmed start has replaced a track, of each run."""
        return [max(0, starts - 1) for starts in self._block[starts_at()].view(np.int64).tolist()]


def _arrays(of: Epochs) -> Any:
    return of.state, of.factor, of.innovation, of.nis, of.codes, of.considered
