"""A log of star frames to attitudes: each lost in space, and if that fails, on request, near the attitude expected."""

import dataclasses

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
        Whether a frame without an attitude is tried near the one that the two before lead to at a constant rate. It
        needs two stars that chance would not put there, instead of four.

    Attributes
    ----------
    tracked : int
        Frames that were solved so.
    """

    def __init__(self, sensor: StarSensor, epoch_jyear: float | None, tracking: bool) -> None:
        self.sensor, self.epoch_jyear, self.tracking = sensor, epoch_jyear, tracking
        self.tracked = 0
        self._before: list[tuple[float, Matrix]] = []

    def solve(self, t_s: float, frame: StarFrame, velocity_km_s: Vector | None) -> StarSolution:
        """The attitude of the frame at a time after those before."""
        seen = {"flux": frame.flux, "magnitude": frame.magnitude, "velocity_km_s": velocity_km_s}
        solution = measure(frame.spots_px, self.sensor, epoch_jyear=self.epoch_jyear, **seen)
        prior = self._expected(t_s) if self.tracking and not solution.ok else None
        if prior is not None:
            near = track(frame.spots_px, self.sensor, prior, WIDEST_PRIOR_RAD, epoch_jyear=self.epoch_jyear, **seen)
            self.tracked += near.ok
            solution = near if near.ok else dataclasses.replace(solution, reason=f"{solution.reason}; {near.reason}")
        if solution.ok:
            self._before = [*self._before[-1:], (t_s, solution.dcm_cam_from_icrs)]
        return solution

    def _expected(self, t_s: float) -> Matrix | None:
        """From the last two attitudes, turning on as between them; None without two, or long after them."""
        if len(self._before) < 2:
            return None
        (t0, first), (t1, second) = self._before
        if t_s - t1 > FARTHEST * (t1 - t0):
            return None
        rate = rotation_vector_between(second, first) / (t1 - t0)
        return turned(second, rate * (t_s - t1))
