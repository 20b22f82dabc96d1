"""The target's attitude and inertial rate from measured attitudes: a published filter, and a cheaper default.

The paper is Liu, Xu, Xu (2013),
"Vision-based relative navigation for autonomous rendezvous and docking of spacecraft".
`method="multiplicative"` is an extended Kalman filter of a small rotation vector; `method="unscented"` is the paper's
reduced-order UKF of Euler angles. In the paper's case both give the same figures; the UKF costs some ten times more.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector
from relnav.dynamics.rigid_body import RigidBody, lvlh_rate
from relnav.estimation.attitude import attitude_update
from relnav.estimation.gating import chi_square_limit
from relnav.estimation.unscented_attitude import UnscentedAttitude
from relnav.geometry.rotation import is_rotation
from relnav.geometry.rotation_vector import rotation_vector_between

METHODS = ("multiplicative", "unscented")


@dataclass(frozen=True)
class AttitudeRecord:
    """The target's rotation after one epoch.

    Attributes
    ----------
    t_s : float
    dcm_lvlh_from_target : (3, 3)
    rate_rad_s : (3,)
        Inertial, target axes.
    covariance : (6, 6)
        Of (attitude error in target axes, rad; rate, rad/s): the true attitude is dcm exp([error x]). NaN with the rest
        before the first measurement.
    innovation_rad, innovation_covariance : (3,), (3, 3)
        Of a measured attitude before its use; NaN where nothing was measured.
    nis : float
        Of the innovation, before the gate; NaN where there is none.
    dof : int
        3, or 0 where nothing was measured.
    accepted : bool
        Whether it was used.
    """

    t_s: float
    dcm_lvlh_from_target: Matrix
    rate_rad_s: Vector
    covariance: Matrix
    innovation_rad: Vector
    innovation_covariance: Matrix
    nis: float
    dof: int
    accepted: bool


class TargetAttitude:
    """Attitude and inertial rate of the target, an epoch at a time."""

    def __init__(
        self,
        inertia_kg_m2: ArrayLike,
        mean_motion_rad_s: float,
        *,
        rate_noise_density_rad2_s3: float,
        initial_rate_sigma_rad_s: float,
        gate_probability: float = 0.9999,
        method: str = "multiplicative",
    ) -> None:
        """Describe the body and what is not known of its motion.

        Parameters
        ----------
        inertia_kg_m2 : (3, 3)
            In target axes.
        mean_motion_rad_s : float
            Of the circular orbit.
        rate_noise_density_rad2_s3 : float
            Density of white angular acceleration, each axis, >= 0.
        initial_rate_sigma_rad_s : float
            1-sigma of the rate about that of a target held in `lvlh_ccsds`, each axis, > 0.
        gate_probability : float
            With which a good measurement is used.
        method : {"multiplicative", "unscented"}
            Which filter.

        Raises
        ------
        ValueError
            For values out of their range, or another method.
        """
        if method not in METHODS:
            raise ValueError(f'method must be "multiplicative" or "unscented"; got {method!r}')
        if not (math.isfinite(rate_noise_density_rad2_s3) and rate_noise_density_rad2_s3 >= 0.0):
            raise ValueError(f"rate_noise_density_rad2_s3 must be >= 0 and finite; got {rate_noise_density_rad2_s3!r}")
        if not (math.isfinite(initial_rate_sigma_rad_s) and initial_rate_sigma_rad_s > 0.0):
            raise ValueError(f"initial_rate_sigma_rad_s must be > 0 and finite; got {initial_rate_sigma_rad_s!r}")
        self.body = RigidBody(np.asarray(inertia_kg_m2), mean_motion_rad_s)
        self.method = method
        self._density, self._rate_sigma = rate_noise_density_rad2_s3, initial_rate_sigma_rad_s
        self._limit = chi_square_limit(gate_probability, 3)
        self._t = math.nan
        self._dcm, self._rate, self._covariance = np.full((3, 3), np.nan), np.full(3, np.nan), np.full((6, 6), np.nan)
        self._unscented: UnscentedAttitude | None = None

    def step(
        self, t_s: float, dcm_lvlh_from_target: ArrayLike | None = None, covariance_rad2: ArrayLike | None = None
    ) -> AttitudeRecord:
        """Go on to t_s and use the attitude measured there, if one was.

        Parameters
        ----------
        t_s : float
            Not before the last epoch.
        dcm_lvlh_from_target : (3, 3), optional
            Measured attitude: chaser attitude times camera mounting times measured relative attitude. NaN = none.
        covariance_rad2 : (3, 3)
            Of its rotation vector, target axes: of the vision and of the chaser's own attitude together.

        Raises
        ------
        ValueError
            For a time that goes back, or a measurement that is no rotation or has no covariance.
        """
        if not math.isfinite(t_s) or t_s < self._t:
            raise ValueError(f"t_s must be finite and not before the last epoch, {self._t!r}; got {t_s!r}")
        measured, noise = _checked(dcm_lvlh_from_target, covariance_rad2)
        started = math.isfinite(self._t)
        if started and t_s > self._t:
            self._predict(t_s - self._t)
        if started or measured is not None:
            self._t = t_s
        innovation, spread, nis, accepted = np.full(3, np.nan), np.full((3, 3), np.nan), math.nan, False
        if measured is not None and noise is not None:
            if not started:
                accepted = True
                self._start(measured, noise)
            else:
                innovation = rotation_vector_between(measured, self._dcm)
                spread = self._covariance[:3, :3] + noise
                nis = float(innovation @ np.linalg.solve(spread, innovation))
                accepted = nis <= self._limit
                if accepted:
                    self._update(measured, noise)
        return AttitudeRecord(
            t_s,
            self._dcm.copy(),
            self._rate.copy(),
            self._covariance.copy(),
            innovation,
            spread,
            nis,
            3 if math.isfinite(nis) else 0,
            accepted,
        )

    def _start(self, measured: Matrix, noise: Matrix) -> None:
        self._dcm, self._rate = measured, lvlh_rate(measured, self.body.mean_motion_rad_s)
        self._covariance = np.zeros((6, 6))
        self._covariance[:3, :3] = noise
        self._covariance[3:, 3:] = self._rate_sigma**2 * np.eye(3)
        if self.method == "unscented":
            self._unscented = UnscentedAttitude(self._dcm, self._rate, self._covariance, self.body.propagate)

    def _predict(self, dt_s: float) -> None:
        dcm, rate, phi, noise = self.body.propagate_with_errors(self._dcm, self._rate, dt_s, self._density)
        if self._unscented is None:
            self._dcm, self._rate, self._covariance = dcm, rate, phi @ self._covariance @ phi.T + noise
        else:
            self._unscented.time_update(dt_s, noise)
            self._read(self._unscented)

    def _update(self, measured: Matrix, noise: Matrix) -> None:
        if self._unscented is None:
            self._dcm, self._rate, self._covariance = attitude_update(
                self._dcm, self._rate, self._covariance, measured, noise
            )
        else:
            self._unscented.measurement_update(measured, noise)
            self._read(self._unscented)

    def _read(self, unscented: UnscentedAttitude) -> None:
        self._dcm, self._rate, self._covariance = unscented.dcm, unscented.rate, unscented.covariance


def _checked(dcm: ArrayLike | None, covariance: ArrayLike | None) -> tuple[Matrix | None, Matrix | None]:
    """The measurement as arrays; None where there is none."""
    if dcm is None:
        return None, None
    measured = np.array(dcm, dtype=np.float64)
    if measured.shape != (3, 3):
        raise ValueError(f"dcm_lvlh_from_target has shape (3, 3); got {measured.shape}")
    if not np.isfinite(measured).all():
        return None, None
    if not is_rotation(measured):
        raise ValueError("dcm_lvlh_from_target must be a rotation matrix")
    noise = np.full((3, 3), np.nan) if covariance is None else np.array(covariance, dtype=np.float64)
    if noise.shape != (3, 3) or not np.isfinite(noise).all() or not np.linalg.eigvalsh(noise)[0] > 0.0:
        raise ValueError("covariance_rad2 is the positive definite covariance (3, 3) of the measured attitude, rad^2")
    return measured, noise
