"""What a vehicle's approach is and what is uncertain about it, as a scenario file says it: plain values in SI units."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Gt

from relnav.mission import NonNegative
from relnav.simulation.dispersions import Probability, Results
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import VehicleFault

FAULTS = {
    "ramp": VehicleFault.RAMP,
    "lost": VehicleFault.LOST,
    "glint": VehicleFault.GLINT,
    "clock": VehicleFault.CLOCK,
    "late": VehicleFault.LATE,
}


@dataclass(frozen=True)
class VehicleSpread:
    """How runs differ at hand-over, 1-sigma each axis; what is left out is as the vehicle file states it.

    Attributes
    ----------
    start_sigma_m, velocity_sigma_m_s : float or None
        Of position and velocity.
    chaser_attitude_sigma_rad, target_attitude_sigma_rad, target_rate_sigma_rad_s : float or None
        About the held attitudes.
    speed_relative_sigma : float
        Of both closing rates.
    """

    start_sigma_m: NonNegative | None = None
    velocity_sigma_m_s: NonNegative | None = None
    chaser_attitude_sigma_rad: NonNegative | None = None
    target_attitude_sigma_rad: NonNegative | None = None
    target_rate_sigma_rad_s: NonNegative | None = None
    speed_relative_sigma: NonNegative = 0.0


@dataclass(frozen=True)
class VehicleThrust:
    """Errors of the thrusters that last a run, 1-sigma; what is left out is as the vehicle file states it."""

    scale_sigma: NonNegative | None = None
    direction_sigma_rad: NonNegative | None = None


@dataclass(frozen=True)
class VehicleGyro:
    """Errors of the gyro that last a run, 1-sigma; what is left out is as the vehicle file states it."""

    scale_sigma: NonNegative | None = None
    misalignment_sigma_rad: NonNegative | None = None


@dataclass(frozen=True)
class SensorFault:
    """One sensor at fault.

    Attributes
    ----------
    sensor : str
        A sensor of the vehicle file, or gyro; none for no fault.
    kind : {"ramp", "lost", "glint", "clock", "late"}
        Drifting off to five of its sigmas; giving nothing for a while; a glint in its first image; its clock jumping by
        0.5 s; late by 1.5 s.
    from_s, for_s : float
        From when (a glint is in the first image, whenever that is), and how long a ramp grows (60 s if infinite) or a
        sensor is lost. A ramp stays at its full size; a clock that jumped and images that are late stay so.
    probability : float
        In how many of the runs.
    """

    sensor: str = "none"
    kind: Literal["ramp", "lost", "glint", "clock", "late"] = "lost"
    from_s: NonNegative = 30.0
    for_s: Annotated[float, Gt(0.0)] = math.inf
    probability: Probability = 1.0


@dataclass(frozen=True)
class Alignment:
    """How large the errors are that the sensors are built with, as shares of what the vehicle file states.

    Attributes
    ----------
    mount_scale, lever_scale, focal_scale, points_scale : float
        Of every sensor's mounting, lens position, focal length and lights; 1 flies what the filter believes.
    """

    mount_scale: NonNegative = 1.0
    lever_scale: NonNegative = 1.0
    focal_scale: NonNegative = 1.0
    points_scale: NonNegative = 1.0


@dataclass(frozen=True)
class VehicleResults(Results):
    """What is reported of every run.

    Attributes
    ----------
    monitor : bool or None
        Whether a second filter watches the first, so that alarms are counted, for more computing; if left out, where
        [fault] names a sensor.
    """

    monitor: bool | None = None


@dataclass(frozen=True)
class VehicleScenario:
    """A vehicle's approach, what is uncertain about it, and what is reported of it.

    Attributes
    ----------
    approach : Rendezvous
        As it is meant to be flown; it begins where the vehicle file hands over, on the port's axis `start_m` out.
    spread, thrust, gyro, fault, as_built
        What is uncertain.
    results : VehicleResults
        What is reported of every run of a campaign.
    """

    approach: Rendezvous = field(default_factory=Rendezvous)
    spread: VehicleSpread = field(default_factory=VehicleSpread)
    thrust: VehicleThrust = field(default_factory=VehicleThrust)
    gyro: VehicleGyro = field(default_factory=VehicleGyro)
    fault: SensorFault = field(default_factory=SensorFault)
    as_built: Alignment = field(default_factory=Alignment)
    results: VehicleResults = field(default_factory=VehicleResults)

    @property
    def is_watched(self) -> bool:
        """Whether a second filter watches the first."""
        return self.fault.sensor != "none" if self.results.monitor is None else self.results.monitor

    @property
    def range_edges_m(self) -> tuple[float, ...]:
        """Limits of the range bins, port from port: those stated, or six even bins from the end to the start."""
        if self.results.range_edges_m:
            return self.results.range_edges_m
        start, end = self.approach.start_m, self.approach.final_m
        return tuple(end + (start - end) * k / 6.0 for k in range(7))
