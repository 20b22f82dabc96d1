"""The filters of a vehicle side by side, from one event to the next: sensors, motion, gate and update in one place.

What they hold is constant but for the gyro's samples: the same estimates, samples and event give the same bits. The
order of events is that of who asks (`navigator`, `smoother`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from math import degrees, inf, isfinite, isnan, nextafter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Codes, Matrix, number
from relnav.dynamics.error_state import MOTION
from relnav.spacecraft import FORESEEN_RAD, GYRO, POINTS, RESERVED, STAR, THRUST, Vehicle
from relnav.vehicle.acquisition import (
    CONTRADICTED,
    LOST_IMAGES,
    Hypothesis,
    Search,
    found_at_start,
    hypothesis_about,
    hypothesis_anew,
    locked_out,
    opened,
)
from relnav.vehicle.alarms import contradicting
from relnav.vehicle.arguments import refuse_covariance, three
from relnav.vehicle.attitude_jump import Jump, Verdict, jumped
from relnav.vehicle.directions import StarTracker, SunSensor
from relnav.vehicle.drift_sums import score_of
from relnav.vehicle.drifts import Drifts, watched_drifts
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.flying_sensor import Flown, FlyingSensor, check_sensors
from relnav.vehicle.gyro import GyroSamples
from relnav.vehicle.hand_over import Told, start_of
from relnav.vehicle.health import Fare
from relnav.vehicle.layout import TARGET_ATTITUDE, TARGET_RATE, layout_of, untold
from relnav.vehicle.monitor import Sums, all_estimated
from relnav.vehicle.motion import VehicleMotion
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.points import LEAST_LIGHTS, PointSensor
from relnav.vehicle.port import PortState, port_state
from relnav.vehicle.replay import Event
from relnav.vehicle.separation import hide
from relnav.vehicle.state import Estimates, start_state
from relnav.vehicle.tracked import Tracked
from relnav.vehicle.trial import FOLDS_RAD, Taken, Trial
from relnav.vehicle.trial import Verdict as Tried
from relnav.vehicle.update import Outcome, Updater

NOTHING: Matrix = np.zeros((0, 0))
NO_CODES: Codes = np.zeros(0, dtype=np.int64)
NOT_USED = Outcome(0.0, 0, 0, 0)
"""Of an image of which nothing is asked."""


class VehicleFilters:
    """The filter that is told, the one that watches it, and those without each sensor, gyro and thrust in turn.

    Attributes
    ----------
    vehicle, layout, frame, motion, samples
        What flies, the blocks of its errors, its orbit's frame, how estimates move, and the gyro's samples.
    sensors : dict
        By name, in the order of the file.
    places : dict
        Of every source of events among those of one time.
    start : Tracked
        At hand-over.
    on_outcome : callable or None
        Called with every (event, outcome).
    follow_jumps : bool
        Whether a jump of the attitude is a hypothesis (`attitude_jump`).
    """

    follow_jumps = True

    def __init__(
        self,
        vehicle: Vehicle,
        t_s: float,
        told: Told | None = None,
        sensors: Mapping[str, FlyingSensor] | None = None,
        *,
        monitor: bool = True,
        separation: bool = False,
    ) -> None:
        """Start them; arguments and errors as of `VehicleNavigator`, told: what is known at the start."""
        if not isinstance(vehicle, Vehicle):
            raise ValueError(
                f"a vehicle is expected, as relnav.load_model('rendezvous_demo') gives; got a {type(vehicle).__name__}"
            )
        more = {} if sensors is None else sensors
        check_sensors(more)
        for name in more:
            if name in vehicle.sensor or name in RESERVED:
                raise ValueError(f"sensors: the name '{name}' is taken in {vehicle.name}; call it something else")
        self.vehicle, self.frame = vehicle, OrbitFrame(vehicle.orbit)
        self._begin = start_of(vehicle, self.frame, number("t_s", t_s), {} if told is None else told)
        layout = layout_of(vehicle, {name: own.lasting for name, own in more.items()})
        self.layout = self._begin.told_in(layout)
        layouts = [self.layout, all_estimated(self.layout)] if monitor else [self.layout]
        if separation and self._begin.seeks_attitude:
            raise ValueError(
                "separation: the target's attitude has to be known at hand-over, so that no filter rests on a sensor "
                "that it does not take; hand_over.target_attitude_sigma, or that of covariance, is above "
                f"{degrees(FORESEEN_RAD):.3g} deg"
            )
        self._watched, names = len(layouts), [*RESERVED, *vehicle.sensor, *more] if separation else []
        self._without = {name: len(layouts) + k for k, name in enumerate(names)}
        layouts += [untold(self.layout, vehicle) if name == THRUST else self.layout for name in names]
        self._layouts = layouts
        self.sensors: dict[str, PointSensor | StarTracker | SunSensor | Flown]
        self.sensors = {name: self._sensor(name, len(layouts)) for name in vehicle.sensor}
        self.sensors |= {name: Flown(own, name, self.layout) for name, own in more.items()}
        self._directions = {name for name in vehicle.sensor if vehicle.kind(name) != POINTS}
        self._lights = [name for name in vehicle.sensor if vehicle.kind(name) == POINTS]
        rows = max(sensor.most_rows for sensor in self.sensors.values())
        held = self._begin.dcm_lvlh_from_chaser
        self.samples = GyroSamples(self.frame.held_rate(held, self._begin.t_s))
        lacking = self._without.get(GYRO, -1), self._without.get(THRUST, -1)
        drifts = watched_drifts(self.layout, self.sensors) if monitor else {}
        drives, watched = np.concatenate([NO_CODES, *drifts.values()]), 1 if monitor else -1
        self._drifts = {name: len(places) for name, places in drifts.items()}
        self.motion = VehicleMotion(vehicle, self.frame, held, len(layouts), *lacking, watched, drives)
        self._updater = Updater(layouts, vehicle.filter.gate_probability, rows, watched, len(drives))
        self.places = {name: k for k, name in enumerate([*RESERVED, *self.sensors])}
        start = start_state(self._begin, layouts, self.frame, len(drives))
        fares = dict.fromkeys(self.sensors, Fare(Sums(start.t_s)))
        search = Search(start) if self._begin.seeks_attitude else None
        self.start = Tracked(start, fares, search, trial=Trial(start) if search is None else None)
        self.on_outcome: Callable[[Event, Outcome], None] | None = None

    def _sensor(self, name: str, filters: int) -> PointSensor | StarTracker | SunSensor:
        kind = self.vehicle.kind(name)
        if kind == POINTS:
            return PointSensor(self.vehicle, name, self.layout, self.frame, filters)
        return (StarTracker if kind == STAR else SunSensor)(self.vehicle, name, self.layout, filters)

    def event(self, sensor: str, t_s: float, value: Any, covariance: ArrayLike | None) -> Event | None:
        """What was observed, of a sensor or the thrusters; None if nothing was seen.

        Raises
        ------
        ValueError
            For another name, shape or time.
        """
        if sensor not in self.places:
            raise ValueError(f"no sensor '{sensor}' in {self.vehicle.name}; there are {', '.join(self.places)}")
        if sensor in self.sensors:
            taken, noise = self.sensors[sensor].taken(value, covariance)
            if not any(map(isfinite, taken.tolist())):
                return None
        else:
            refuse_covariance(sensor, covariance)
            taken, noise = np.array(three(sensor, value)), NOTHING
        return Event(number("t_s", t_s), self.places[sensor], sensor, taken, noise)

    def apply(self, tracked: Tracked, event: Event) -> tuple[Tracked, Outcome | None]:
        """The estimates after an event; the outcome of one that the filter had to believe."""
        after, outcome = self.again(tracked, event)
        if outcome is not None and self.on_outcome is not None:
            self.on_outcome(event, outcome)
        return after, outcome

    def again(self, tracked: Tracked, event: Event) -> tuple[Tracked, Outcome | None]:
        """The same of an event of which the outcome was told."""
        after, outcome = self._after(tracked, event)
        memory = after.alarms
        if after.search is not None:  # what was raised until its end is over with it
            memory = memory._replace(holds_from_s=event.t_s)
        if memory.is_due(event.t_s):
            sensors = {name: fare.health for name, fare in after.fares.items()}
            memory = memory.noted(event.t_s, contradicting(self.drifts(after.estimates), sensors))
        return (after if memory is after.alarms else after._replace(alarms=memory)), outcome

    def _after(self, tracked: Tracked, event: Event) -> tuple[Tracked, Outcome | None]:
        source, fares, search, at, trial = event.source, tracked.fares, tracked.search, tracked.estimates, tracked.trial
        if search is None:
            at, outcomes = self._through(at, event)
            if trial is not None:
                trial, (at, outcomes) = self._tried(trial, event, (at, outcomes), tracked.estimates)
                if trial is not None and trial.refused >= CONTRADICTED and self._may_fold(trial.blind, event):
                    search, outcomes = self._searched(Search(trial.blind), event)
                    trial, at = None, search.estimates
        else:
            search, outcomes = self._searched(search, event)
            at = search.estimates
            if search.is_over:
                search = None
        after = tracked._replace(estimates=at, search=search, trial=trial)
        if source == THRUST or not outcomes:
            return self._beside(after, event, None), None
        misplaced = source in self._lights and outcomes[0] is not NOT_USED  # spots, and no light before the lens
        fares = {**fares, source: fares[source].after(event.t_s, outcomes[: self._watched], misplaced=misplaced)}
        after = self._followed(tracked, after._replace(fares=fares), event, outcomes[0])
        shown = after.search is None and source in self._lights
        if shown and self._is_locked_out(event, outcomes[0].groups, after.fares):
            if after.jump is not None and after.jump.is_likely:
                return self._jumped(after, after.jump, event.t_s), outcomes[0]
            search, anew = self._anew(at, event), tracked.restarts + 1
            lights = {name: Fare(Sums(event.t_s), *fares[name][1:]) for name in self._lights}
            after = Tracked(search.estimates, {**fares, **lights}, search, anew, alarms=tracked.alarms)
            return after._replace(jumps=tracked.jumps), outcomes[0]
        return after, outcomes[0]

    def _followed(self, tracked: Tracked, after: Tracked, event: Event, main: Outcome) -> Tracked:
        """The same with what an observation makes of a jump of the attitude, or of its own refusal."""
        t_s, patience_s = event.t_s, self.vehicle.filter.restart_after_s
        if tracked.jump is None:
            refused = event.source in self._directions and main.groups > 0 and main.used == 0
            begun = after.search is None and not after.is_tried and after.estimates.lost is None
            if not (refused and begun and self.follow_jumps and t_s >= after.settled_s):
                return after
            jump = jumped(tracked.estimates, tracked.fares, event.source, t_s, patience_s)
            return self._beside(after._replace(jump=jump), event, main)
        after = self._beside(after, event, main)
        verdict = Verdict.LEFT
        if after.jump is not None and not after.is_tried:
            verdict = after.jump.verdict(t_s, event.source, main, patience_s)
            if verdict is Verdict.BELIEVED:
                return self._jumped(after, after.jump, t_s)
        if verdict is Verdict.LEFT:
            agrees = event.source == tracked.jump.source and main.used > 0
            return after._replace(jump=None, settled_s=-inf if agrees else t_s + patience_s)
        return after

    def _jumped(self, after: Tracked, jump: Jump, t_s: float) -> Tracked:
        """The same with the hypothesis of a jump believed: what was raised against sensors since is over with it."""
        alarms = after.alarms._replace(holds_from_s=nextafter(t_s, -inf)).noted(t_s, (GYRO, *jump.suspects))
        trial = None if after.trial is None else Trial(jump.estimates)
        anew = Tracked(jump.estimates, jump.fares, None, after.restarts, trial, alarms)
        return anew._replace(jumps=after.jumps + 1)

    def _beside(self, after: Tracked, event: Event, main: Outcome | None) -> Tracked:
        """The same with an event taken into the hypothesis of a jump too; main: what became of it in the filter."""
        jump = after.jump
        if jump is None:
            return after
        at, outcomes = self._through(jump.estimates, event)
        if main is None or not outcomes:
            return after._replace(jump=jump._replace(estimates=at))
        fares = {**jump.fares, event.source: jump.fares[event.source].after(event.t_s, outcomes[: self._watched])}
        return after._replace(jump=jump.after(at, event.source, fares, outcomes[0], main))

    def _tried(self, trial: Trial, event: Event, taken: Taken, before: Estimates) -> Tried:
        """What an event makes of a start of which no two images have agreed yet; taken: of its estimates before."""
        if event.source not in self._lights:
            return Tried(trial.passed(lambda at: self._through(at, event)), taken)
        blind = self.motion.settled(trial.blind, self.samples, event.t_s)
        without: Callable[[], Estimates] | None = None
        if self._may_fold(blind, event):
            without = partial(self.motion.settled, before, self.samples, event.t_s)
        return trial.seen(event, taken, blind, lambda at: self._through(at, event), without)

    def _may_fold(self, blind: Estimates, event: Event) -> bool:
        """Whether the target may be turned so far that an image contradicts its gate."""
        shown = event.source in self._lights and np.isfinite(event.value).sum() >= 2 * LEAST_LIGHTS
        return bool(shown and blind.covariance[0].diagonal()[TARGET_ATTITUDE].max() > FOLDS_RAD**2)

    def _is_locked_out(self, event: Event, lights: int, fares: Mapping[str, Fare]) -> bool:
        """Whether no image of lights has been believed for long, although this one shows enough of them."""
        if lights < LEAST_LIGHTS or fares[event.source].doubted < LOST_IMAGES:
            return False
        agreed_s = max(-inf if isnan(fares[name].agreed_s) else fares[name].agreed_s for name in self._lights)
        return event.t_s - agreed_s >= self.vehicle.filter.restart_after_s

    def _anew(self, at: Estimates, event: Event) -> Search:
        """A search that begins with an image that a filter which is locked out refused."""
        blind = locked_out(at, self._layouts, self.vehicle)
        return opened(blind, self._explained(blind, event, at), at)

    def _explained(self, blind: Estimates, event: Event, before: Estimates | None) -> list[Hypothesis]:
        """Where the explanations of an image begin: at a start, or after a lock-out."""
        sensor = self.sensors[event.source]
        assert isinstance(sensor, PointSensor)
        poses = sensor.poses(blind, event.value, event.noise)
        if before is None:
            return [hypothesis_about(blind, attitude, self._begin, self.frame) for attitude, _ in poses]
        return [hypothesis_anew(blind, pose, self.frame) for pose in poses]

    def _through(self, before: Estimates, event: Event) -> tuple[Estimates, list[Outcome]]:
        """What an event makes of estimates, and what became of it in each filter; nothing of a command."""
        t_s, _, source, value, noise = event
        at = self.motion.settled(before, self.samples, t_s)
        if source == THRUST:
            return at._replace(command_m_s2=value), []
        sensor = self.sensors[source]
        if at.values is before.values:  # the same arrays, though the gyro may be lost since
            at = at.copied()
        hidden = [self._without[source]] if self._without else []
        outcomes = self._updater.take(at, lambda estimates: hide(sensor.rows(estimates, value, noise), hidden))
        return sensor.pivoted(at, value, outcomes) if isinstance(sensor, PointSensor) else at, outcomes

    def _searched(self, search: Search, event: Event) -> tuple[Search, list[Outcome]]:
        """What an event makes of a start that is not over, and what became of it in the best hypothesis."""
        sensor = self.sensors.get(event.source)
        if not isinstance(sensor, PointSensor):
            return search.passed(lambda at: self._through(at, event))
        if np.isfinite(event.value).sum() < 2 * LEAST_LIGHTS:
            return search.moved(lambda at: self.motion.settled(at, self.samples, event.t_s)), [NOT_USED]
        blind = self.motion.settled(search.blind, self.samples, event.t_s)
        return search.seen(
            lambda at: self._through(at, event),
            blind,
            lambda at: self._explained(at, event, search.before),
        )

    def known_start(self, events: Iterable[Event]) -> Tracked:
        """The start with the target's attitude that is found from these events, in order; as it is if it is known.

        It is not if the trial of the first image comes to a search.

        Raises
        ------
        ValueError
            If more than one explanation, or none, is left at their end.
        """
        tracked, left = self.start, 0
        for event in events:
            if (tracked.search is None and tracked.trial is None) or tracked.restarts:
                return self.start
            searched = tracked.search is not None
            tracked, _ = self.apply(tracked, event)
            if tracked.search is not None:
                left = len(tracked.search.hypotheses)
            elif searched:
                known = found_at_start(self.start.estimates, tracked.estimates, self._begin, self.frame)
                return self.start._replace(estimates=known, search=None, trial=None)
        if tracked.search is None or tracked.restarts:
            return self.start
        raise ValueError(
            f"attitudes of the target that explain what was seen: {left}; a flight has to show one to be smoothed"
        )

    def after_trial(self, start: Tracked, events: Sequence[Event]) -> tuple[Tracked, list[Event]]:
        """A start without a trial, and of these events, in order, those that its trial does not leave."""
        tracked, left = start, list[Event]()
        for event in events:
            trial = tracked.trial
            if trial is None:
                break
            tracked, _ = self.again(tracked, event)
            if tracked.trial is not None and trial.image is not None and tracked.trial.image is not trial.image:
                left.append(trial.image)
            if tracked.trial is not None and tracked.trial.refused > trial.refused:
                left.append(event)
        return start._replace(trial=None), [event for event in events if not any(event is one for one in left)]

    def settled(self, tracked: Tracked, t_s: float) -> Tracked:
        """The same at t_s, not before its own time."""
        return tracked.moved(lambda at: self.motion.settled(at, self.samples, t_s))

    def drifts(self, at: Estimates) -> Drifts:
        """How far what was seen until then looks like drifts."""
        return Drifts(self._drifts, *score_of(at.drift))

    def estimate(self, tracked: Tracked, t_s: float, final_before_s: float) -> VehicleEstimate:
        """What is told of t_s, not before the time of `tracked`."""
        at = self.motion.settled(tracked.estimates, self.samples, t_s)
        state, rate = at.of(0), self.motion.chaser_rate(at, self.samples)
        return VehicleEstimate(
            t_s=t_s,
            port=self._port(at, 0),
            motion=state.values[:MOTION].copy(),
            dcm_lvlh_from_target=state.dcm_lvlh_from_target.copy(),
            target_rate_rad_s=state.values[TARGET_RATE].copy(),
            dcm_inertial_from_chaser=state.dcm_inertial_from_chaser.copy(),
            chaser_rate_rad_s=rate,
            values=state.values.copy(),
            covariance=state.covariance.copy(),
            layout=self.layout,
            sensors={name: fare.health for name, fare in tracked.fares.items()},
            gyro_lost=at.lost is not None,
            drifts=self.drifts(at),
            final_before_s=final_before_s,
            vehicle=self.vehicle,
            ambiguous=tracked.search is not None or tracked.is_tried,
            explanations=1 if tracked.search is None else len(tracked.search.hypotheses),
            restarts=tracked.restarts,
            without={name: self._port(at, f) for name, f in self._without.items()},
            _memory=tracked.alarms._replace(asked_s=tracked.estimates.t_s),
        )

    def _port(self, at: Estimates, f: int) -> PortState:
        """The ports as one of the filters has them."""
        rate, more = self.motion.chaser_rate(at, self.samples, f), self.motion.rate_variance(at, self.samples, f)
        return port_state(self.vehicle, self.frame, at.of(f), rate, more)[0]
