"""Many simulated approaches through every way of filtering them: errors, reported sigmas, NEES."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.estimation.consistency import Consistency, consistency_of_sum
from relnav.mission import Attitude, Model
from relnav.navigation.docking_view import views
from relnav.navigation.log import filter_epochs
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import SimulatedLog, simulate
from relnav.simulation.trajectory import Approach

SEED_STRIDE = 1_000_003
"""Between the generators of a seed's first run and the next seed's."""


@dataclass(frozen=True)
class Way:
    """One way of filtering: method, closed form, whether the attitude is known, whether smoothed."""

    method: str
    projection: str = "perspective"
    attitude_known: bool = True
    smooth: bool = False

    @property
    def name(self) -> str:
        """Name in reports."""
        parts = ["parallel form" if self.projection == "parallel" else ""]
        parts += ["" if self.attitude_known else "attitude unknown", "smoothed" if self.smooth else ""]
        return ", ".join([f"{self.method} filter", *(part for part in parts if part)])


WAYS = tuple(
    dataclasses.replace(way, smooth=smooth)
    for way in (Way("fix"), Way("spots"), Way("spots", attitude_known=False), Way("fix", projection="parallel"))
    for smooth in (False, True)
)


@dataclass(frozen=True)
class Outcome:
    """Errors of one way over all runs.

    Attributes
    ----------
    docking_error, docking_sigma : (runs, n, 3)
        Range m, azimuth rad, elevation rad: estimate minus truth, and reported 1-sigma.
    nees : (runs, n)
        Of the six-component state.
    nis : Consistency
        NIS over degrees of freedom, all epochs that were used whole, with its interval.
    """

    docking_error: Stack
    docking_sigma: Stack
    nees: Matrix
    nis: Consistency


def noise_alone(model: Model, method: str) -> Model:
    """The model as published figures are meant, of noise alone: `spots` believe the attitude that they are given."""
    if method != "spots":
        return model
    return dataclasses.replace(model, attitude=dataclasses.replace(model.attitude, sigma_rad=0.0, noise_rad=0.0))


def filtered(model: Model, log: SimulatedLog, way: Way) -> tuple[Matrix, Matrix, Vector, float, int]:
    """Docking error (n, 3), docking sigma (n, 3), NEES (n,), NIS sum and dof of one log."""
    mission = noise_alone(model, way.method)
    if not way.attitude_known:
        mission = dataclasses.replace(model, attitude=Attitude("unknown", model.attitude.q_cam_from_lvlh))
    solution = filter_epochs(
        mission,
        log.t_s,
        log.spots_m,
        acceleration_m_s2=log.acceleration_m_s2,
        method=way.method,
        projection=way.projection,
        smooth=way.smooth,
    )
    lever = model.dcm_cam_from_lvlh.T @ model.camera_lever_cam_m
    no_factors = np.zeros((len(log.t_s), 21))
    truth = views(log.truth, no_factors, model.dcm_dock_from_lvlh, model.port_position_m, lever[None])[:3].T
    error = solution.state - log.truth
    known = np.isfinite(error).all(axis=1)
    nees = np.full(len(error), np.nan)
    covariance = solution.covariance[known]
    nees[known] = np.einsum("ni,ni->n", error[known], np.linalg.solve(covariance, error[known][..., None])[..., 0])
    used = solution.accepted & np.isfinite(solution.nis)
    return (
        solution.docking - truth,
        solution.docking_sigma,
        nees,
        float(solution.nis[used].sum()),
        int(solution.dof[used].sum()),
    )


def run_campaign(
    model: Model,
    approach: Approach,
    ways: tuple[Way, ...],
    runs: int,
    seed: int,
    faults: Faults | None = None,
    progress: Callable[[int], None] | None = None,
) -> tuple[Vector, dict[Way, Outcome]]:
    """Fly `runs` approaches, each with a seed of its own, and filter each in every way.

    Returns
    -------
    True ranges (runs, n) m, and the outcome of each way.

    Raises
    ------
    ValueError
        For so many runs that those of the next seed would repeat them (`campaign_plan` has no such limit).
    """
    if runs > SEED_STRIDE:
        raise ValueError(f"runs must be {SEED_STRIDE} or fewer, as seeds lie so far apart; got {runs}")
    ranges: list[Vector] = []
    collected: dict[Way, list[tuple[Matrix, Matrix, Vector, float, int]]] = {way: [] for way in ways}
    for run in range(runs):
        log = simulate(model, approach, faults, seed=seed * SEED_STRIDE + run)
        camera = log.truth[:, :3] + model.dcm_cam_from_lvlh.T @ model.camera_lever_cam_m - model.port_position_m
        ranges.append(np.linalg.norm(camera, axis=1))
        for way in ways:
            collected[way].append(filtered(model, log, way))
        if progress is not None:
            progress(1)
    outcomes = {}
    for way, parts in collected.items():
        error, sigma, nees, nis, dof = zip(*parts, strict=True)
        consistency = consistency_of_sum("NIS", sum(nis), sum(dof), lasting=bool(model.considered))
        outcomes[way] = Outcome(np.array(error), np.array(sigma), np.array(nees), consistency)
    return np.array(ranges), outcomes
