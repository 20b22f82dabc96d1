"""A vehicle's flight smoothed: every estimate rests on all observations, those before and those after it.

Rauch, Tung and Striebel (1965, Maximum likelihood estimates of linear dynamic systems), from the end backward over each
step from t_k to t_k+1, in which errors move by F and take the noise Q:

    P- = F P F^T + Q,   G = P F^T (P-)^-1,   x_s = x + G (x_s+ - x-),
    P_s = (I - G F) P (I - G F)^T + G Q G^T + G P_s+ G^T

The first two parts of P_s are the covariance of what the next prediction does not tell of x. Its error is independent
of that of every later estimate, whatever gains the filter had, because these are made of the prediction and of later
noise alone: so P_s is as honest as P where errors are only considered too. What lasts a run does not move: its rows of
G are those of the identity, so that a considered error stays what it is, and an estimated one is that of the end.

After a lock-out the filter knows nothing of what it knew before: the parts are smoothed apart, and what it says during
the search is left as it is. So they are where the attitude jumped (`attitude_jump`): a wrong gyro sample is no noise.

Estimates of all steps would be 50 kB each. So the filter is kept at every CHUNK events, and flown again from there when
the way back comes to it.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, number, numbers
from relnav.codegen.kernel import entry, kernel
from relnav.geometry.linear_algebra import cholesky, solve_lower, solve_lower_transposed
from relnav.spacecraft import GYRO, Vehicle
from relnav.vehicle.alarms import AlarmMemory
from relnav.vehicle.arguments import refuse_covariance, three
from relnav.vehicle.drifts import Drifts
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.filters import VehicleFilters
from relnav.vehicle.flying_sensor import FlyingSensor
from relnav.vehicle.gyro import Sample
from relnav.vehicle.hand_over import Told
from relnav.vehicle.health import Fare
from relnav.vehicle.layout import MOVING
from relnav.vehicle.motion import Step
from relnav.vehicle.replay import Event, check_gap
from relnav.vehicle.state import Estimates
from relnav.vehicle.tracked import Tracked

CHUNK = 256
"""Events between two kept states: 12 MB of steps while the way back goes through them."""
LEAST_PIVOTS = (0.0, 1e-13, 1e-11, 1e-9)
"""Share of its variances that a covariance gets on top, until it is positive definite in double precision."""


class _Told(NamedTuple):
    """A time that was asked for: what the filter said of sensors, restarts and alarms.

    And all it said during a search, or while a jump was a hypothesis.
    """

    t_s: float
    fares: Mapping[str, Fare]
    drifts: Drifts
    restarts: int
    searching: VehicleEstimate | None
    alarms: AlarmMemory


class _Piece(NamedTuple):
    """Items in a row, from `begin` on: the filter before them, and at the end if what follows is no part of it."""

    begin: int
    end: int
    before: Tracked
    last: Estimates | None


class VehicleSmoother:
    """What `VehicleNavigator` takes, kept until the end, and then smoothed.

    Memory: 1 kB an observation, 50 kB every 256 of them, 12 MB, and what a caller keeps of the estimates (50 kB each).

    Attributes
    ----------
    vehicle : Vehicle
        What flies.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        t_s: float = 0.0,
        position_m: ArrayLike | None = None,
        velocity_m_s: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        dcm_lvlh_from_target: ArrayLike | None = None,
        target_rate_rad_s: ArrayLike | None = None,
        dcm_inertial_from_chaser: ArrayLike | None = None,
        sensors: Mapping[str, FlyingSensor] | None = None,
        monitor: bool = True,
    ) -> None:
        """Begin; arguments and errors as of `VehicleNavigator`."""
        self.vehicle = vehicle
        told: Told = {
            "position_m": position_m,
            "velocity_m_s": velocity_m_s,
            "covariance": covariance,
            "dcm_lvlh_from_target": dcm_lvlh_from_target,
            "target_rate_rad_s": target_rate_rad_s,
            "dcm_inertial_from_chaser": dcm_inertial_from_chaser,
        }
        start = vehicle, t_s, told, sensors
        self._alone = VehicleFilters(*start, monitor=False)
        self._watched = VehicleFilters(*start, monitor=True) if monitor else self._alone
        self._events: list[Event] = []
        self._samples: set[Sample] = set()
        self._newest_s = self._alone.start.estimates.t_s

    def observe(self, sensor: str, t_s: float, value: Any, covariance: ArrayLike | None = None) -> None:
        """Keep an observation, in any order; one from before the start is not used. As `VehicleNavigator.observe`.

        Raises
        ------
        ValueError
            For another name, shape or time.
        """
        time = number("t_s", t_s)
        check_gap(sensor, time, self._newest_s)
        if sensor == GYRO:
            refuse_covariance(sensor, covariance)
            self._samples.add((time, *three(GYRO, value)))
        else:
            event = self._alone.event(sensor, time, value, covariance)
            if event is not None and time >= self._alone.start.estimates.t_s:
                self._events.append(event)
        self._newest_s = max(self._newest_s, time)

    def estimates(self, times_s: ArrayLike) -> list[VehicleEstimate]:
        """The smoothed estimates at these times, in their order, which is that of time.

        `sensors`, `drifts` and `gyro_lost` are what the filter said then; `final_before_s` is infinite.

        Raises
        ------
        ValueError
            For times that go back, or lie before the start or after the last observation; where the target's attitude
            is to be found (`relnav.vehicle.acquisition`), if it stays ambiguous.
        """
        times = numbers("times_s", times_s)
        begin, end = self._alone.start.estimates.t_s, self._newest_s
        if times.ndim != 1 or not (np.diff(times) >= 0.0).all() or not ((times >= begin) & (times <= end)).all():
            raise ValueError(
                f"times_s: times in order between the start ({begin:g} s) and the last observation ({end:g} s) are "
                f"expected; got shape {times.shape}"
                + (f" from {times.min():g} to {times.max():g} s" if times.size else "")
            )
        for filters in {id(f): f for f in (self._alone, self._watched)}.values():
            filters.samples.fill(sorted(self._samples))
        return list(self._backward(times.tolist()))[::-1]

    def _backward(self, times: Sequence[float]) -> Iterator[VehicleEstimate]:
        """The last one first."""
        ordered = self._in_order()
        start, events = self._watched.after_trial(self._watched.known_start(ordered), ordered)
        seen: list[tuple[float, Event | None]] = [(event.t_s, event) for event in events]
        items = sorted([*seen, *((t, None) for t in times)], key=lambda item: item[0])
        pieces, told = self._forward(items, start)
        later = self._alone.start.estimates
        for begin, end, before, last in reversed(pieces):
            while told and (searching := told[-1].searching) is not None:
                told.pop()
                yield searching
            later = later if last is None else last
            steps, marks = self._again(before, items[begin:end])
            for place in range(len(steps), -1, -1):
                while marks and marks[-1] == place:
                    marks.pop()
                    yield self._estimate(later, told.pop())
                if place:
                    later = step_back(steps[place - 1], later)

    def _in_order(self) -> list[Event]:
        """The events, none twice."""
        return [event for _, event in sorted({event.key: event for event in self._events}.items())]

    def _forward(
        self, items: Sequence[tuple[float, Event | None]], tracked: Tracked
    ) -> tuple[list[_Piece], list[_Told]]:
        """The flight in pieces of CHUNK items, none of a search, and what is told at times that were asked for."""
        filters, begin, before = self._watched, 0, tracked
        pieces, told, opened = list[_Piece](), list[_Told](), (0, 0, tracked)
        for k, (t_s, event) in enumerate(items):
            found = tracked
            if event is not None:
                tracked, _ = filters.apply(tracked, event)
            else:
                tracked = filters.settled(tracked, t_s)
                told.append(self._told(tracked, t_s))
            if found.jump is None and tracked.jump is not None:
                opened = k, len(told), found
            elif tracked.jumps > found.jumps:  # since it was opened the filter was wrong
                while pieces and pieces[-1].end > opened[0]:
                    begin, _, before, _ = pieces.pop()
                pieces.append(_Piece(begin, opened[0], _first(before), _first(opened[2]).estimates))
                begin, before = k + 1, tracked
            elif found.jump is not None and tracked.jump is None:
                told[opened[1] :] = [one._replace(searching=None) for one in told[opened[1] :]]
            if found.search is None and tracked.search is not None:  # what this event is a part of is no longer tracked
                pieces.append(_Piece(begin, k, _first(before), _first(found).estimates))
            elif tracked.search is None and (found.search is not None or k + 1 - begin == CHUNK):
                if found.search is None:
                    pieces.append(_Piece(begin, k + 1, _first(before), None))
                begin, before = k + 1, tracked
        if tracked.jump is not None:
            told[opened[1] :] = [one._replace(searching=None) for one in told[opened[1] :]]
        if tracked.search is None:
            pieces.append(_Piece(begin, len(items), _first(before), _first(tracked).estimates))
        return pieces, told

    def _told(self, tracked: Tracked, t_s: float) -> _Told:
        """What is said at a time that was asked for, if a jump is a hypothesis as if it were believed."""
        filters, at, said = self._watched, tracked, None
        if tracked.jump is not None:
            at = Tracked(tracked.jump.estimates, tracked.jump.fares, None, tracked.restarts, None, tracked.alarms)
        if tracked.search is not None or tracked.jump is not None:
            said = filters.estimate(at, t_s, math.inf)
        drifts = filters.drifts(tracked.estimates)
        return _Told(t_s, tracked.fares, drifts, tracked.restarts, said, tracked.alarms)

    def _again(self, tracked: Tracked, items: Sequence[tuple[float, Event | None]]) -> tuple[list[Step], list[int]]:
        """The steps of some items, flown again, and after how many of them each time that was asked for stands."""
        filters, marks = self._alone, list[int]()
        steps: list[Step] = []
        filters.motion.on_step, filters.follow_jumps = steps.append, False
        try:
            for t_s, event in items:
                if event is not None:
                    tracked, _ = filters.apply(tracked, event)
                else:
                    tracked = filters.settled(tracked, t_s)
                    marks.append(len(steps))
        finally:
            filters.motion.on_step, filters.follow_jumps = None, True
        return steps, marks

    def _estimate(self, at: Estimates, told: _Told) -> VehicleEstimate:
        tracked = Tracked(at, told.fares, restarts=told.restarts, alarms=told.alarms)
        return replace(self._alone.estimate(tracked, told.t_s, math.inf), drifts=told.drifts)


