"""The gyro of a chaser, as its vehicle file states it."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge

from relnav.estimation.state_layout import Role
from relnav.mission import NonNegative, Positive


@dataclass(frozen=True)
class Gyro:
    """Three rate-integrating gyros along the chaser's axes.

    Attributes
    ----------
    rate_hz : float
        Samples a second; a sample is the mean rate over the period that begins at its time.
    random_walk_rad_sqrt_s : float
        Angle random walk, each axis.
    bias_sigma_rad_s : float
        1-sigma of each axis' bias at the start.
    bias_walk_rad_s_sqrt_s : float
        What the bias gains in one second.
    lost_after_periods : float
        Without a sample for so many periods the gyro counts as lost: the last rate is held, and walks.
    lost_rate_walk_rad_s_sqrt_s : float
        How the chaser's rate then walks, each axis.
    scale_sigma, misalignment_sigma_rad : float
        1-sigma of the relative error of each axis' scale, and of what it measures of the rate about each other axis.
        Both last: (1 + scale) w_x + xy w_y + xz w_z about x. Nine states more unless both are zero.
    role : {"estimated", "considered"}
        Of scale and misalignment.
    """

    rate_hz: Positive
    random_walk_rad_sqrt_s: Positive
    bias_sigma_rad_s: Positive
    bias_walk_rad_s_sqrt_s: NonNegative
    lost_after_periods: Annotated[float, Ge(1.0)] = 2.5
    lost_rate_walk_rad_s_sqrt_s: Positive = 1e-4
    scale_sigma: NonNegative = 0.0
    misalignment_sigma_rad: NonNegative = 0.0
    role: Role = "estimated"

    @property
    def is_off(self) -> bool:
        """Whether it has an error of scale or misalignment that lasts."""
        return self.scale_sigma > 0.0 or self.misalignment_sigma_rad > 0.0
