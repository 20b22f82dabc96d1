"""A sensor on the chaser, a section of the vehicle file: where it sits, how often it looks, how well it is aligned."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from relnav.arrays import Matrix
from relnav.estimation.state_layout import Role
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.mission import IDENTITY, NonNegative, Positive, Quaternion, Triple


@dataclass(frozen=True)
class MountedSensor:
    """A sensor on the chaser.

    Attributes
    ----------
    model : str
        Name of a shipped model, or a path from the vehicle file's folder.
    rate_hz, first_s, delay_s : float
        Images a second, time of the first, and how long after its exposure an image is there; of the last two a filter
        asks nothing, a simulator does.
    q_sensor_from_chaser : (4,)
        v_sensor = R v_chaser, scalar last.
    noise_rad : (3,)
        Of a star sensor: 1-sigma of its attitude about its own axes.
    mount_sigma_rad, mount_role
        Of the turn of the sensor against the chaser, each axis.
    position_m, lever_sigma_m, lever_role
        Its lens from the centre of mass, chaser axes.
    pattern_position_m, extra_points_m
        Where the model's pattern of lights has its origin, target axes from the centre of mass; further lights of it.
    points_sigma_m, points_role
        Of each coordinate of each light; the same for two sensors that look at the same lights.
    focal_sigma, focal_role
        Relative, of the focal length.
    """

    model: str
    rate_hz: Positive
    q_sensor_from_chaser: Quaternion = IDENTITY
    first_s: NonNegative = 0.0
    delay_s: NonNegative = 0.0
    noise_rad: tuple[Positive, Positive, Positive] | None = None
    mount_sigma_rad: NonNegative = 0.0
    mount_role: Role = "considered"
    position_m: Triple | None = None
    lever_sigma_m: NonNegative = 0.0
    lever_role: Role = "considered"
    pattern_position_m: Triple | None = None
    extra_points_m: tuple[Triple, ...] = ()
    points_sigma_m: NonNegative = 0.0
    points_role: Role = "estimated"
    focal_sigma: NonNegative = 0.0
    focal_role: Role = "estimated"

    @cached_property
    def dcm_sensor_from_chaser(self) -> Matrix:
        """The nominal mounting, (3, 3)."""
        return dcm_from_quaternion(np.array(self.q_sensor_from_chaser))
