"""A log of star frames to attitudes: each lost in space, and if that fails, on request, near the attitude expected."""

import dataclasses
import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.files.star_frames import StarFrame
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.sensors.dual_field import StarSensor, StarSolution, measure, track
from relnav.sensors.dual_field.tracking import WIDEST_PRIOR_RAD

FARTHEST = 3.0
"""Times the step between the last two attitudes that the next is expected from them: farther they are too old."""


class FrameSolver:
    """Attitudes of frames in the order of time.

    Parameters
    ----------
    sensor : StarSensor
        A loaded model.
    epoch_jyear : float or None
        Of the stars' places.
    tracking : bool
        Whether a frame without an attitude is tried near the one that the two before lead to at a constant rate: as
        near as their covariances say, then as far as `track` looks. It needs two stars that chance would not put there,
        instead of four.

    Attributes
    ----------
    tracked : int
        Frames that were solved so.
    """

    def __init__(self, sensor: StarSensor, epoch_jyear: float | None, tracking: bool) -> None:
        self.sensor, self.epoch_jyear, self.tracking = sensor, epoch_jyear, tracking
        self.tracked = 0
        self._before: list[tuple[float, StarSolution]] = []

    def solve(self, t_s: float, frame: StarFrame, velocity_km_s: Vector | None) -> StarSolution:
        """The attitude of the frame at a time after those before."""
        seen = {"flux": frame.flux, "magnitude": frame.magnitude, "velocity_km_s": velocity_km_s}
        seen["spot_covariance_px2"] = frame.covariance_px2
        solution = measure(frame.spots_px, self.sensor, epoch_jyear=self.epoch_jyear, **seen)
        expected = self._expected(t_s) if self.tracking and not solution.ok else None
        if expected is not None:
            prior, sigma = expected
            for reach in (min(sigma, WIDEST_PRIOR_RAD), WIDEST_PRIOR_RAD):
                near = track(frame.spots_px, self.sensor, prior, reach, epoch_jyear=self.epoch_jyear, **seen)
                if near.ok:
                    break
            self.tracked += near.ok
            solution = near if near.ok else dataclasses.replace(solution, reason=f"{solution.reason}; {near.reason}")
        if solution.ok:
            self._before = [*self._before[-1:], (t_s, solution)]
        return solution

    def _expected(self, t_s: float) -> tuple[Matrix, float] | None:
        """From the last two attitudes, turning on as between them, and its largest 1-sigma if it does, rad.

        None without two, or long after them.
        """
        if len(self._before) < 2:
            return None
        (t0, first), (t1, second) = self._before
        ahead = (t_s - t1) / (t1 - t0)
        if ahead > FARTHEST:
            return None
        turn = rotation_vector_between(second.dcm_cam_from_icrs, first.dcm_cam_from_icrs)
        covariance = (1.0 + ahead) ** 2 * second.covariance + ahead**2 * first.covariance
        return turned(second.dcm_cam_from_icrs, ahead * turn), math.sqrt(np.linalg.eigvalsh(covariance)[-1])
