"""Beacons and markers, seen tightly: every spot is two rows about the whole state.

    p = exp(-[e x]) C_SB (C_BI C_IL (C_LT s - rho) - c)

is a light in sensor axes: s its place in the target, c the lens in the chaser, e what the sensor is turned by. Off by
small errors (theta of the target, alpha of the chaser), with q = C_BL (C_LT s - rho):

    dp = C_SB (-C_BL drho - C_BT [s x] theta + [q x] alpha - dc + C_BT ds) + [p x] e

Spots are f X / Z and f Y / Z, with a camera's distortion; a focal length off by dk of itself moves them by dk of their
distance from the principal point.
"""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack, Vector, numbers
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.pinhole import central_projection, central_projection_jacobian
from relnav.geometry.rotation_vector import turned
from relnav.mission import Model as BeaconMission
from relnav.sensors.three_beacon.sensor import ThreeBeaconSensor
from relnav.sensors.three_marker.camera import image_of, on_image, usable_covariance
from relnav.sensors.three_marker.sensor import MarkerCamera
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import CHASER_ATTITUDE, POSITION, TARGET_ATTITUDE, Layout
from relnav.vehicle.rows import Rows
from relnav.vehicle.state import OrbitFrame, VehicleState


class PointSensor:
    """A camera or a position-sensitive detector on the chaser, and the lights on the target that it looks at."""

    def __init__(self, vehicle: Vehicle, name: str, layout: Layout, frame: OrbitFrame) -> None:
        model, mounted = vehicle.models[name], vehicle.sensor[name]
        self.name, self._frame, self._size = name, frame, layout.size
        self._optics: ThreeBeaconSensor | MarkerCamera
        self._optics = model.sensor if isinstance(model, BeaconMission) else model.camera
        self.sigma = model.sensor.spot_noise_m if isinstance(model, BeaconMission) else model.camera.spot_noise_px
        self.unit = "m" if isinstance(model, BeaconMission) else "px"
        self._points = vehicle.points_m(name)
        self._dcm_sensor_from_chaser = mounted.dcm_sensor_from_chaser
        self._lens = np.array(mounted.position_m)
        places = layout.by_name
        self._mount, self._lever, self._focal, self._lights = (
            places[f"{name}.{kind}"] for kind in ("mount", "lever", "focal", "points")
        )

    def taken(self, value: ArrayLike, covariance: ArrayLike | None) -> tuple[Vector, Matrix]:
        """A caller's spots (n, 2) as numbers, flat, and their noise (2 n, 2 n).

        NaN is a spot off the detector, or with a covariance that is none.

        Raises
        ------
        ValueError
            For another shape.
        """
        spots, count = numbers(self.name, value), len(self._points)
        if spots.shape != (count, 2):
            raise ValueError(
                f"{self.name}: spots of its {count} lights, ({count}, 2) {self.unit}, are expected, NaN = not seen; "
                f"got shape {spots.shape}"
            )
        if isinstance(self._optics, MarkerCamera):
            inside = on_image(spots, self._optics)
        else:
            inside = np.all(np.abs(spots) <= 0.5 * np.array(self._optics.detector_size_m), axis=1)
        noise = np.zeros((2 * count, 2 * count))
        noise[np.arange(2 * count), np.arange(2 * count)] = self.sigma**2
        if covariance is not None:
            own = numbers(f"{self.name}'s covariance", covariance)
            if own.shape != (count, 2, 2):
                raise ValueError(f"{self.name}: covariances of {count} spots are ({count}, 2, 2); got {own.shape}")
            inside &= usable_covariance(own)
            for k in np.flatnonzero(inside):
                noise[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = own[k]
        return np.where(inside[:, None], spots, np.nan).ravel(), noise

    def rows(self, state: VehicleState, spots: Vector, noise: Matrix) -> Rows:
        """Rows of spots (2 n,) at a settled state."""
        values, count = state.values, len(self._points)
        C_BL = state.dcm_inertial_from_chaser.T @ self._frame.dcm_lvlh_from_inertial(state.t_s).T
        C_LT = state.dcm_lvlh_from_target
        C_SB = turned(self._dcm_sensor_from_chaser.T, values[self._mount]).T  # true = exp(-[e x]) nominal
        places = self._points + values[self._lights].reshape(-1, 3)
        q = (places @ C_LT.T - values[POSITION]) @ C_BL.T
        p = (q - self._lens - values[self._lever]) @ C_SB.T
        image, slope, centre = self._image(p)
        scale = 1.0 + float(values[self._focal][0])
        C_ST = C_SB @ C_BL @ C_LT
        by_p = np.zeros((count, 3, self._size))
        by_p[:, :, POSITION] = -C_SB @ C_BL
        by_p[:, :, TARGET_ATTITUDE] = -C_ST @ cross_matrix(places)
        by_p[:, :, CHASER_ATTITUDE] = C_SB @ cross_matrix(q)
        by_p[:, :, self._mount] = cross_matrix(p)
        by_p[:, :, self._lever] = -C_SB
        for k in range(count):
            first = self._lights.start + 3 * k
            by_p[k, :, first : first + 3] = C_ST
        H = (scale * slope) @ by_p
        H[:, :, self._focal] += (image - centre)[:, :, None]
        predicted = centre + scale * (image - centre)
        return Rows(spots - predicted.ravel(), H.reshape(2 * count, self._size), noise, 2)

    def _image(self, p: Matrix) -> tuple[Matrix, Stack, Vector]:
        """Spots (n, 2) of lights (n, 3) in sensor axes, their slope (n, 2, 3), and the principal point."""
        if isinstance(self._optics, MarkerCamera):
            spots, slope = image_of(p, self._optics)
            return spots, slope, np.array(self._optics.principal_point_px)
        f = self._optics.focal_length_m
        return f * central_projection(p), f * central_projection_jacobian(p), np.zeros(2)
