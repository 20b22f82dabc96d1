"""The APS sun sensor against its patent: calibrations of a ray-traced sensor, tested between the grid's nodes."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from relnav.accuracy.claims import ClaimRow, ClaimsReport, claim_row
from relnav.accuracy.published import Claim, Published
from relnav.arrays import Matrix
from relnav.geometry.projection_angles import direction_from_angles
from relnav.sensors.aps_sun.calibration import angles_of_spots, calibrate
from relnav.sensors.aps_sun.patent import fit_patent, patent_angles, stage_one_angles
from relnav.sensors.aps_sun.rays import pinhole_angles, project, tangents_from_spots
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.spot_centroid import centroid
from relnav.simulation.sun_spot import read_out, render_spot

TEST_POINTS = 5000
TEST_IMAGES = 100
FEW = (25, 49)
QUIET_PX = 0.005
"""Spot noise of a long exposure or of several holes."""
BEFORE, STAGE_ONE, STAGE_TWO = "error before compensation", "error after stage one", "error after stage two"


@dataclass
class _Errors:
    """Errors (rad) of one way of measuring, all runs together."""

    parts: list[Matrix]

    @property
    def three_rms(self) -> float:
        """Three times the root mean square: the patent's 3 sigma."""
        return 3.0 * float(np.sqrt(np.mean(np.concatenate(self.parts) ** 2)))

    @property
    def most(self) -> float:
        """Largest."""
        return float(np.abs(np.concatenate(self.parts)).max())


def measure(
    model: ApsSunModel,
    published: Published,
    *,
    runs: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> ClaimsReport:
    """Measure the patent's compensation, as written and otherwise, and the ray model from a few points.

    Each run draws the spot noise of a calibration and of 5000 test spots anew; the sensor is the model's, and the ray
    model starts from its design, without the assembly errors.

    Parameters
    ----------
    runs : int
        Calibrations of each kind.
    seed : int
        Of everything random.
    progress : callable, optional
        Called with 1 after every run.
    """
    rng = np.random.default_rng(seed)
    errors: dict[tuple[str, str], _Errors] = {}
    for _ in range(runs):
        for key, error in _one_run(model, rng).items():
            errors.setdefault(key, _Errors([])).parts.append(error)
        if progress is not None:
            progress(1)
    rows = [row for claim in published.claims for row in _rows(claim, published, errors)]
    floor = math.degrees(errors[("perfect calibration", STAGE_TWO)].three_rms)
    notes = (
        f"a perfect calibration would leave {floor:.4f} deg (3 sigma): {model.sensor.spot_noise_px:g} px of spot noise",
        "3 sigma is three times the root mean square over the field, both angles",
    )
    return ClaimsReport(model.name, runs, seed, tuple(rows), notes)


def design(model: ApsSunModel) -> ApsSunModel:
    """The model without its assembly errors: what is known before a calibration."""
    width, height = model.sensor.detector_size_px
    sensor = replace(
        model.sensor,
        glass_tilt_rad=(0.0, 0.0),
        detector_tilt_rad=(0.0, 0.0),
        detector_rotation_rad=0.0,
        misalignment_rad=(0.0, 0.0, 0.0),
        zero_spot_px=(0.5 * (width - 1), 0.5 * (height - 1)),
    )
    return replace(model, sensor=sensor, dome=replace(model.dome, centre_m=(0.0, 0.0, 0.0), wedge_m=(0.0, 0.0)))


def field_grid(model: ApsSunModel, side: int) -> Matrix:
    """Angles (side^2, 2) rad of an even grid over the field."""
    along = np.linspace(-model.sensor.field_half_angle_rad, model.sensor.field_half_angle_rad, side)
    return np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)


def noisy_spots(model: ApsSunModel, angles_rad: Matrix, rng: np.random.Generator) -> Matrix:
    """Spots (N, 2) px of angles (N, 2) with the model's noise."""
    return project(model, direction_from_angles(*angles_rad.T)) + model.sensor.spot_noise_px * rng.normal(
        size=angles_rad.shape
    )


