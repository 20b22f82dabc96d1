"""The target's attitude and inertial rate from measured attitudes: a published filter, and its linearised form.

The paper is Liu, Xu, Xu (2013),
"Vision-based relative navigation for autonomous rendezvous and docking of spacecraft".
`method="unscented"` is the paper's reduced-order UKF (`estimation/unscented_attitude.py`); `method="multiplicative"` is
an extended Kalman filter of a small rotation vector. They differ in the prediction alone, and in the paper's case give
the same figures. Start, gate, restart and lasting errors are one: `step.py`.
"""

from __future__ import annotations

import copy
import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, number, numbers, one_piece
from relnav.dynamics.inertia_error import inertia_sigma
from relnav.dynamics.rigid_body import RigidBody
from relnav.estimation.gating import chi_square_limit
from relnav.estimation.innovation_sums import LIMIT_PROBABILITY
from relnav.geometry.linear_algebra import cholesky
from relnav.geometry.rotation import is_rotation
from relnav.navigation.arguments import not_negative
from relnav.navigation.attitude.inputs import ASYMMETRY, LARGEST_RAD2, LEAST_PIVOT
from relnav.navigation.attitude.prediction import MEMORY, REFUSED, advance, look
from relnav.navigation.attitude.record import NOT_COMPARED, NOT_KNOWN, AttitudeRecord
from relnav.navigation.attitude.step import use
from relnav.navigation.status import REJECTED, STARTED, UPDATED, WAITING

METHODS = ("multiplicative", "unscented")
TRIAL_PROBABILITY = 0.99
"""With which a good measured attitude agrees with a trial: a start is refused sooner than a measurement."""
_NOTHING = np.eye(3)