def _first(tracked: Tracked) -> Tracked:
    """The same of the first filter alone, which no hypothesis of a jump has touched."""
    return tracked._replace(estimates=tracked.estimates.alone(0), jump=None)


@entry
def smooth_into(
    P: Matrix, F: Matrix, Q: Matrix, later: Matrix, more: float, G: Matrix, rest: Matrix, work: Matrix, out: Matrix
) -> bool:
    """Write P_s (n, n) into out and the rows of G (m, n) of errors that move, from those after a step, P_s+ in later.

    P (n, n) whole; F (m, k), Q (m, m); rest (m, n) and work (max(n, 3 m), n) scratch; more: share of each variance of
    P- that is added to it. False, and nothing known, if P- is not positive definite.
    """
    moving, driving = F.shape
    n = P.shape[0]
    for i in range(moving):
        for c in range(n):
            total = 0.0
            for k in range(driving):
                total += F[i, k] * P[k, c]
            rest[i, c] = total  # F P
    for a in range(n):
        for c in range(a + 1):
            work[a, c] = P[a, c]
            if c < moving:
                work[a, c] = rest[c, a]
            if a < moving:
                work[a, c] = Q[a, c]
                for k in range(driving):
                    work[a, c] += rest[a, k] * F[c, k]
        work[a, a] = work[a, a] * (1.0 + more) if work[a, a] > 0.0 else 1.0  # what is zero for sure tells nothing
    if not cholesky(work[:n], 0.0, work[:n]):
        return False
    for i in range(moving):
        for c in range(n):
            G[i, c] = rest[c, i] if c < moving else P[i, c]
        solve_lower(work[:n], G[i])
        solve_lower_transposed(work[:n], G[i])
    for i in range(moving):
        for c in range(n):
            total = (1.0 if c == i else 0.0) - (G[i, c] if c >= moving else 0.0)
            if c < driving:
                for k in range(moving):
                    total -= G[i, k] * F[k, c]
            rest[i, c] = total  # I - G F
    _combine_into(P, Q, later, G, rest, work, out)
    return True