def _one_run(model: ApsSunModel, rng: np.random.Generator) -> dict[tuple[str, str], Matrix]:
    """Errors (N, 2) rad by (method, quantity)."""
    edge = model.sensor.field_half_angle_rad
    test = rng.uniform(-edge, edge, (TEST_POINTS, 2))
    spots = noisy_spots(model, test, rng)
    out = {("plain hole, optical h", BEFORE): pinhole_angles(model, spots) - test}
    out["perfect calibration", STAGE_TWO] = np.arctan(tangents_from_spots(model, spots)) - test
    grid = field_grid(model, 2 * round(math.degrees(edge)) + 1)
    grid_spots = noisy_spots(model, grid, rng)
    for method, h in (("patent, optical h", None), ("patent, mechanical h", model.sensor.hole_height_m)):
        tables = fit_patent(grid_spots, *grid.T, h_px=None if h is None else h / model.sensor.pixel_pitch_m)
        out[method, STAGE_ONE] = stage_one_angles(tables, spots) - test
        out[method, STAGE_TWO] = patent_angles(tables, spots)[0] - test
        if h is None:
            interpolated = patent_angles(tables, spots, rows="interpolate")[0]
            out["patent, interpolated rows", STAGE_TWO] = interpolated - test
    quiet = replace(model, sensor=replace(model.sensor, spot_noise_px=QUIET_PX))
    tables = fit_patent(noisy_spots(quiet, grid, rng), *grid.T)
    out[f"spots of {QUIET_PX:g} px, patent", STAGE_TWO] = patent_angles(tables, noisy_spots(quiet, test, rng))[0] - test
    start = design(model)
    for points in FEW:
        few = field_grid(model, math.isqrt(points))
        made = calibrate(noisy_spots(model, few, rng), direction_from_angles(*few.T), start).calibration
        out[f"ray model, {points} points", STAGE_TWO] = angles_of_spots(made.form, spots) - test
    out["ray model, 49 images", STAGE_TWO] = _image_errors(model, start, rng)
    return out


def _image_errors(model: ApsSunModel, start: ApsSunModel, rng: np.random.Generator) -> Matrix:
    """Errors of directions from images, with a ray model calibrated on 49 images."""
    few, edge = field_grid(model, 7), model.sensor.field_half_angle_rad
    made = calibrate(image_spots(model, few, rng), direction_from_angles(*few.T), start).calibration
    test = rng.uniform(-edge, edge, (TEST_IMAGES, 2))
    return angles_of_spots(made.form, image_spots(model, test, rng)) - test


def image_spots(model: ApsSunModel, angles_rad: Matrix, rng: np.random.Generator) -> Matrix:
    """Centroids (N, 2) px of one image each; NaN where there was none."""
    out = np.empty_like(angles_rad)
    for k, s in enumerate(direction_from_angles(*angles_rad.T)):
        window = render_spot(model, s)
        spot = centroid(read_out(window, model.image, rng), model.image)
        out[k] = spot.x_px + window.corner_px[0], spot.y_px + window.corner_px[1]
    return out


def _rows(claim: Claim, published: Published, errors: dict[tuple[str, str], _Errors]) -> list[ClaimRow]:
    """The claim beside every method that has a figure for it."""
    rows = []
    quantity = STAGE_TWO if claim.quantity.startswith(STAGE_TWO) else claim.quantity
    for (method, measured_quantity), error in errors.items():
        if measured_quantity != quantity or method == "perfect calibration":
            continue
        value = error.three_rms if claim.statistic.startswith("3 sigma") else error.most
        row = claim_row(claim, published, method, value)
        if quantity == BEFORE:  # the claim is that there is so much to compensate
            row = replace(row, met=bool(value >= claim.value_si))
        rows.append(row)
    return rows
