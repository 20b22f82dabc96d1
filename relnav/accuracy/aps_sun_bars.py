"""How much better than its patent the sun sensor's calibration is: few points, low noise, images, jumps, figure errors.

Each function gives figures of one comparison; `benchmarks/sun_sensor.py` prints them in full size, the tests take a
tenth.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from relnav.accuracy.aps_sun import design, field_grid, image_spots, noisy_spots
from relnav.arrays import Matrix
from relnav.geometry.projection_angles import direction_from_angles, direction_jacobian, tangents_from_direction
from relnav.sensors.aps_sun.calibration import angles_of_spots, calibrate
from relnav.sensors.aps_sun.measure import direction_of_spot
from relnav.sensors.aps_sun.patent import fit_patent, patent_angles
from relnav.sensors.aps_sun.rays import project
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.aps_sun.table import DirectionTable

WHOLE_DEGREES = 121
WAVES = 200
CORRELATION_RAD = np.radians(12.0)


def thin_glass(model: ApsSunModel) -> ApsSunModel:
    """The model with a cover glass of 1 mm, with which the patent reaches its 0.02 deg."""
    return replace(model, sensor=replace(model.sensor, glass_thickness_m=1.0e-3, glass_depth_m=1.6e-3))


def with_noise(model: ApsSunModel, spot_noise_px: float) -> ApsSunModel:
    """The model with another spot noise."""
    return replace(model, sensor=replace(model.sensor, spot_noise_px=spot_noise_px))


def three_rms_deg(error_rad: Matrix) -> float:
    """Three times the root mean square, deg."""
    return 3.0 * float(np.degrees(np.sqrt(np.mean(error_rad**2))))


def random_angles(model: ApsSunModel, count: int, rng: np.random.Generator) -> Matrix:
    """Angles (count, 2) rad, even over the field."""
    edge = model.sensor.field_half_angle_rad
    return rng.uniform(-edge, edge, (count, 2))


def few_points(
    model: ApsSunModel, side: int, calibrations: int, tests: int, rng: np.random.Generator
) -> tuple[float, float]:
    """3 sigma (deg) of the patent from every whole degree, and of the ray model from side x side points.

    Both over the same noisy test spots, mean square over several calibrations.
    """
    patent, rays = [], []
    few = field_grid(model, side)
    for _ in range(calibrations):
        test = random_angles(model, tests, rng)
        spots = noisy_spots(model, test, rng)
        grid = field_grid(model, WHOLE_DEGREES)
        patent.append(patent_angles(fit_patent(noisy_spots(model, grid, rng), *grid.T), spots)[0] - test)
        made = calibrate(noisy_spots(model, few, rng), direction_from_angles(*few.T), design(model)).calibration
        rays.append(angles_of_spots(made.form, spots) - test)
    return three_rms_deg(np.concatenate(patent)), three_rms_deg(np.concatenate(rays))


def quiet_spots(
    model: ApsSunModel, noise_px: float, side: int, tests: int, rng: np.random.Generator
) -> tuple[float, float]:
    """3 sigma (deg) with little spot noise: of the patent, and of a table from side x side points."""
    return few_points(with_noise(model, noise_px), side, 1, tests, rng)


def from_images(model: ApsSunModel, side: int, tests: int, rng: np.random.Generator) -> float:
    """3 sigma (deg) from image to direction: calibrated on side x side images, tested on others."""
    few = field_grid(model, side)
    made = calibrate(image_spots(model, few, rng), direction_from_angles(*few.T), design(model)).calibration
    test = random_angles(model, tests, rng)
    return three_rms_deg(angles_of_spots(made.form, image_spots(model, test, rng)) - test)


def largest_jumps_deg(model: ApsSunModel, rng: np.random.Generator) -> tuple[float, float]:
    """Largest step (deg) of the patent's output where its row changes, and of a table's where its cell changes."""
    grid = field_grid(model, WHOLE_DEGREES)
    tables = fit_patent(noisy_spots(model, grid, rng), *grid.T)
    angles = np.linspace(-tables.limit_deg, tables.limit_deg, 481)
    values = np.array([[np.polyval(row, angles) for row in rows] for rows in tables.rows])
    few = field_grid(model, 7)
    form = calibrate(noisy_spots(model, few, rng), direction_from_angles(*few.T), design(model)).calibration.form
    assert isinstance(form, DirectionTable)
    along = np.linspace(form.y_px[0], form.y_px[-1], 301)
    steps = []
    for x in form.x_px[1:-1]:
        sides = [form.directions(np.column_stack([np.full_like(along, x + step), along])) for step in (-1e-9, 1e-9)]
        steps.append(np.degrees(np.abs(sides[1] - sides[0]).max()))
    return float(np.abs(np.diff(values, axis=1)).max()), float(np.max(steps))


def smooth_field(rms_rad: float, rng: np.random.Generator) -> Callable[[Matrix], Matrix]:
    """A random smooth field of angle errors (N, 2) over angles (N, 2), that no fitted model contains."""
    waves, phases = rng.normal(size=(2, WAVES, 2)) / CORRELATION_RAD, rng.uniform(0.0, 2.0 * np.pi, (2, WAVES))

    def field(angles_rad: Matrix) -> Matrix:
        parts = [np.cos(angles_rad @ waves[k].T + phases[k]).sum(axis=1) for k in range(2)]
        errors: Matrix = rms_rad * np.sqrt(2.0 / WAVES) * np.stack(parts, axis=1)
        return errors

    return field


@dataclass(frozen=True)
class FigureError:
    """Figures with an error of shape that the models do not contain.

    `patent_deg`, `ours_deg`: 3 sigma without test noise; `method`: what was chosen; `nees`: mean over noisy tests, 2
    for an honest covariance.
    """

    patent_deg: float
    ours_deg: float
    method: str
    nees: float


def figure_error(model: ApsSunModel, rms_deg: float, side: int, tests: int, rng: np.random.Generator) -> FigureError:
    """Calibrate a sensor with a figure error on side x side points, and by the patent on every whole degree."""
    field = smooth_field(np.radians(rms_deg), rng)

    def spots_of(angles: Matrix) -> Matrix:
        return project(model, direction_from_angles(*(angles + field(angles)).T))

    noise = model.sensor.spot_noise_px
    grid, few, test = field_grid(model, WHOLE_DEGREES), field_grid(model, side), random_angles(model, tests, rng)
    grid_spots = spots_of(grid)
    tables = fit_patent(grid_spots + noise * rng.normal(size=grid.shape), *grid.T)
    few_spots = spots_of(few) + noise * rng.normal(size=few.shape)
    made = calibrate(few_spots, direction_from_angles(*few.T), design(model)).calibration
    spots = spots_of(test)
    nees = []
    for spot, s in zip(spots + noise * rng.normal(size=spots.shape), direction_from_angles(*test.T), strict=True):
        seen = direction_of_spot(spot, noise**2 * np.eye(2), model, made)
        across = direction_jacobian(tangents_from_direction(s))
        error = across.T @ (seen.direction - s)
        nees.append(error @ np.linalg.solve(across.T @ seen.covariance @ across, error))
    return FigureError(
        patent_deg=three_rms_deg(patent_angles(tables, spots)[0] - test),
        ours_deg=three_rms_deg(angles_of_spots(made.form, spots) - test),
        method=made.method,
        nees=float(np.mean(nees)),
    )
