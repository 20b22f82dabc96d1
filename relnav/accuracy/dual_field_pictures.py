"""Pictures of a two-field sensor: spots defocused over 7 x 7 px, stray light, a mirror of unequal halves, overlaps.

What the patent says of them, You, Xing, Dong (2004), "Dual-field star sensor and star identification with it": spots of
7 x 7 px, so that ten stars light 490 of a million pixels; baffles of 1e-9 against stray light; spots of two fields that
hardly ever touch; as much light through the mirror as by it.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from relnav.arrays import Matrix
from relnav.geometry.rotation_vector import attitude_error
from relnav.sensors.dual_field.measure import measure
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.sensors.dual_field.star_spots import FoundStars, find_stars
from relnav.simulation.star_field import SimulatedStars, SkyConditions, StarFieldSimulator, random_velocity
from relnav.simulation.star_picture import Exposure, picture_of

SPOT_PX = 7
"""Pixels along a side of a defocused spot."""
SPOT_RADIUS_PX = 1.5
"""1-sigma of a Gaussian spot of which 7 x 7 px hold 96 percent: erf(3.5 / (1.5 sqrt 2))^2."""
SUN_MAG = -26.74
KINDS = ("dark", "stray light", "overlap", "unequal halves")
STRAY_BAFFLE = 2.5e-7
"""Attenuation of either baffle under which pictures with stray light are taken: 250 times what the patent asks for."""
UNEQUAL = (0.6, 0.4)
FAR_NEES = 31.81


def stray_counts(sensor: StarSensor, exposure: Exposure, baffle: float) -> float:
    """Mean counts a pixel with the sun on one baffle: that share of its light, spread over the detector.

    A sun of magnitude m behind a baffle that lets the share b past is a star of m - 2.5 log10(b) all over the picture.
    """
    width, height = sensor.camera.detector_size_px
    return float(exposure.flux(np.array([SUN_MAG - 2.5 * math.log10(baffle)]))[0]) / (width * height)


def stray_over_star(sensor: StarSensor, exposure: Exposure, baffle: float, magnitude: float) -> float:
    """Stray light of both baffles under a spot of 7 x 7 px, over the light of a star of given magnitude."""
    under = 2.0 * SPOT_PX**2 * stray_counts(sensor, exposure, baffle)
    return under / float(exposure.flux(np.array([magnitude]))[0])


def touching(spots_px: Matrix) -> int:
    """How many spots (n, 2) have another so near that their 7 x 7 px overlap."""
    apart = np.abs(spots_px[:, None] - spots_px[None]).max(axis=2)
    np.fill_diagonal(apart, np.inf)
    return int(np.sum(apart.min(axis=1, initial=np.inf) < SPOT_PX))


def occupancy(sensor: StarSensor, frames: int, seed: int) -> tuple[float, float, float]:
    """Share of the detector's pixels that the spots of two fields light; of one field alone; share of spots that touch.

    The lens alone shows 0.75 mag more of one field than each of two fields that share its light.
    """
    rng = np.random.default_rng(seed)
    quiet = SkyConditions(magnitude_noise=0.0, missing=0.0, false_spots=0)
    simulator = StarFieldSimulator(sensor, quiet)
    alone = dataclasses.replace(sensor, fold=dataclasses.replace(sensor.fold, kind="none"))
    deep = StarFieldSimulator(alone, dataclasses.replace(quiet, faintest_mag=quiet.faintest_mag + 0.75))
    spots = [simulator.frame(rng).spots_px for _ in range(frames)]
    count, single = sum(len(s) for s in spots), sum(len(deep.frame(rng).spots_px) for _ in range(frames))
    lit = SPOT_PX**2 / (frames * math.prod(sensor.camera.detector_size_px))
    return count * lit, single * lit, sum(touching(s) for s in spots) / max(count, 1)


def fly_pictures(
    sensor: StarSensor, count: int, seed: int, *, progress: Callable[[int], None] | None = None
) -> dict[str, dict[str, float]]:
    """From pictures to attitudes, kind after kind: pictures, solved, far (beyond 5 sigma), stars, found, NEES.

    dark: no stray light. stray light: the sun on both baffles. overlap: two spots or more share pixels. unequal halves:
    the mirror passes 0.6 of the light and reflects 0.4, with stray light.
    """
    rng = np.random.default_rng(seed)
    names = ("pictures", "solved", "far", "stars", "found", "nees")
    result = {kind: dict.fromkeys(names, 0.0) for kind in KINDS}
    for k in range(count):
        kind = KINDS[k % len(KINDS)]
        frame, found, solution_error = _one_picture(sensor, kind, rng)
        row = result[kind]
        row["pictures"] += 1
        row["stars"] += len(frame.spots_px)
        row["found"] += _found(frame.spots_px, found)
        if solution_error is not None:
            row["solved"] += 1
            row["nees"] += solution_error
            row["far"] += solution_error > FAR_NEES
        if progress is not None:
            progress(1)
    for row in result.values():
        row["nees"] /= max(row["solved"], 1.0)
    return result


def _one_picture(
    sensor: StarSensor, kind: str, rng: np.random.Generator
) -> tuple[SimulatedStars, FoundStars, float | None]:
    """Frame, what is found in its picture, and the attitude's NEES (None without an attitude)."""
    fold = sensor.fold
    if kind == "unequal halves":
        fold = dataclasses.replace(fold, transmission=UNEQUAL[0], reflectance=UNEQUAL[1])
    zero = dataclasses.replace(sensor.identification, magnitude_zero_point=Exposure.zero_point)
    sensor = dataclasses.replace(sensor, fold=fold, identification=zero)
    steady = dataclasses.replace(sensor, camera=dataclasses.replace(sensor.camera, spot_noise_px=1e-9))
    simulator = StarFieldSimulator(steady, SkyConditions(magnitude_noise=0.0, missing=0.0, false_spots=0))
    simulator.mount(rng)
    velocity = random_velocity(rng)
    frame = simulator.frame(rng, velocity_km_s=velocity)
    while kind == "overlap" and not touching(frame.spots_px):
        frame = simulator.frame(rng, velocity_km_s=velocity)
    exposure = Exposure(radius_px=SPOT_RADIUS_PX)
    if kind in ("stray light", "unequal halves"):
        stray = stray_counts(sensor, exposure, STRAY_BAFFLE)
        exposure = dataclasses.replace(exposure, stray_counts=(stray, stray))
    width, height = (round(side) for side in sensor.camera.detector_size_px)
    counts = picture_of(frame.spots_px, exposure.flux(frame.magnitude), (width, height), exposure, rng)
    found = find_stars(counts.astype(np.uint16), electrons_per_count=exposure.electrons_per_count)
    solution = measure(found.spots_px, sensor, flux=found.flux, velocity_km_s=velocity)
    if not solution.ok:
        return frame, found, None
    error = attitude_error(solution.dcm_cam_from_icrs, frame.dcm_cam_from_icrs)
    return frame, found, float(error @ np.linalg.solve(solution.covariance, error))


def _found(spots_px: Matrix, found: FoundStars) -> int:
    """How many true spots (n, 2) have a found one within a spot's half width."""
    if len(found.spots_px) == 0:
        return 0
    apart = np.linalg.norm(spots_px[:, None] - found.spots_px[None], axis=2)
    return int(np.sum(apart.min(axis=1) < 0.5 * SPOT_PX))
