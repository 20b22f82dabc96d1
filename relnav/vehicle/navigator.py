"""One navigator for a whole vehicle: observations in any order in, the state at the docking port out."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

from numpy.typing import ArrayLike

from relnav.arrays import number, numbers
from relnav.spacecraft import GYRO, Vehicle
from relnav.vehicle.arguments import refuse_covariance, three
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.filters import VehicleFilters
from relnav.vehicle.flying_sensor import FlyingSensor
from relnav.vehicle.hand_over import Told
from relnav.vehicle.replay import ACCEPTED, REJECTED, REPLAYED, TOO_OLD, Event, Observed, Replay
from relnav.vehicle.tracked import Tracked
from relnav.vehicle.update import Outcome

LONGEST_PREDICTION_S = 60.0


class VehicleNavigator:
    """Five sensors, a gyro and the thrusters of one vehicle in one filter.

    Attributes
    ----------
    vehicle, layout
        The vehicle, and the named blocks of the filter's errors.
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
        covariance : (6, 6), (12, 12) or (15, 15), optional
            Of the first errors of `layout`: position and velocity; the target's attitude and rate too, as in
            `PoseRecord`; the chaser's attitude too. Errors of attitudes are rotation vectors in their body's axes. What
            is left out is as well known as [hand_over] says.
        dcm_lvlh_from_target, target_rate_rad_s : (3, 3), (3,), optional
            The target's attitude, that of [target] if left out, and its inertial rate in its own axes. Without a rate,
            here and in [hand_over], the target is held in its attitude.
        dcm_inertial_from_chaser : (3, 3), optional
            The chaser's attitude; that of [chaser] if left out.
        sensors : mapping, optional
            Sensors of your own by name (`relnav.vehicle.flying_sensor`), flown beside those of the file.
        monitor : bool
            Whether a second filter watches the first (`relnav.vehicle.monitor`), for a third more computing.
        separation : bool
            Whether filters without each sensor, without the gyro and without the thrusters' commands are flown beside,
            for a protection level with one of them at fault (`relnav.vehicle.separation`), for some three times the
            computing with five sensors. The one without the gyro assumes a chaser that is held in the orbital frame.

        Raises
        ------
        ValueError
            For what is no vehicle, arguments of another shape, attitudes and covariances that are none or say too
            little, a sensor with a name that is taken or errors that cannot be, or separation where the target's
            attitude is to be found.
        """
        told: Told = {
            "position_m": position_m,
            "velocity_m_s": velocity_m_s,
            "covariance": covariance,
            "dcm_lvlh_from_target": dcm_lvlh_from_target,
            "target_rate_rad_s": target_rate_rad_s,
            "dcm_inertial_from_chaser": dcm_inertial_from_chaser,
        }
        self._filters = VehicleFilters(vehicle, t_s, told, sensors, monitor=monitor, separation=separation)
        self.vehicle, self.layout = vehicle, self._filters.layout
        self._timeline: Replay[Tracked, Outcome | None]
        start, window_s = self._filters.start, vehicle.filter.replay_window_s
        self._timeline = Replay(start, start.estimates.t_s, window_s, self._filters.apply, self._filters.again)

    def __repr__(self) -> str:
        """The estimate's line for the console."""
        return f"VehicleNavigator of {self.state()!r}"

    def __copy__(self) -> VehicleNavigator:
        """One that goes on by itself, as `copy.deepcopy` gives: what two share each of them would change."""
        return copy.deepcopy(self)

    @property
    def on_outcome(self) -> Callable[[Event, Outcome], None] | None:
        """Called with every (event, outcome), and again whenever an event is processed again."""
        return self._filters.on_outcome

    @on_outcome.setter
    def on_outcome(self, call: Callable[[Event, Outcome], None] | None) -> None:
        self._filters.on_outcome = call

    def observe(self, sensor: str, t_s: float, value: Any, covariance: ArrayLike | None = None) -> Observed:
        """Process an observation; any order is possible within the replay window.

        Parameters
        ----------
        sensor : str
            A sensor's name in the vehicle file, "gyro" or "thrust".
        t_s : float
            Time of exposure; of a gyro sample or a command, the time from which it is valid.
        value
            Of lights, their spots (n, 2), m or px as the sensor's model has them, NaN = not seen. Of a star sensor, the
            StarSolution that its `measure` returns, or the quaternion (4,) of v_sensor = R v_inertial, scalar last. Of
            a sun sensor, the SunDirection that its `measure` returns. Of a sensor of your own, what its class expects.
            "gyro": the mean rate (3,) rad/s over the sample's period. "thrust": the commanded acceleration (3,) m/s^2.
            Both in chaser axes.
        covariance : optional
            Of its noise: (n, 2, 2) of spots, (3, 3) rad^2 in sensor axes of a star sensor; if left out, the solution's
            or the file's. "gyro" and "thrust" take none.

        Raises
        ------
        ValueError
            For another name, shape or time, a covariance where none is taken, and for rows of a sensor of your own that
            do not fit.
        """
        if sensor == GYRO:
            refuse_covariance(sensor, covariance)
            return self._sample(t_s if type(t_s) is float else number("t_s", t_s), value)
        event = self._filters.event(sensor, t_s, value, covariance)
        if event is None:
            return REJECTED
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
        """Prediction of the estimate at t_s, at most 60 s ahead; the filter is not changed.

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

    def _sample(self, t_s: float, value: ArrayLike) -> Observed:
        """Take a gyro sample in: it waits for the next observation, unless there is a later one already.

        Nearly all observations are one that is later than all before.
        """
        timeline, samples, rate = self._timeline, self._filters.samples, numbers(GYRO, value)
        if timeline.goes_on(t_s) and samples.append(t_s, rate):
            timeline.newest_s = t_s
            return ACCEPTED
        sample = t_s, *three(GYRO, rate)
        if samples.is_full:
            samples.make_room(timeline.forward(self._forwarded).estimates.t_s)
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

    def _forwarded(self, tracked: Tracked, t_s: float) -> Tracked:
        motion, samples = self._filters.motion, self._filters.samples
        return tracked.moved(lambda at: motion.forwarded(at, samples, t_s))

    def _estimate(self, tracked: Tracked, t_s: float) -> VehicleEstimate:
        final_before_s = self._timeline.newest_s - self.vehicle.filter.replay_window_s
        return self._filters.estimate(tracked, t_s, final_before_s)
