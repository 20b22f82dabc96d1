"""What a vehicle's filter knows at one time, as it is told."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.dynamics.error_state import POSE
from relnav.dynamics.in_frame import FramedTrack, in_frame
from relnav.estimation.state_layout import StateLayout
from relnav.spacecraft import Vehicle
from relnav.vehicle.alarms import AlarmMemory, contradicting
from relnav.vehicle.drifts import Drifts
from relnav.vehicle.health import SensorHealth
from relnav.vehicle.port import PortState
from relnav.vehicle.separation import FAULT_PROBABILITY, protection_level_m


@dataclass(frozen=True, repr=False)
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
    layout : StateLayout
    sensors : mapping
        How each fares, by name.
    gyro_lost : bool
    drifts : Drifts
        How far what was seen looks like a drift of each sensor, the gyro or the thrusters.
    final_before_s : float
        No observation is taken that is older: what the filter made of the time before stands.
    vehicle : Vehicle
        What flies.
    ambiguous : bool
        The target is looked for (`relnav.vehicle.acquisition`), at a start that does not know its attitude or after a
        lock-out: the estimate, of the most credible explanation, is not to be used. Or no second image of lights has
        agreed with the first yet (`relnav.vehicle.trial`).
    explanations : int
        Poses of the target that explain what was seen.
    restarts : int
        How often it was looked for after a lock-out.
    without : mapping
        The port as filters without each sensor in turn have it, by the sensor's name, "gyro" and "thrust" too; empty
        unless they are flown.
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
    layout: StateLayout
    sensors: Mapping[str, SensorHealth]
    gyro_lost: bool
    drifts: Drifts
    final_before_s: float
    vehicle: Vehicle
    ambiguous: bool = False
    explanations: int = 1
    restarts: int = 0
    without: Mapping[str, PortState] = field(default_factory=dict)
    _memory: AlarmMemory = field(default=AlarmMemory(), repr=False)

    def __repr__(self) -> str:
        """A few lines for the console."""
        place = ", ".join(f"{x:.4f} +- {s:.4f}" for x, s in zip(self.port.position_m, self.port.sigma[:3], strict=True))
        doubts = [
            f", AMBIGUOUS: {self.explanations} explanations" if self.ambiguous else "",
            f", ALARM {', '.join(self.alarms)}" if self.alarms else "",
            ", gyro lost" if self.gyro_lost else "",
        ]
        return (
            f"VehicleEstimate({self.vehicle.name}, t_s={self.t_s:.12g}, port from port {place} m{''.join(doubts)})\n"
            f"  {len(self.sensors)} sensors: .sensors  .port  .drifts  .in_frame('rsw'); print(.layout) for all errors"
        )

    def protection_level_m(self, probability: float = 1e-7, fault_probability: float = FAULT_PROBABILITY) -> Vector:
        """What the port's position error exceeds along each axis with no more than this probability, (3,) m.

        With any one sensor, or the thrusters, at fault, each with fault_probability (`relnav.vehicle.separation`).

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
            covariance=self.covariance[None, :POSE, :POSE],
            dcm_lvlh_from_target=self.dcm_lvlh_from_target[None],
            rate_rad_s=self.target_rate_rad_s[None],
            model=self.vehicle.name,
        )
        return in_frame(epoch, frame, self.vehicle, self.vehicle.orbit.orientation_deg)

    @property
    def alarms(self) -> tuple[str, ...]:
        """What may be at fault, the most likely first: while there is anything do not use the estimate.

        What the last observations say (`relnav.vehicle.alarms.contradicting`), then what they said within `HOLDS_S`.
        That an alarm ends does not say that its fault is over: `last_alarm_s` tells which there were.
        """
        return tuple(dict.fromkeys([*contradicting(self.drifts, self.sensors), *self._memory.held(self.t_s)]))

    @property
    def first_alarm_s(self) -> Mapping[str, float]:
        """When each that ever was among `alarms` was raised first, by name; it is noted every `ASKED_EVERY_S`."""
        return self._alarms.first_s

    @property
    def last_alarm_s(self) -> Mapping[str, float]:
        """When each that ever was among `alarms` was raised last, by name; `alarms` holds it for `HOLDS_S` after."""
        return self._alarms.last_s

    @property
    def _alarms(self) -> AlarmMemory:
        """With those of the last observation."""
        return self._memory.noted(self._memory.asked_s, contradicting(self.drifts, self.sensors))
