"""Attitudes of a star sensor, three rows, and directions to the sun, two: a turn about the sun line is never seen.

    C_SI = exp(-[e x]) C_SB exp(-[alpha x]) C_BI:   theta = e + C_SB alpha,   ds = [s x] (e + C_SB alpha)

with theta the error of the sensor's inertial attitude in its own axes, s the sun in them, e what it is turned by.
"""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, numbers
from relnav.dynamics.ephemeris import sun_direction
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.geometry.rotation_vector import attitude_error, turned
from relnav.sensors.sun_direction import SunDirection, tangent_basis
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import CHASER_ATTITUDE, Layout
from relnav.vehicle.rows import Rows
from relnav.vehicle.state import VehicleState

EPHEMERIS_SIGMA_RAD = 5e-5
"""Parallax and aberration of a low orbit, which a direction as from the Earth's centre leaves out: 9.4 and 5 arcsec."""


class _Mounted:
    """Where a sensor sits, and its mounting's error."""

    def __init__(self, vehicle: Vehicle, name: str, layout: Layout) -> None:
        self.name = name
        self._nominal = vehicle.sensor[name].dcm_sensor_from_chaser
        self._mount, self._size = layout.by_name[f"{name}.mount"], layout.size

    def dcm_sensor_from_chaser(self, state: VehicleState) -> Matrix:
        """With what is known of the mounting's error, (3, 3)."""
        return turned(self._nominal.T, state.values[self._mount]).T

    def _jacobian(self, by_turn: Matrix, dcm_sensor_from_chaser: Matrix) -> Matrix:
        """Rows (m, n) of what depends by (m, 3) on the turn of the sensor's inertial attitude."""
        H = np.zeros((len(by_turn), self._size))
        H[:, self._mount], H[:, CHASER_ATTITUDE] = by_turn, by_turn @ dcm_sensor_from_chaser
        return H


class StarTracker(_Mounted):
    """A sensor of its own inertial attitude."""

    most_rows = 3

    def __init__(self, vehicle: Vehicle, name: str, layout: Layout) -> None:
        super().__init__(vehicle, name, layout)
        self.noise = np.diag(np.square(vehicle.sensor[name].noise_rad or (np.nan,) * 3))

    def taken(self, value: ArrayLike, covariance: ArrayLike | None) -> tuple[Vector, Matrix]:
        """A caller's quaternion (4,) of v_sensor = R v_inertial, scalar last, and its noise (3, 3) rad^2, sensor axes.

        Raises
        ------
        ValueError
            For another shape, or what is no unit quaternion; one with NaN is not seen.
        """
        q = numbers(self.name, value)
        if q.shape != (4,):
            raise ValueError(f"{self.name}: a quaternion (x, y, z, w) of v_sensor = R v_inertial; got shape {q.shape}")
        own = self.noise if covariance is None else self._checked(covariance)
        if not np.isfinite(q).all():
            return np.full(9, np.nan), own
        return dcm_from_quaternion(q).ravel(), own

    def _checked(self, covariance: ArrayLike) -> Matrix:
        own = numbers(f"{self.name}'s covariance", covariance)
        if own.shape != (3, 3):
            raise ValueError(f"{self.name}: a covariance (3, 3) rad^2 in sensor axes is expected; got {own.shape}")
        if not (np.allclose(own, own.T) and np.linalg.eigvalsh(own).min() > 0.0):
            raise ValueError(f"{self.name}: a covariance is symmetric and positive definite; got {own.tolist()}")
        return own

    def rows(self, state: VehicleState, attitude: Vector, noise: Matrix) -> Rows:
        """Rows of an attitude (9,)."""
        C_SB = self.dcm_sensor_from_chaser(state)
        H = self._jacobian(np.eye(3), C_SB)
        if not np.isfinite(attitude[0]):
            return Rows(np.full(3, np.nan), H, noise, 3)
        predicted = C_SB @ state.dcm_inertial_from_chaser.T
        return Rows(attitude_error(predicted, attitude.reshape(3, 3)), H, noise, 3)


class SunSensor(_Mounted):
    """A sensor of the direction to the sun."""

    most_rows = 2

    def __init__(self, vehicle: Vehicle, name: str, layout: Layout) -> None:
        super().__init__(vehicle, name, layout)
        self._epoch_s = vehicle.orbit.epoch_s
        self._last = (np.nan, np.zeros(3))

    def taken(self, value: SunDirection, covariance: ArrayLike | None) -> tuple[Vector, Matrix]:
        """A measured direction in sensor axes, (3,), and its covariance (3, 3) of rank 2.

        Raises
        ------
        ValueError
            For what is no `SunDirection`, or a covariance that is none.
        """
        if not isinstance(value, SunDirection):
            raise ValueError(
                f"{self.name}: what the sensor's `measure` returns, a SunDirection in sensor axes, is expected; "
                f"got a {type(value).__name__}"
            )
        own = value.covariance if covariance is None else numbers(f"{self.name}'s covariance", covariance)
        if own.shape != (3, 3) or value.direction.shape != (3,):
            raise ValueError(
                f"{self.name}: a direction (3,) and its covariance (3, 3) are expected; got shapes "
                f"{value.direction.shape} and {own.shape}"
            )
        if np.isfinite(value.direction).all() and not (np.isfinite(own).all() and np.allclose(own, own.T)):
            raise ValueError(f"{self.name}: a covariance is finite and symmetric; got {own.tolist()}")
        return value.direction.copy(), np.array(own)

    def sun(self, t_s: float) -> Vector:
        """Unit vector (3,) toward the sun, inertial, at a time of the log's clock."""
        if t_s != self._last[0]:  # an update asks again and again
            self._last = t_s, sun_direction(self._epoch_s + t_s)
        return self._last[1]

    def rows(self, state: VehicleState, direction: Vector, covariance: Matrix) -> Rows:
        """Rows of a direction (3,), across the predicted one."""
        C_SB = self.dcm_sensor_from_chaser(state)
        predicted = C_SB @ state.dcm_inertial_from_chaser.T @ self.sun(state.t_s)
        basis = tangent_basis(predicted)
        H = self._jacobian(basis.T @ cross_matrix(predicted), C_SB)
        noise = basis.T @ covariance @ basis + EPHEMERIS_SIGMA_RAD**2 * np.eye(2)
        return Rows(basis.T @ direction, H, noise, 2)
