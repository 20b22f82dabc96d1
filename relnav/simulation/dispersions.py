"""What is flown and what is uncertain about it, as a scenario file says it: plain values in SI units."""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from relnav.mission import NonNegative, Triple
from relnav.simulation.detector import Faults
from relnav.simulation.trajectory import Approach

Probability = Annotated[float, Ge(0.0), Le(1.0)]
NOTHING: Triple = (0.0, 0.0, 0.0)
BEACONS = ("a", "b", "c")


@dataclass(frozen=True)
class Spread:
    """How runs differ in start and profile; every sigma is 1-sigma of a normal number drawn once a run.

    Attributes
    ----------
    start_sigma_m : (3,)
        Of the start, docking axes.
    velocity_sigma_m_s : (3,)
        Of the velocity there, docking axes.
    speed_relative_sigma : float
        Of the approach speed.
    final_range_sigma_m : float
        Of where the chaser holds.
    target_attitude_sigma_rad, target_rate_sigma_rad_s : float or None
        Of markers: how the target is turned and turns at the start, each axis; as the model expects it if None.
    """

    start_sigma_m: tuple[NonNegative, NonNegative, NonNegative] = NOTHING
    velocity_sigma_m_s: tuple[NonNegative, NonNegative, NonNegative] = NOTHING
    speed_relative_sigma: NonNegative = 0.0
    final_range_sigma_m: NonNegative = 0.0
    target_attitude_sigma_rad: NonNegative | None = None
    target_rate_sigma_rad_s: NonNegative | None = None


@dataclass(frozen=True)
class Thrust:
    """Errors of the thrusters that last a whole run, drawn once a run, 1-sigma.

    Attributes
    ----------
    scale_sigma : float
        Relative, of the size of every executed acceleration.
    direction_sigma_rad : float
        Turn about each axis.
    """

    scale_sigma: NonNegative = 0.0
    direction_sigma_rad: NonNegative = 0.0


@dataclass(frozen=True)
class Images(Faults):
    """Faults of the images: those of `Faults` at random, and one beacon or marker that is lost for a while.

    Attributes
    ----------
    lost_beacon : {"none", "a", "b", "c"}
        Which.
    lost_from_s, lost_for_s : float
        From when and for how long; to the end if left out.
    lost_probability : float
        In how many of the runs.
    by_received_power : bool
        Spot noise by received power (needs the model's [detector] and [light]), told to the filter.
    """

    lost_beacon: Literal["none", "a", "b", "c"] = "none"
    lost_from_s: NonNegative = 0.0
    lost_for_s: Annotated[float, Gt(0.0)] = math.inf
    lost_probability: Probability = 1.0
    by_received_power: bool = False


@dataclass(frozen=True)
class AsBuilt:
    """How far the sensor that flies differs from the model that the filter is given; drawn once a run, 1-sigma.

    Attributes
    ----------
    by_tolerances : bool
        By the model's [tolerances]; the other values are then not used.
    focal_length_relative_sigma, camera_mounting_sigma_rad, beacon_mounting_sigma_rad, beacon_placement_sigma_m : float
        As in a model's [tolerances].
    """

    by_tolerances: bool = False
    focal_length_relative_sigma: NonNegative = 0.0
    camera_mounting_sigma_rad: NonNegative = 0.0
    beacon_mounting_sigma_rad: NonNegative = 0.0
    beacon_placement_sigma_m: NonNegative = 0.0

    @property
    def any(self) -> bool:
        """Whether the sensor differs at all."""
        sigmas = (self.focal_length_relative_sigma, self.camera_mounting_sigma_rad)
        return self.by_tolerances or any((*sigmas, self.beacon_mounting_sigma_rad, self.beacon_placement_sigma_m))


@dataclass(frozen=True)
class Results:
    """What is reported of every run.

    Attributes
    ----------
    range_edges_m : tuple of float
        Limits of the range bins, rising; six even bins from the hold to the start if left out.
    settling_s : float
        Epochs before this time are left out of bins and NEES.
    """

    range_edges_m: tuple[float, ...] = ()
    settling_s: NonNegative = 10.0

    def __post_init__(self) -> None:
        edges = self.range_edges_m
        rising = all(a < b for a, b in pairwise(edges))
        if edges and (len(edges) < 2 or edges[0] < 0.0 or not rising):
            raise ValueError(f"range_edges_m are two or more rising ranges; got {list(edges)}")


@dataclass(frozen=True)
class Scenario:
    """An approach, what is uncertain about it, and what is reported of it.

    Attributes
    ----------
    approach : Approach
        As it is meant to be flown.
    spread, thrust, images, as_built
        What is uncertain.
    results : Results
        What is reported of every run of a campaign.
    """

    approach: Approach = field(default_factory=Approach)
    spread: Spread = field(default_factory=Spread)
    thrust: Thrust = field(default_factory=Thrust)
    images: Images = field(default_factory=Images)
    as_built: AsBuilt = field(default_factory=AsBuilt)
    results: Results = field(default_factory=Results)

    @property
    def range_edges_m(self) -> tuple[float, ...]:
        """Limits of the range bins: those stated, or six even bins from the hold to the start."""
        if self.results.range_edges_m:
            return self.results.range_edges_m
        start, hold = self.approach.start_m[0], self.approach.final_range_m
        return tuple(hold + (start - hold) * k / 6.0 for k in range(7)) if start > hold else (hold, 2.0 * hold)