class TargetAttitude:
    """Attitude and inertial rate of the target, an epoch at a time.

    Two measured attitudes that agree start it. `copy.deepcopy` and `pickle` give a filter that continues from the same
    state, bit for bit; so does writing a kept copy of `memory` back into it.

    Attributes
    ----------
    memory : (1,)
        The complete state of the filter, of type `prediction.MEMORY`.
    """

    def __init__(
        self,
        inertia_kg_m2: ArrayLike,
        mean_motion_rad_s: float,
        *,
        rate_noise_density_rad2_s3: float,
        initial_rate_sigma_rad_s: float,
        gate_probability: float = 0.9999,
        method: str = "multiplicative",
        inertia_sigma_kg_m2: ArrayLike | None = None,
        chaser_attitude_sigma_rad: float = 0.0,
        restart_after: int = 8,
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
            1-sigma of the rate about that of a target held in `lvlh_ccsds`, each axis, > 0. It is no longer used once
            attitudes contradict it.
        gate_probability : float
            Probability that a correct measurement is accepted.
        method : {"multiplicative", "unscented"}
            Which filter.
        inertia_sigma_kg_m2 : (3, 3), optional
            1-sigma of each entry of the inertia, symmetric, >= 0: constant errors, considered in the covariance; what
            they do to the acceleration in second order is noise that lasts for a turn.
        chaser_attitude_sigma_rad : float
            1-sigma of the constant error of the chaser's attitude, each axis, >= 0. It is common to all measured
            attitudes and is not averaged out.
        restart_after : int
            Measured attitudes rejected in a row after which others that agree may replace the track, >= 1.

        Raises
        ------
        ValueError
            For values out of their range, or another method.
        """
        if method not in METHODS:
            raise ValueError(f'method must be "multiplicative" or "unscented"; got {method!r}')
        if not_negative("initial_rate_sigma_rad_s", initial_rate_sigma_rad_s) == 0.0:
            raise ValueError(f"initial_rate_sigma_rad_s must be > 0 and finite; got {initial_rate_sigma_rad_s!r}")
        not_negative("rate_noise_density_rad2_s3", rate_noise_density_rad2_s3)
        if not 1.0 <= number("restart_after", restart_after) < 2**31:
            raise ValueError(f"restart_after must be 1 or more; got {restart_after!r}")
        inertia = numbers("inertia_kg_m2", inertia_kg_m2)
        self.body, self.method = RigidBody(inertia, number("mean_motion_rad_s", mean_motion_rad_s)), method
        self.memory = np.zeros(1, MEMORY)
        self._chaser_sigma = not_negative("chaser_attitude_sigma_rad", chaser_attitude_sigma_rad)
        m = self.memory[0]
        m["body"], m["density"] = self.body.matrix, rate_noise_density_rad2_s3
        m["rate_sigma"], m["trial_gate"] = initial_rate_sigma_rad_s, chi_square_limit(TRIAL_PROBABILITY, 3)
        m["gate"] = chi_square_limit(number("gate_probability", gate_probability), 3)
        m["sum_limit"] = chi_square_limit(LIMIT_PROBABILITY, 3)
        m["chaser_sigma"], m["restart_after"] = chaser_attitude_sigma_rad, restart_after
        m["unscented"] = method == "unscented"
        if inertia_sigma_kg_m2 is not None:
            sigma = inertia_sigma(inertia_sigma_kg_m2)
            m["inertia_sigma"], m["inertia_off"] = sigma, bool(sigma.any())
        m["t"] = m["measured_t"] = math.nan

    def __copy__(self) -> TargetAttitude:
        """One that goes on by itself, as `copy.deepcopy` gives: what two share each of them would change."""
        return copy.deepcopy(self)

    @property
    def last_t_s(self) -> float:
        """Time of the last epoch; NaN before the first."""
        return float(self.memory[0]["t"])

    def step(
        self,
        t_s: float,
        dcm_lvlh_from_target: ArrayLike | None = None,
        covariance_rad2: ArrayLike | None = None,
        *,
        dcm_chaser_from_lvlh: ArrayLike | None = None,
    ) -> AttitudeRecord:
        """Propagate to t_s, and process the attitude measured then, if any.

        Parameters
        ----------
        t_s : float
            Not before the last epoch.
        dcm_lvlh_from_target : (3, 3), optional
            Measured attitude: chaser attitude times camera mounting times measured relative attitude. NaN = none.
        covariance_rad2 : (3, 3)
            Of its rotation vector, target axes: of the noise of the vision and of the chaser's own attitude together,
            without constant errors.
        dcm_chaser_from_lvlh : (3, 3), optional
            The chaser's attitude that was used; needed where `chaser_attitude_sigma_rad` is not zero.

        Raises
        ------
        ValueError
            For a time that goes back, a measurement that is no rotation or has no covariance, or a chaser's attitude
            that is missing or no rotation. The filter is then unchanged.
        """
        t = number("t_s", t_s)
        compared = dcm_lvlh_from_target is not None
        if dcm_lvlh_from_target is None:
            self._check_time(t)
            status = advance(self.memory, t)
        else:
            status, compared = self._used(t, dcm_lvlh_from_target, covariance_rad2, dcm_chaser_from_lvlh)
        return AttitudeRecord(
            t,
            status,
            status in (UPDATED, STARTED),
            int(self.memory["rejections"][0]) if status == REJECTED else 0,
            self.memory["track"].tobytes() if status != WAITING else NOT_KNOWN,
            self.memory["compared"].tobytes() if compared else NOT_COMPARED,
            self.body.mean_motion_rad_s,
            self._chaser_sigma,
        )

    def _used(
        self, t: float, dcm: ArrayLike, covariance: ArrayLike | None, dcm_chaser: ArrayLike | None
    ) -> tuple[int, bool]:
        """Go on to t and use a measured attitude: the status, and whether a track was compared."""
        status, chaser = REFUSED, _NOTHING
        if covariance is not None and (dcm_chaser is not None or self._chaser_sigma == 0.0):
            measured, noise = one_piece("dcm_lvlh_from_target", dcm), one_piece("covariance_rad2", covariance)
            if dcm_chaser is not None:
                chaser = one_piece("dcm_chaser_from_lvlh", dcm_chaser)
            if measured.ndim == noise.ndim == chaser.ndim == 2:
                status = look(self.memory, t, measured, noise, chaser, False, np.empty((6, 3)))
        if status == REFUSED:  # what is wrong is said here, or nothing was measured
            self._check_time(t)
            attitude = _attitude(dcm)
            if attitude is None:
                return advance(self.memory, t), False
            measured, noise, chaser = attitude, _covariance(covariance), self._chaser(dcm_chaser)
            status = look(self.memory, t, measured, noise, chaser, True, np.empty((6, 3)))
        return (status, True) if status == UPDATED else use(self.memory, measured, chaser)

    def _check_time(self, t: float) -> None:
        if not math.isfinite(t) or t < self.last_t_s:
            raise ValueError(f"t_s must be finite and not before the last epoch, {self.last_t_s!r}; got {t!r}")

    def _chaser(self, dcm: ArrayLike | None) -> Matrix:
        if dcm is None:
            if self._chaser_sigma > 0.0:
                raise ValueError(
                    "with chaser_attitude_sigma_rad above zero a measured attitude comes with dcm_chaser_from_lvlh"
                )
            return _NOTHING
        chaser = np.array(numbers("dcm_chaser_from_lvlh", dcm), order="C")
        if not is_rotation(chaser):
            raise ValueError(f"dcm_chaser_from_lvlh must be a rotation matrix (3, 3); got {chaser.tolist()}")
        return chaser


def _attitude(dcm: ArrayLike) -> Matrix | None:
    """A measured attitude; None where it is NaN: nothing was measured."""
    measured = np.array(numbers("dcm_lvlh_from_target", dcm), order="C")
    if measured.shape != (3, 3):
        raise ValueError(f"dcm_lvlh_from_target has shape (3, 3); got {measured.shape}")
    if not is_rotation(measured):
        if not np.isfinite(measured).all():
            return None
        raise ValueError(f"dcm_lvlh_from_target must be a rotation matrix; got {measured.tolist()}")
    return measured


def _covariance(covariance: ArrayLike | None) -> Matrix:
    """The covariance of a measured attitude, symmetric to the last bit."""
    if covariance is None:
        raise ValueError(
            "covariance_rad2 is missing: the positive definite covariance (3, 3) of the measurement, rad^2"
        )
    noise = np.array(numbers("covariance_rad2", covariance), order="C")
    if noise.shape != (3, 3):
        raise ValueError(f"covariance_rad2 has shape (3, 3), rad^2; got {noise.shape}")
    if (np.abs(noise) > LARGEST_RAD2).any():
        raise ValueError(f"covariance_rad2 is in rad^2, finite and below {LARGEST_RAD2:g}; got {noise.tolist()}")
    symmetric = 0.5 * (noise + noise.T)
    if not (np.abs(noise - noise.T) <= ASYMMETRY * np.abs(symmetric).max()).all():
        raise ValueError(f"covariance_rad2 must be finite and symmetric, to 1e-9; got {noise.tolist()}")
    if not cholesky(symmetric, LEAST_PIVOT, noise):
        raise ValueError(f"covariance_rad2 must be a positive definite covariance, to 1e-12; got {symmetric.tolist()}")
    return symmetric
