"""Attitudes of a star sensor, three rows, and directions to the sun, two: a turn about the sun line is never seen.

    C_SI = exp(-[e x]) C_SB exp(-[alpha x]) C_BI:   theta = e + C_SB alpha,   ds = [s x] (e + C_SB alpha)

with theta the error of the sensor's inertial attitude in its own axes, s the sun in them, e what it is turned by.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, numbers
from relnav.dynamics.ephemeris import sun_direction
from relnav.estimation.state_layout import StateLayout
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.sensors.dual_field.solution import StarSolution
from relnav.sensors.sun_direction import SunDirection
from relnav.spacecraft import Vehicle
from relnav.vehicle.direction_rows import MOUNTING, attitude_rows_into, between_into, sun_rows_into
from relnav.vehicle.rows import Rows, empty_rows
from relnav.vehicle.state import Estimates

EPHEMERIS_SIGMA_RAD = 5e-5
"""Parallax and aberration of a low orbit, which a direction as from the Earth's centre leaves out: 9.4 and 5 arcsec."""
SUN_NODES_S = 600.0
"""Between directions of the ephemeris: what a cubic leaves is below rounding."""


def _is_symmetric(covariance: Matrix) -> bool:
    """Whether a matrix (3, 3) is finite and, within 1e-5, symmetric."""
    a, b, c, d, e, f, g, h, i = covariance.ravel().tolist()
    if not math.isfinite(a + b + c + d + e + f + g + h + i):
        return False
    return all(abs(x - y) <= 1e-8 + 1e-5 * abs(y) for x, y in ((b, d), (d, b), (c, g), (g, c), (f, h), (h, f)))


class _Mounted:
    """Where a sensor sits, and its mounting's error."""

    most_rows = 0

    def __init__(self, vehicle: Vehicle, name: str, layout: StateLayout, filters: int) -> None:
        self.name = name
        self._mounting = np.zeros((), MOUNTING)[()]
        self._mounting["dcm_chaser_from_sensor"] = vehicle.sensor[name].dcm_sensor_from_chaser.T
        self._mounting["mount"] = layout.by_name[f"{name}.mount"].start
        self._rows = empty_rows(filters, self.most_rows, layout.size, self.most_rows)


class StarTracker(_Mounted):
    """A sensor of its own inertial attitude."""

    most_rows = 3

    def __init__(self, vehicle: Vehicle, name: str, layout: StateLayout, filters: int) -> None:
        super().__init__(vehicle, name, layout, filters)
        self.noise = np.diag(np.square(vehicle.sensor[name].noise_rad or (np.nan,) * 3))

    def taken(self, value: ArrayLike | StarSolution, covariance: ArrayLike | None) -> tuple[Vector, Matrix]:
        """A caller's quaternion (4,) of v_sensor = R v_inertial, scalar last, and its noise (3, 3) rad^2, sensor axes.

        What the star sensor's `measure` returns is taken with its own covariance; without an attitude it is not seen.

        Raises
        ------
        ValueError
            For another shape, or what is no unit quaternion; one with NaN is not seen.
        """
        if isinstance(value, StarSolution):
            if not value.ok:
                return np.full(9, np.nan), self.noise
            own = self._checked(value.covariance if covariance is None else covariance)
            return value.dcm_cam_from_icrs.flatten(), own
        q = numbers(self.name, value)
        if q.shape != (4,):
            raise ValueError(f"{self.name}: a quaternion (x, y, z, w) of v_sensor = R v_inertial; got shape {q.shape}")
        own = self.noise if covariance is None else self._checked(covariance)
        if not math.isfinite(sum(q.tolist())):
            return np.full(9, np.nan), own
        return dcm_from_quaternion(q, self.name).ravel(), own

    def _checked(self, covariance: ArrayLike) -> Matrix:
        own = numbers(f"{self.name}'s covariance", covariance)
        if own.shape != (3, 3):
            raise ValueError(f"{self.name}: a covariance (3, 3) rad^2 in sensor axes is expected; got {own.shape}")
        if not (_is_symmetric(own) and np.linalg.eigvalsh(own).min() > 0.0):
            raise ValueError(f"{self.name}: a covariance is symmetric and positive definite; got {own.tolist()}")
        return own.copy()

    def rows(self, at: Estimates, attitude: Vector, noise: Matrix) -> Rows:
        """Rows of an attitude (9,) at settled estimates, in memory that the next call writes anew."""
        rows, given = self._rows, (at.values, at.dcm_inertial_from_chaser, attitude, noise)
        attitude_rows_into(self._mounting, *given, rows.residual, rows.jacobian, rows.noise)
        return rows


class SunSensor(_Mounted):
    """A sensor of the direction to the sun."""

    most_rows = 2

    def __init__(self, vehicle: Vehicle, name: str, layout: StateLayout, filters: int) -> None:
        super().__init__(vehicle, name, layout, filters)
        self._epoch_s = vehicle.orbit.epoch_s
        self._nodes = (math.nan, np.zeros((4, 3)))

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
        direction = value.direction
        if own.shape != (3, 3) or direction.shape != (3,):
            raise ValueError(
                f"{self.name}: a direction (3,) and its covariance (3, 3) are expected; got shapes "
                f"{direction.shape} and {own.shape}"
            )
        if all(map(math.isfinite, direction.tolist())) and not _is_symmetric(own):
            raise ValueError(f"{self.name}: a covariance is finite and symmetric; got {own.tolist()}")
        return direction.copy(), own.copy()

    def sun(self, t_s: float) -> Vector:
        """Unit vector (3,) toward the sun, inertial, at a time of the log's clock: a cubic through four."""
        u, node = math.modf(t_s / SUN_NODES_S)
        if node != self._nodes[0]:
            times = SUN_NODES_S * (node + np.arange(-1.0, 3.0))
            self._nodes = node, sun_direction(self._epoch_s + times)
        direction = np.empty(3)
        between_into(self._nodes[1], u, direction)
        return direction

    def rows(self, at: Estimates, direction: Vector, covariance: Matrix) -> Rows:
        """Rows of a direction (3,), across the predicted one, at settled estimates; memory as that of `StarTracker`."""
        rows, given = self._rows, (at.values, at.dcm_inertial_from_chaser, direction, covariance)
        sun, variance = self.sun(at.t_s), EPHEMERIS_SIGMA_RAD**2
        sun_rows_into(self._mounting, sun, variance, *given, rows.residual, rows.jacobian, rows.noise)
        return rows
