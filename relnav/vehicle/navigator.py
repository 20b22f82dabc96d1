"""One navigator for a whole vehicle: observations in any order in, the state at the docking port out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import LARGEST, Matrix, Vector, number, numbers
from relnav.dynamics.in_frame import FramedTrack, in_frame
from relnav.spacecraft import GYRO, POINTS, RESERVED, STAR, THRUST, Vehicle
from relnav.vehicle.directions import StarTracker, SunSensor
from relnav.vehicle.flying_sensor import Flown, FlyingSensor
from relnav.vehicle.gyro import GyroSamples
from relnav.vehicle.health import Fare, SensorHealth
from relnav.vehicle.layout import GYRO_BIAS, Layout, layout_of
from relnav.vehicle.monitor import Sums, all_estimated
from relnav.vehicle.motion import VehicleMotion
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.points import PointSensor
from relnav.vehicle.port import PortState, port_state
from relnav.vehicle.separation import FAULT_PROBABILITY, hide, protection_level_m
from relnav.vehicle.state import Estimates, start_state
from relnav.vehicle.timeline import ACCEPTED, REJECTED, REPLAYED, TOO_OLD, Event, Observed, Timeline
from relnav.vehicle.update import Outcome, Updater

LONGEST_PREDICTION_S = 60.0
MOST = {GYRO: 1e3, THRUST: 1e4}
"""Of a rate, rad/s, and an acceleration, m/s^2: more is a mistake."""
_NOTHING = np.zeros((0, 0))


@dataclass(frozen=True)
class VehicleEstimate:
    """What the navigator knows at one time.

    Attributes
    ----------
    t_s : float
    port : PortState
        Port from port, target axes, with joint covariance.
    motion : (6,)
        Centre of mass from centre of mass and its rate, `lvlh_ccsds` of the vehicle file's orbit.
    dcm_lvlh_from_target, target_rate_rad_s : (3, 3), (3,)
    dcm_inertial_from_chaser, chaser_rate_rad_s : (3, 3), (3,)
    values, covariance : (n,), (n, n)
        All additive values and all errors, by `layout`.
    layout : Layout
    sensors : mapping
        How each fares, by name.
    gyro_lost : bool
    final_before_s : float
        No observation is taken that is older: what the filter made of the time before stands.
    vehicle : Vehicle
        What flies.
    without : mapping
        The port as filters without each sensor in turn have it, by the sensor's name; empty unless they are flown.
    """

    t_s: float
    port: PortState
    motion: Vector
    dcm_lvlh_from_target: Matrix
    target_rate_rad_s: Vector
    dcm_inertial_from_chaser: Matrix
    chaser_rate_rad_s: Vector
    values: Vector
    covariance: Matrix
    layout: Layout
    sensors: Mapping[str, SensorHealth]
    gyro_lost: bool
    final_before_s: float
    vehicle: Vehicle = field(repr=False)
    without: Mapping[str, PortState] = field(default_factory=dict, repr=False)

    def protection_level_m(self, probability: float = 1e-7, fault_probability: float = FAULT_PROBABILITY) -> Vector:
        """What the port's position error exceeds along each axis with no more than this probability, (3,) m.

        With any one sensor at fault, each with fault_probability (`relnav.vehicle.separation`).

        Raises
        ------
        UsageError
            Without `separation=True` of the navigator, and for what is no probability.
        """
        return protection_level_m(self.port, self.without, probability, fault_probability)

    def in_frame(self, frame: str) -> FramedTrack:
        """Motion, the target's attitude and rate, and their covariance (12, 12), turned: a track of one epoch.

        Parameters
        ----------
        frame : {"lvlh_ccsds", "rsw", "dock", "eci_relative", "eci"}
            What each is: `relnav.dynamics.in_frame.FRAMES`; inertial ones by the vehicle file's orbit, which `eci`
            takes as the target's. `port` is in the target's axes, whatever the frame.

        Raises
        ------
        UsageError
            For an unknown frame.
        """
        epoch = SimpleNamespace(
            t_s=np.array([self.t_s]),
            state=self.motion[None],
            covariance=self.covariance[None, :12, :12],
            dcm_lvlh_from_target=self.dcm_lvlh_from_target[None],
            rate_rad_s=self.target_rate_rad_s[None],
            model=self.vehicle.name,
        )
        return in_frame(epoch, frame, self.vehicle, self.vehicle.orbit.orientation_deg)

    @property
    def alarms(self) -> tuple[str, ...]:
        """Sensors in alarm: while there is one do not use the estimate."""
        return tuple(name for name, health in self.sensors.items() if health.alarm)


class _Tracked(NamedTuple):
    """Estimates, and how each sensor has fared until then."""

    estimates: Estimates
    fares: Mapping[str, Fare]


class VehicleNavigator:
    """Five sensors, a gyro and the thrusters of one vehicle in one filter.

    Attributes
    ----------
    vehicle, layout
        What flies, and the blocks of its errors.
    on_outcome : callable or None
        Called with every (event, outcome), again where it is done again: what became of each observation.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        t_s: float = 0.0,
        position_m: ArrayLike | None = None,
        velocity_m_s: ArrayLike | None = None,
        sensors: Mapping[str, FlyingSensor] | None = None,
        monitor: bool = True,
        separation: bool = False,
    ) -> None:
        """Start the filter.

        Parameters
        ----------
        vehicle : Vehicle
            `relnav.load_model("rendezvous_demo")`, or your own file.
        t_s : float
            When: nothing before it is used.
        position_m, velocity_m_s : (3,), optional
            The chaser's centre of mass from the target's, `lvlh_ccsds` of the file's orbit; [hand_over] if left out.
        sensors : mapping, optional
            Sensors of your own by name (`relnav.vehicle.flying_sensor`), flown beside those of the file.
        monitor : bool
            Whether a second filter watches the first (`relnav.vehicle.monitor`), for a third more computing.
        separation : bool
            Whether a filter without each sensor in turn is flown beside, for a protection level with one of them at
            fault (`relnav.vehicle.separation`), for four times the computing with five sensors.

        Raises
        ------
        ValueError
            For what is no vehicle, arguments of another shape, or a sensor with a name that is taken.
        """
        if not isinstance(vehicle, Vehicle):
            raise ValueError(
                f"a vehicle is expected, as relnav.load_model('rendezvous_demo') gives; got a {type(vehicle).__name__}"
            )
        place = _three("position_m", vehicle.start_position_m if position_m is None else position_m)
        speed = _three("velocity_m_s", vehicle.hand_over.velocity_m_s if velocity_m_s is None else velocity_m_s)
        more = dict(sensors or {})
        for name in more:
            if name in vehicle.sensor or name in RESERVED:
                raise ValueError(f"sensors: the name '{name}' is taken in {vehicle.name}; call it something else")
        self.vehicle, self.layout = vehicle, layout_of(vehicle, {name: own.lasting for name, own in more.items()})
        self._frame = OrbitFrame(vehicle.orbit)
        self._motion = VehicleMotion(vehicle, self._frame)
        layouts = [self.layout, all_estimated(self.layout)] if monitor else [self.layout]
        self._watched, names = len(layouts), [*vehicle.sensor, *more] if separation else []
        self._without = {name: len(layouts) + k for k, name in enumerate(names)}
        layouts += [self.layout] * len(names)
        self._sensors: dict[str, PointSensor | StarTracker | SunSensor | Flown]
        self._sensors = {name: self._sensor(name, len(layouts)) for name in vehicle.sensor}
        self._sensors |= {name: Flown(own, name, self.layout) for name, own in more.items()}
        rows = max(sensor.most_rows for sensor in self._sensors.values())
        turning = -vehicle.orbit.mean_motion_rad_s * vehicle.chaser.dcm_chaser_from_lvlh[:, 1]  # held in its orbit
        self._samples = GyroSamples(turning)
        self._updater = Updater(layouts, vehicle.filter.gate_probability, rows)
        self._places = {name: k for k, name in enumerate([*RESERVED, *self._sensors])}
        motion = np.concatenate([place, speed])
        start = start_state(vehicle, self.layout, self._frame, number("t_s", t_s), motion, len(layouts))
        tracked = _Tracked(start, dict.fromkeys(self._sensors, Fare(Sums(start.t_s))))
        self._timeline: Timeline[_Tracked, Outcome | None]
        window_s = vehicle.filter.replay_window_s
        self._timeline = Timeline(tracked, start.t_s, window_s, self._apply)
        self.on_outcome: Callable[[Event, Outcome], None] | None = None

    def observe(self, sensor: str, t_s: float, value: Any, covariance: ArrayLike | None = None) -> Observed:
        """Take an observation in, in any order within the replay window.

        Parameters
        ----------
        sensor : str
            A sensor's name in the vehicle file, "gyro" or "thrust".
        t_s : float
            When it was exposed; of a gyro sample or a command, from when on it holds.
        value
            Of lights, their spots (n, 2), m or px as the sensor's model has them, NaN = not seen. Of a star sensor, the
            StarSolution that its `measure` returns, or the quaternion (4,) of v_sensor = R v_inertial, scalar last. Of
            a sun sensor, the SunDirection that its `measure` returns. Of a sensor of your own, what it takes. "gyro":
            the mean rate (3,) rad/s over the sample's period. "thrust": the commanded acceleration (3,) m/s^2. Both in
            chaser axes.
        covariance : optional
            Of its noise: (n, 2, 2) of spots, (3, 3) rad^2 in sensor axes of a star sensor; if left out, the solution's
            or the file's.

        Raises
        ------
        ValueError
            For another name, shape or time.
        """
        if sensor == GYRO:
            return self._sample(t_s if type(t_s) is float else number("t_s", t_s), value)
        if sensor not in self._places:
            raise ValueError(f"no sensor '{sensor}' in {self.vehicle.name}; there are {', '.join(self._places)}")
        if sensor in self._sensors:
            taken, noise = self._sensors[sensor].taken(value, covariance)
            if not any(map(isfinite, taken.tolist())):
                return REJECTED
        else:
            taken, noise = np.array(_three(sensor, value)), _NOTHING
        event = Event(number("t_s", t_s), self._places[sensor], sensor, taken, noise)
        verdict, outcome = self._timeline.insert(event)
        return REJECTED if outcome is not None and outcome.used == 0 else verdict

    @property
    def newest_s(self) -> float:
        """Time of the last observation; of the start before the first."""
        return self._timeline.newest_s

    def state(self, t_s: float | None = None) -> VehicleEstimate:
        """The estimate now (after the last observation), or at a time within the replay window or up to 60 s ahead.

        Raises
        ------
        ValueError
            For another time.
        """
        newest = self._timeline.newest_s
        if t_s is None:
            return self._estimate(self._timeline.newest, newest)
        time = number("t_s", t_s)
        return self.propagate(time) if time > newest else self._estimate(self._timeline.before(time), time)

    def propagate(self, t_s: float) -> VehicleEstimate:
        """What the estimate will be at t_s if nothing more is seen, at most 60 s ahead; the filter is left as it is.

        Raises
        ------
        ValueError
            For another time.
        """
        time, newest = number("t_s", t_s), self._timeline.newest_s
        if not newest <= time <= newest + LONGEST_PREDICTION_S:
            raise ValueError(
                f"t_s lies between the last observation ({newest:g} s) and {LONGEST_PREDICTION_S:g} s after it; "
                f"got {time!r}"
            )
        return self._estimate(self._timeline.newest, time)

    def _sensor(self, name: str, filters: int) -> PointSensor | StarTracker | SunSensor:
        kind = self.vehicle.kind(name)
        if kind == POINTS:
            return PointSensor(self.vehicle, name, self.layout, self._frame, filters)
        return (StarTracker if kind == STAR else SunSensor)(self.vehicle, name, self.layout, filters)

    def _sample(self, t_s: float, value: ArrayLike) -> Observed:
        """Take a gyro sample in: it waits for the next observation, unless there is a later one already."""
        timeline, samples, (x, y, z) = self._timeline, self._samples, _three(GYRO, value)
        sample = t_s, x, y, z
        if samples.is_full:
            samples.make_room(timeline.forward(self._forwarded).estimates.t_s)
        if timeline.goes_on(t_s):
            samples.insert(sample)
            return ACCEPTED
        if timeline.is_too_old(GYRO, t_s):
            return TOO_OLD
        later = samples.insert(sample)
        if later < 0:
            return REJECTED
        try:
            return REPLAYED if timeline.changed(t_s) or later else ACCEPTED
        except ValueError:
            samples.remove(sample)
            raise

    def _forwarded(self, tracked: _Tracked, t_s: float) -> _Tracked:
        return tracked._replace(estimates=self._motion.forwarded(tracked.estimates, self._samples, t_s))

    def _apply(self, tracked: _Tracked, event: Event) -> tuple[_Tracked, Outcome | None]:
        """The estimates after an event; the outcome of one that the filter had to believe."""
        t_s, _, source, value, noise = event
        before, fares = tracked
        at = self._motion.settled(before, self._samples, t_s)
        if source == THRUST:
            return _Tracked(at._replace(command_m_s2=value), fares), None
        sensor = self._sensors[source]
        if at is before:
            at = before.copied()
        hidden = [self._without[source]] if self._without else []
        outcomes = self._updater.take(at, lambda estimates: hide(sensor.rows(estimates, value, noise), hidden))
        if self.on_outcome is not None:
            self.on_outcome(event, outcomes[0])
        return _Tracked(at, {**fares, source: fares[source].after(t_s, outcomes[: self._watched])}), outcomes[0]

    def _estimate(self, tracked: _Tracked, t_s: float) -> VehicleEstimate:
        at = self._motion.settled(tracked.estimates, self._samples, t_s)
        state, rate = at.of(0), self._motion.chaser_rate(at, self._samples)
        port, _ = port_state(self.vehicle, self._frame, state, rate)
        alone = {name: at.of(f) for name, f in self._without.items()}
        turning = rate + state.values[GYRO_BIAS]
        return VehicleEstimate(
            t_s=t_s,
            port=port,
            motion=state.values[:6].copy(),
            dcm_lvlh_from_target=state.dcm_lvlh_from_target.copy(),
            target_rate_rad_s=state.values[9:12].copy(),
            dcm_inertial_from_chaser=state.dcm_inertial_from_chaser.copy(),
            chaser_rate_rad_s=rate,
            values=state.values.copy(),
            covariance=state.covariance.copy(),
            layout=self.layout,
            sensors={name: fare.health for name, fare in tracked.fares.items()},
            gyro_lost=at.lost is not None,
            final_before_s=self._timeline.newest_s - self.vehicle.filter.replay_window_s,
            vehicle=self.vehicle,
            without={
                name: port_state(self.vehicle, self._frame, other, turning - other.values[GYRO_BIAS])[0]
                for name, other in alone.items()
            },
        )


def _three(name: str, value: ArrayLike) -> tuple[float, float, float]:
    array, most = numbers(name, value), MOST.get(name, LARGEST)
    if array.shape == (3,):
        x, y, z = array.tolist()
        if abs(x) <= most and abs(y) <= most and abs(z) <= most:
            return x, y, z
    raise ValueError(f"{name}: three finite numbers up to {most:g} in size are expected; got {array.tolist()}")
