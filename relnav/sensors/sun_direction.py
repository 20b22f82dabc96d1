"""How a sun sensor is mounted, what it returns, and the attitude observation that a filter makes of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, number, numbers
from relnav.codegen.kernel import plain
from relnav.geometry.linear_algebra import cross_matrix, tangent_basis_into
from relnav.geometry.rotation import dcm_from_quaternion, rotation
from relnav.sensors.measurement import Status


@dataclass(frozen=True)
class SunDirection:
    """Direction of the sun from one image.

    Attributes
    ----------
    direction : (3,)
        Unit vector toward the sun, in sensor axes (z boresight) unless `turned`; NaN unless `status` is OK.
    covariance : (3, 3)
        Of `direction`, rank 2: it is zero along the direction itself. NaN unless `status` is OK.
    status : Status
        Why there is no value, if there is none.
    """

    direction: Vector
    covariance: Matrix
    status: Status

    @property
    def ok(self) -> bool:
        """Whether value and covariance can be used."""
        return self.status is Status.OK

    @property
    def alpha_rad(self) -> float:
        """Projection angle, tan(alpha) = s_x / s_z."""
        return float(np.arctan2(self.direction[0], self.direction[2]))

    @property
    def beta_rad(self) -> float:
        """Projection angle, tan(beta) = s_y / s_z."""
        return float(np.arctan2(self.direction[1], self.direction[2]))

    @property
    def sigma_rad(self) -> float:
        """Root mean square of the two 1-sigma errors across the direction."""
        return float(np.sqrt(0.5 * np.trace(self.covariance)))

    def turned(self, dcm_b_from_a: ArrayLike) -> SunDirection:
        """The same in other axes, v_b = dcm @ v_a: the body's with the mounting, inertial ones with the attitude."""
        dcm = rotation("dcm_b_from_a", dcm_b_from_a)
        return replace(self, direction=_fixed(dcm @ self.direction), covariance=_fixed(dcm @ self.covariance @ dcm.T))


@dataclass(frozen=True)
class Mounting:
    """How the sensor sits in the chaser: v_body = R v_sensor, scalar last."""

    q_body_from_sensor: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        dcm_from_quaternion(np.array(self.q_body_from_sensor))

    @property
    def dcm_body_from_sensor(self) -> Matrix:
        """v_body = dcm @ v_sensor, (3, 3)."""
        return dcm_from_quaternion(np.array(self.q_body_from_sensor))


@dataclass(frozen=True)
class AttitudeObservation:
    """Two numbers about the attitude, ready for a measurement update.

    Attributes
    ----------
    innovation : (2,)
        Measured minus predicted, rad, across the predicted direction.
    jacobian : (2, 3)
        d(measured)/d(attitude error), the error being theta of dcm_body_true = exp(-[theta x]) dcm_body_predicted, as
        everywhere (`relnav.geometry.rotation_vector`). Rank 2: a rotation about the sun line is not observable.
    covariance : (2, 2)
        Of the innovation's noise, full rank.
    """

    innovation: Vector
    jacobian: Matrix
    covariance: Matrix


def attitude_observation(
    measured_body: SunDirection,
    sun_inertial: ArrayLike,
    dcm_body_from_inertial: ArrayLike,
    *,
    sun_sigma_rad: float = 0.0,
) -> AttitudeObservation:
    """Make an attitude observation of a sun direction in body axes.

    Parameters
    ----------
    measured_body : SunDirection
        In body axes: `measured.turned(model.mounting.dcm_body_from_sensor)`.
    sun_inertial : (3,)
        Direction of the sun by the ephemeris, unit vector (`relnav.dynamics.ephemeris.sun_direction`).
    dcm_body_from_inertial : (3, 3)
        Predicted attitude.
    sun_sigma_rad : float
        1-sigma of the ephemeris on each axis.

    Raises
    ------
    ValueError
        If the measurement has no value (its status says why), `sun_inertial` is not a unit vector, the attitude is not
        a rotation, or the sigma is invalid.
    """
    sun = numbers("sun_inertial", sun_inertial)
    sigma = number("sun_sigma_rad", sun_sigma_rad)
    if sun.shape != (3,) or not (np.abs(sun) < 2.0).all() or abs(np.linalg.norm(sun) - 1.0) > 1e-6:
        raise ValueError(f"sun_inertial is a unit vector (3,); got {sun.tolist()}")
    dcm = rotation("dcm_body_from_inertial", dcm_body_from_inertial)
    if not 0.0 <= sigma <= np.pi:
        raise ValueError(f"sun_sigma_rad is an angle in radians, 0 or more; got {sun_sigma_rad!r}")
    if not measured_body.ok:
        raise ValueError(f"no observation without a measurement; its status is {measured_body.status.name}")
    predicted = dcm @ sun
    basis = tangent_basis(predicted)
    return AttitudeObservation(
        innovation=basis.T @ measured_body.direction,
        jacobian=basis.T @ cross_matrix(predicted),
        covariance=basis.T @ measured_body.covariance @ basis + sigma**2 * np.eye(2),
    )


def tangent_basis(s: Vector) -> Matrix:
    """Two unit vectors, columns of (3, 2), that make a right-handed triad with the unit vector s (3,) as third."""
    basis = np.empty((3, 2))
    plain(tangent_basis_into)(s, basis)
    return basis


def no_direction(status: Status) -> SunDirection:
    """A measurement without a value."""
    return SunDirection(_fixed(np.full(3, np.nan)), _fixed(np.full((3, 3), np.nan)), status)


def direction_with_covariance(direction: Vector, covariance: Matrix) -> SunDirection:
    """A measurement with a value, its arrays made read-only."""
    return SunDirection(_fixed(direction), _fixed(covariance), Status.OK)


def _fixed(array: Matrix) -> Matrix:
    array.setflags(write=False)
    return array
