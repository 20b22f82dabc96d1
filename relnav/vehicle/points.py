"""Beacons and markers, seen tightly: every spot is two rows about the whole state.

    p = exp(-[e x]) C_SB (C_BI C_IL (C_LT s - rho) - c)

is a light in sensor axes: s its place in the target, c the lens in the chaser, e what the sensor is turned by. Off by
small errors (theta of the target, alpha of the chaser), with q = C_BL (C_LT s - rho):

    dp = C_SB (-C_BL drho - C_BT [s x] theta + [q x] alpha - dc + C_BT ds) + [p x] e

Spots are f X / Z and f Y / Z, with a camera's distortion; a focal length off by dk of itself moves them by dk of their
distance from the principal point.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Flags, Matrix, Vector, numbers
from relnav.estimation.state_layout import StateLayout
from relnav.mission import Model as BeaconMission
from relnav.sensors.three_marker.camera import normalise_spot, usable_covariance
from relnav.sensors.three_marker.pose import explaining_poses
from relnav.sensors.three_marker.sensor import MarkerCamera
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import lights_of, places_of_lights
from relnav.vehicle.light_rows import GEOMETRY, OPTICS, light_rows_into, spots_inside_into
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.pivot import WEIGHTS, pivot_into
from relnav.vehicle.rows import Rows, empty_rows
from relnav.vehicle.state import Estimates
from relnav.vehicle.update import Outcome

LEAST_LIGHTS = 3
"""From which an attitude follows, up to four of them."""


class PointSensor:
    """A camera or a position-sensitive detector on the chaser, and the lights on the target that it looks at."""

    def __init__(self, vehicle: Vehicle, name: str, layout: StateLayout, frame: OrbitFrame, filters: int) -> None:
        model, mounted = vehicle.models[name], vehicle.sensor[name]
        self.name, self._frame = name, frame
        self._points = vehicle.points_m(name)
        self.most_rows = 2 * len(self._points)
        self._rows = empty_rows(filters, self.most_rows, layout.size, 2)
        self._optics, self._work = np.zeros((), OPTICS)[()], np.zeros((), GEOMETRY)[()]
        if isinstance(model, BeaconMission):
            psd = model.sensor
            self.sigma, self.unit, half = psd.spot_noise_m, "m", 0.5 * np.array(psd.detector_size_m)
            self._first, self._last = -half, half
            self._optics["focal_length"] = psd.focal_length_m
        else:
            camera: MarkerCamera = model.camera
            self.sigma, self.unit = camera.spot_noise_px, "px"
            self._first, self._last = np.full(2, -0.5), np.array(camera.image_size_px) - 0.5
            self._optics["focal_length"], self._optics["distortion"] = camera.focal_length_px, camera.distortion
            self._optics["principal_point"] = camera.principal_point_px
        self._noise = self.sigma**2 * np.eye(2 * len(self._points))
        self._optics["lens"], self._optics["dcm_chaser_from_sensor"] = (
            mounted.position_m,
            mounted.dcm_sensor_from_chaser.T,
        )
        for kind in ("mount", "lever", "focal"):
            self._optics[kind] = layout.by_name[f"{name}.{kind}"].start
        self._lights, self._all_lights = places_of_lights(layout, vehicle, name), lights_of(layout)
        self._whole = np.stack([self.pivot(np.zeros(2 * len(self._points)))] * filters)

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
        seen, noise = np.empty(2 * count), self._noise
        spots_inside_into(np.ascontiguousarray(spots), self._first, self._last, seen)
        if covariance is not None:
            own, noise = numbers(f"{self.name}'s covariance", covariance), np.zeros_like(noise)
            if own.shape != (count, 2, 2):
                raise ValueError(f"{self.name}: covariances of {count} spots are ({count}, 2, 2); got {own.shape}")
            known: Flags = usable_covariance(own)
            for k in range(count):
                both = slice(2 * k, 2 * k + 2)
                noise[both, both] = own[k] if known[k] else self._noise[both, both]
                if not known[k]:
                    seen[both] = np.nan
        return seen, noise

    def rows(self, at: Estimates, spots: Vector, noise: Matrix) -> Rows:
        """Rows of spots (2 n,) at settled estimates, in memory that the next call writes anew."""
        rows = self._rows
        light_rows_into(
            self._optics,
            self._work,
            self._points,
            self._lights,
            self._frame.vector,
            self._frame.axes,
            at.t_s,
            at.values,
            at.dcm_lvlh_from_target,
            at.dcm_inertial_from_chaser,
            spots,
            noise,
            rows.residual,
            rows.jacobian,
            rows.noise,
        )
        return rows

    def pivot(self, spots: Vector) -> Vector:
        """The pivot (3 + l,) of spots (2 n,), of which one at least is not NaN (`relnav.vehicle.pivot`)."""
        out = np.empty(WEIGHTS + len(self._all_lights))
        pivot_into(self._points, self._lights, self._all_lights, spots, out)
        return out

    def pivoted(self, at: Estimates, spots: Vector, outcomes: Sequence[Outcome]) -> Estimates:
        """The same after spots (2 n,), of which this became in each filter, about what it believed (`pivot`)."""
        new, count = self._whole, len(self._points)
        for outcome in outcomes:
            if outcome.used != count:
                new = np.where([[one.used > 0] for one in outcomes], self.pivot(spots), at.pivot)
                break
        return at if new is at.pivot else at._replace(pivot=new)

    def poses(self, at: Estimates, spots: Vector, noise: Matrix) -> list[tuple[Matrix, Vector]]:
        """Every pose that explains spots (2 n,) of three lights or more.

        Each is the target's attitude, dcm_lvlh_from_target, and the chaser's position from the target's (3,), lvlh.
        """
        seen = np.flatnonzero(np.isfinite(spots.reshape(-1, 2)).all(axis=1))
        optics, image = self._optics, np.empty((len(seen), 5))
        lens = np.concatenate([optics["focal_length"], optics["principal_point"], np.zeros(3), optics["distortion"]])
        for row, k in enumerate(seen):
            x, y = 2 * k, 2 * k + 1
            own = noise[x, x], noise[x, y], noise[y, x], noise[y, y]
            image[row] = normalise_spot(spots[x], spots[y], *own, lens)
        if not np.isfinite(image).all():
            return []
        frame = self._frame.dcm_lvlh_from_inertial(at.t_s)
        dcm_lvlh_from_chaser = frame @ at.dcm_inertial_from_chaser[0]
        turn = dcm_lvlh_from_chaser @ optics["dcm_chaser_from_sensor"]
        found = explaining_poses(image[:, :2], image[:, 2:], self._points[seen])
        return [(turn @ pose[:3], -(turn @ pose[3] + dcm_lvlh_from_chaser @ optics["lens"])) for pose, *_ in found]