@kernel
def _combine_into(P: Matrix, Q: Matrix, later: Matrix, G: Matrix, rest: Matrix, work: Matrix, out: Matrix) -> None:
    """Write (I - G F) P (I - G F)^T + G Q G^T + G P_s+ G^T; rest is I - G F of errors that move."""
    moving, n = G.shape
    own, told, noise = work[:moving], work[moving : 2 * moving], work[2 * moving : 3 * moving, :moving]
    for i in range(moving):
        for c in range(n):
            own[i, c] = 0.0
            told[i, c] = 0.0
        for c in range(moving):
            noise[i, c] = 0.0
        for k in range(n):
            a, b = rest[i, k], G[i, k]
            for c in range(n):
                own[i, c] += a * P[k, c]
                told[i, c] += b * later[k, c]
        for k in range(moving):
            for c in range(moving):
                noise[i, c] += G[i, k] * Q[k, c]
    for a in range(n):
        for c in range(n):
            out[a, c] = later[a, c]
    for i in range(moving):
        for c in range(moving, n):
            out[i, c] = out[c, i] = told[i, c]
        for c in range(i + 1):
            total = 0.0
            for k in range(n):
                total += own[i, k] * rest[c, k] + told[i, k] * G[c, k]
            for k in range(moving):
                total += noise[i, k] * G[c, k]
            out[i, c] = out[c, i] = total


def step_back(step: Step, later: Estimates) -> Estimates:
    """Smoothed estimates of one filter before a step, from those after it."""
    before, n = step.before, later.values.shape[1]
    later = later._replace(pivot=before.pivot)
    P, P_later = before.of(0).covariance, later.referred(step.values, *step.attitudes).of(0).covariance
    G, rest, work, smoothed = np.empty((MOVING, n)), np.empty((MOVING, n)), np.empty((max(n, 3 * MOVING), n)), P.copy()
    for more in LEAST_PIVOTS:
        if smooth_into(P, step.F, step.Q, P_later, more, G, rest, work, smoothed):
            break
    else:
        raise ValueError("the filter's covariance is no longer positive definite: it cannot be smoothed")
    difference = later.correction_from(step.values, *step.attitudes)
    correction = np.concatenate([np.sum(G * difference, axis=1), difference[MOVING:]])
    return before._replace(covariance=smoothed[None]).corrected(correction[None])
