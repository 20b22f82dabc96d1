"""What filtering makes of three-marker vision: the paper's UKF beside the default, and the pose filter."""

import math

import numpy as np

from relnav.accuracy.claims import ClaimRow, claim_row, information
from relnav.accuracy.pose_filter import flown
from relnav.accuracy.published import Published
from relnav.accuracy.target_attitude import AttitudeTrials, attitude_trials
from relnav.estimation.attitude import settled_sigmas
from relnav.mission import VisionMission
from relnav.simulation.marker_flight import MarkerFaults
from relnav.simulation.trajectory import Approach

UKF = "target attitude, reduced-order UKF as published"
MEKF = "target attitude, multiplicative EKF"
POSE = "pose filter on the spots"
RAW_SIGMA_DEG, RATE_HZ, DURATION_S = 0.5, 10.0, 200.0
NEAR = Approach(60.0, 10.0, start_m=(6.8, 0.25, -0.15), final_range_m=2.5, speed_m_s=0.1, assumed_noise=True)
COST = "time of a step over the EKF's"
_SETTLED_S = 20.0
_CLAIM = "filtered over raw attitude error"
_MEMORY_S = 40.0
"""Errors this far apart count as independent: the filter's own memory, (sigma^2 dt / q)^(1/4)."""


def filter_rows(model: VisionMission, published: Published, flights: int, seed: int) -> list[ClaimRow]:
    """Rows of both attitude filters on the same truths, with what they cost, and of the pose filter."""
    claims = {claim.quantity: claim for claim in published.claims}
    sigma, density = math.radians(RAW_SIGMA_DEG), model.target.rate_noise_density_rad2_s3
    where = f"{RAW_SIGMA_DEG:g} deg raw, {RATE_HZ:g} Hz"
    trials = {
        name: attitude_trials(
            np.array(model.target.inertia_kg_m2),
            model.orbit.mean_motion_rad_s,
            sigma_rad=sigma,
            rate_hz=RATE_HZ,
            density_rad2_s3=density,
            runs=flights,
            duration_s=DURATION_S,
            seed=seed,
            method=method,
        )
        for method, name in (("unscented", UKF), ("multiplicative", MEKF))
    }
    rows: list[ClaimRow] = []
    settled = settled_sigmas(sigma, 1.0 / RATE_HZ, density)
    for name, of in trials.items():
        if _CLAIM in claims:
            rows.append(claim_row(claims[_CLAIM], published, name, 1.0 / of.gain))
        rows.extend(_attitude_rows(name, where, of, flights, settled))
        if name == UKF:
            ratio = of.step_s / trials[MEKF].step_s
            rows.append(information(COST, UKF, "on this machine, for information", ratio, "ratio", "fastest run"))
    return rows + _pose_rows(model, flights, seed)


def _attitude_rows(
    name: str, where: str, trials: AttitudeTrials, flights: int, settled: tuple[float, float]
) -> list[ClaimRow]:
    independent = 6.0 * flights * max(1.0, 0.5 * DURATION_S / _MEMORY_S)
    allowed = 0.2 + 3.0 * math.sqrt(2.0 / independent)
    nees, nis = trials.nees_ratio, trials.nis_ratio
    return [
        information("gain over the raw attitude", name, where, trials.gain, "ratio", "rms over rms"),
        information("attitude error", name, where, trials.attitude_rms_rad, "deg", "rms, each axis"),
        information("attitude sigma", name, where, trials.sigma_rad, "deg", "reported, each axis"),
        information("attitude sigma", name, "closed form of the steady state", settled[0], "deg", "each axis"),
        information(
            "NEES over 6",
            name,
            f"consistent: 1 +- {allowed:.2f}",
            nees,
            "ratio",
            "mean",
            met=abs(nees - 1.0) <= allowed,
        ),
        information("NIS over 3", name, "consistent: 1 +- 0.05", nis, "ratio", "mean", met=abs(nis - 1.0) <= 0.05),
    ]


def _pose_rows(model: VisionMission, flights: int, seed: int) -> list[ClaimRow]:
    errors = flown(model, NEAR, MarkerFaults(), flights, seed)
    settled = errors.where((errors.t_s > _SETTLED_S) & (errors.range_m < 7.0))
    where = f"below 7 m, {NEAR.rate_hz:g} Hz"
    if len(settled.t_s) == 0:
        return []
    return [
        information("position error", POSE, where, settled.position_rms_m, "m", "rms"),
        information("attitude error", POSE, where, settled.attitude_rms_rad, "deg", "rms"),
        information("NEES over 12", POSE, f"{where}, {flights} flights", settled.nees_ratio, "ratio", "mean"),
        information("NIS over its dof", POSE, where, float(np.nanmean(settled.nis_ratio)), "ratio", "mean"),
    ]
