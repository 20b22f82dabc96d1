"""Simulated frames through a star sensor: which are solved, which wrongly, with what error and what covariance."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Vector
from relnav.geometry.rotation_vector import attitude_error
from relnav.geometry.star_places import LIGHT_KM_S, aberration
from relnav.sensors.dual_field.four_primaries import FourSky, build_four_sky, identify_patent
from relnav.sensors.dual_field.measure import measure
from relnav.sensors.dual_field.optics import plane_points, ray_sigma, rays
from relnav.sensors.dual_field.prediction import attitude_sigma
from relnav.sensors.dual_field.sensor import Fold, StarSensor
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator, random_velocity

WRONG_SIGMA = 10.0
"""An attitude farther from truth than this many of its own sigmas is wrong."""

LEAST_IN_FIELD = 3
"""True stars in each of two fields with which a frame should be solved: one tells the fold's error, two more that it is
no chance."""


@dataclass(frozen=True)
class FieldRuns:
    """What came of a number of frames.

    Attributes
    ----------
    frames, solved, solvable, missed, wrong : int
        All, those with an attitude, those with four or more true stars (of two fields: `LEAST_IN_FIELD` in each), those
        of them without an attitude, those with a wrong one.
    rms_rad, predicted_rad : (3,)
        Error about camera x, y, z, and what the closed form says for the mean numbers of stars.
    nees : float
        Mean of e^T P^-1 e; 3 for an honest covariance.
    stars : float
        Mean number of matched stars.
    sigma_rad : float
        Of a spot at the centre.
    worst_log10_false_alarm : float
        Largest bound among the accepted frames.
    wrong_stars, true_stars : int
        Spots given another star than theirs, and spots of stars, in solved frames.
    """

    frames: int
    solved: int
    solvable: int
    missed: int
    wrong: int
    rms_rad: Vector
    predicted_rad: Vector
    nees: float
    stars: float
    sigma_rad: float
    worst_log10_false_alarm: float
    wrong_stars: int
    true_stars: int


def fly_frames(
    sensor: StarSensor,
    conditions: SkyConditions,
    frames: int,
    seed: int,
    *,
    two_fields: bool,
    progress: Callable[[int], None] | None = None,
) -> FieldRuns:
    """Simulate and solve frames of the sensor as it is, or of its lens without the fold.

    Every frame is one of another sensor, whose fold has its own error of the stated size.
    """
    used = sensor if two_fields else single_field(sensor, conditions)
    simulator, rng = StarFieldSimulator(used, conditions), np.random.default_rng(seed)
    errors, nees, stars, worst = [], [], [], -math.inf
    solvable = missed = wrong = wrong_stars = true_stars = 0
    for _ in range(frames):
        simulator.mount(rng)
        frame = simulator.frame(rng, velocity_km_s=random_velocity(rng))
        solution = measure(frame.spots_px, used, magnitude=frame.magnitude, velocity_km_s=frame.velocity_km_s)
        in_fields = [int(np.sum(frame.field == f)) for f in range(2 if used.fold.kind != "none" else 1)]
        enough = sum(in_fields) >= 4 and (len(in_fields) == 1 or min(in_fields) >= LEAST_IN_FIELD)
        solvable += enough
        missed += enough and not solution.ok
        if progress is not None:
            progress(1)
        if not solution.ok:
            continue
        e = attitude_error(solution.dcm_cam_from_icrs, frame.dcm_cam_from_icrs)
        value = float(e @ np.linalg.solve(solution.covariance, e))
        far = np.trace(solution.dcm_cam_from_icrs @ frame.dcm_cam_from_icrs.T) < 2.99
        worst = max(worst, solution.log10_false_alarm)
        if far or value > WRONG_SIGMA**2:
            wrong += 1
            continue
        errors.append(e)
        nees.append(value)
        stars.append(solution.matches_per_field)
        true = frame.hip > 0
        true_stars += int(np.sum(true))
        wrong_stars += int(np.sum((solution.hip > 0) & (solution.hip != frame.hip)))
    counts = np.mean(stars, axis=0) if stars else np.full(2, np.nan)
    sigma = used.camera.spot_noise_px / used.camera.focal_length_px
    return FieldRuns(
        frames=frames,
        solved=len(errors) + wrong,
        solvable=solvable,
        missed=missed,
        wrong=wrong,
        rms_rad=np.sqrt(np.mean(np.square(errors), axis=0)) if errors else np.full(3, np.nan),
        predicted_rad=attitude_sigma(counts[0], counts[1], 2.0 * conditions.field_radius_rad, sigma),
        nees=float(np.mean(nees)) if nees else math.nan,
        stars=float(np.sum(counts)),
        sigma_rad=sigma,
        worst_log10_false_alarm=worst,
        wrong_stars=wrong_stars,
        true_stars=true_stars,
    )


def calibrated(sensor: StarSensor) -> StarSensor:
    """The same sensor with its fold known exactly, as a published figure of noise alone has it."""
    return dataclasses.replace(sensor, fold=dataclasses.replace(sensor.fold, error_rad=0.0))


def single_field(sensor: StarSensor, conditions: SkyConditions) -> StarSensor:
    """The same lens without its fold, the catalogue as deep as it then sees."""
    deep = min(7.5, conditions.faintest_mag + 3.0 * conditions.magnitude_noise)
    identification = dataclasses.replace(sensor.identification, faintest_star_mag=deep, faintest_pair_mag=deep)
    return dataclasses.replace(sensor, fold=Fold("none"), identification=identification)


def identification_rates(
    sensor: StarSensor, conditions: Sequence[SkyConditions], frames: int, seed: int
) -> list[tuple[float, float, float]]:
    """Share of the same frames that are solved rightly: by pairs, by the patent's method, by it with 90 deg -+ a.

    One triple for each of the conditions.

    The patent's tables hold for one velocity: all frames share it.
    """
    rng = np.random.default_rng(seed)
    velocity = random_velocity(rng)
    limits, width = sensor.identification, 2.0 * conditions[0].field_radius_rad
    part = slice(0, int(np.searchsorted(sensor.catalogue.hp_mag, limits.faintest_star_mag, side="right")))
    directions = sensor.catalogue.directions(limits.epoch_jyear, stars=part)
    sky = build_four_sky(aberration(directions, velocity / LIGHT_KM_S), sensor.catalogue.hip[part], width)
    return [_rates(StarFieldSimulator(sensor, each), sky, frames, rng, velocity) for each in conditions]


def _rates(
    simulator: StarFieldSimulator, sky: FourSky, frames: int, rng: np.random.Generator, velocity: Vector
) -> tuple[float, float, float]:
    sensor, camera, fold = simulator.sensor, simulator.sensor.camera, simulator.sensor.fold.matrix
    if fold is None:
        raise ValueError("the patent's method is for two fields")
    right = np.zeros(3)
    for _ in range(frames):
        frame = simulator.frame(rng, velocity_km_s=velocity)
        points = plane_points(frame.spots_px, camera.focal_length_px, camera.principal_point_px, camera.distortion)
        u, sigma = rays(points), ray_sigma(points, camera.spot_noise_px, camera.focal_length_px)
        solutions = (
            measure(frame.spots_px, sensor, magnitude=frame.magnitude, velocity_km_s=velocity),
            identify_patent(u, sky, fold=fold, sigma_rad=sigma),
            identify_patent(u, sky, fold=fold, sigma_rad=sigma, literal=True),
        )
        for k, solution in enumerate(solutions):
            if solution.ok:
                right[k] += np.trace(solution.dcm_cam_from_icrs @ frame.dcm_cam_from_icrs.T) > 3.0 - 1e-6
    return float(right[0] / frames), float(right[1] / frames), float(right[2] / frames)
