"""What filtering gains on the target's attitude: errors, consistency and cost of both filters on one truth."""

import math
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Matrix
from relnav.estimation.consistency import nees
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.mission import Orbit
from relnav.navigation.attitude.target_attitude import TargetAttitude
from relnav.simulation.target_rotation import rotate_target

SETTLED = 0.5
"""Share of a run that is left out: settling."""
RATES_RAD_S = math.radians(0.3)
"""1-sigma of the target's true rate, each axis."""


@dataclass(frozen=True)
class AttitudeTrials:
    """Figures over settled epochs of all runs.

    Attributes
    ----------
    raw_rms_rad, attitude_rms_rad, rate_rms_rad_s : float
        Of one axis: the measurements, the filter.
    sigma_rad, sigma_rate_rad_s : float
        What the filter reports at the end.
    nees_ratio, nis_ratio : float
        Mean NEES / 6 and NIS / 3.
    step_s : float
        Time of one step, of the fastest run: what was compiled on the way does not count.
    """

    raw_rms_rad: float
    attitude_rms_rad: float
    rate_rms_rad_s: float
    sigma_rad: float
    sigma_rate_rad_s: float
    nees_ratio: float
    nis_ratio: float
    step_s: float

    @property
    def gain(self) -> float:
        """Raw error over filtered error."""
        return self.raw_rms_rad / self.attitude_rms_rad


def attitude_trials(
    inertia_kg_m2: Matrix,
    mean_motion_rad_s: float,
    *,
    sigma_rad: float,
    rate_hz: float,
    density_rad2_s3: float,
    runs: int,
    duration_s: float,
    seed: int,
    method: str = "multiplicative",
) -> AttitudeTrials:
    """Filter noisy attitudes (1-sigma sigma_rad, each axis) of targets that turn slowly."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration_s, 1.0 / rate_hz)
    start = Rotation.from_rotvec(math.radians(10.0) * rng.normal(size=(runs, 3)))
    rates = RATES_RAD_S * rng.normal(size=(runs, 3))
    truth, true_rate = rotate_target(
        t, start.as_quat(), rates, inertia_kg_m2, Orbit(mean_motion_rad_s), density_rad2_s3, rng
    )
    first = round(SETTLED * len(t))
    raw, errors, covariances, nis, fastest_s = [], [], [], [], math.inf
    noise = sigma_rad**2 * np.eye(3)
    for run in range(runs):
        nav = TargetAttitude(
            inertia_kg_m2,
            mean_motion_rad_s,
            rate_noise_density_rad2_s3=density_rad2_s3,
            initial_rate_sigma_rad_s=2.0 * RATES_RAD_S,
            gate_probability=1.0 - 1e-9,
            method=method,
        )
        off = sigma_rad * rng.normal(size=(len(t), 3))
        seen = truth[:, run] @ Rotation.from_rotvec(off).as_matrix()
        begin = perf_counter()
        records = [nav.step(now, dcm, noise) for now, dcm in zip(t, seen, strict=True)]
        fastest_s = min(fastest_s, perf_counter() - begin)
        for k in range(first, len(t)):
            record = records[k]
            turn = rotation_vector_between(truth[k, run], record.dcm_lvlh_from_target)
            errors.append(np.concatenate([turn, true_rate[k, run] - record.rate_rad_s]))
            covariances.append(record.covariance)
            nis.append(record.nis)
            raw.append(off[k])
    e, P = np.array(errors), np.array(covariances)
    last = np.diag(P[-1])
    return AttitudeTrials(
        raw_rms_rad=float(np.sqrt(np.mean(np.square(raw)))),
        attitude_rms_rad=float(np.sqrt(np.mean(e[:, :3] ** 2))),
        rate_rms_rad_s=float(np.sqrt(np.mean(e[:, 3:] ** 2))),
        sigma_rad=float(np.sqrt(last[:3].mean())),
        sigma_rate_rad_s=float(np.sqrt(last[3:].mean())),
        nees_ratio=float(np.mean(nees(e, P))) / 6.0,
        nis_ratio=float(np.mean(nis)) / 3.0,
        step_s=fastest_s / len(t),
    )
