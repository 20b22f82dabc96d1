"""From measured spots to a calibration: ray model, spline where the data ask for one, compiled to a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from relnav.arrays import Matrix, Vector, numbers
from relnav.geometry.projection_angles import (
    direction_from_angles,
    direction_from_tangents,
    tangents_from_direction,
)
from relnav.sensors.aps_sun.held_out import held_out_error
from relnav.sensors.aps_sun.patent import PatentTables, fit_patent, leverage, patent_angles
from relnav.sensors.aps_sun.physical import PhysicalFit, fit_physical, parameter_jacobian
from relnav.sensors.aps_sun.rays import project, project_jacobian, tangents_from_spots
from relnav.sensors.aps_sun.residual import ResidualChoice, SplineResidual, choose_spline
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.aps_sun.stray import agree_at_first
from relnav.sensors.aps_sun.table import DirectionTable, direction_into

CELLS, MOST_CELLS = 16, 64
MOST_LOSS_RAD = 1e-5
"""What compiling may cost, 0.0006 deg: cells are doubled until it is met."""
MARGIN_RAD = math.radians(1.0)
"""How far beyond the calibrated field a direction is still given."""
OUTLIER_SIGMA = 8.0
"""A spot so many sigmas of what is usual from where the others put it is left out."""
MOST_LEFT_OUT, MOST_PASSES = 0.1, 10
FEWEST_WITH_STRAYS = 10
"""Of fewer points `MOST_LEFT_OUT` leaves none out."""
METHODS = ("auto", "rays", "patent")


@dataclass(frozen=True)
class Calibration:
    """The conversion of a spot to a direction.

    Attributes
    ----------
    method : str
        "as built", "rays", "rays and spline", "patent".
    form : DirectionTable or PatentTables
        Run-time form.
    field_half_angle_rad : float
        Directions are computed if both projection angles are within this plus 1 deg.
    spot_noise_px : float
        1-sigma of a spot coordinate, where the measurement does not bring its own covariance.
    calibration_noise_px : float
        1-sigma of the calibration's own error, as an error of each spot coordinate; it is in every covariance.
    """

    method: str
    form: DirectionTable | PatentTables
    field_half_angle_rad: float
    spot_noise_px: float
    calibration_noise_px: float

    @cached_property
    def largest_tangent(self) -> float:
        """Largest ratio of a direction's component across the boresight to that along it."""
        return math.tan(self.field_half_angle_rad + MARGIN_RAD)


@dataclass(frozen=True)
class CalibrationResult:
    """A calibration, and how it was obtained.

    Attributes
    ----------
    calibration : Calibration
        The result.
    fit : PhysicalFit or None
        Ray model; None for the patent's method.
    residual : ResidualChoice or None
        The splines that were tried.
    compile_loss_rad : float
        Largest difference between the table and the model that it tabulates, halfway between nodes.
    error_rad : (N, 2)
        Calibrated minus stated (alpha, beta) at every calibration point, by a calibration that has not seen it (of
        what the whole one leaves there less would be seen); NaN for a spot beyond the field.
    used : (N,)
        Whether a point was fitted: False for one that the others contradict.
    left_px : (N,)
        Distance of every spot from its position by the calibration; NaN for the patent's method.
    """

    calibration: Calibration
    fit: PhysicalFit | None
    residual: ResidualChoice | None
    compile_loss_rad: float
    error_rad: Matrix
    used: NDArray[np.bool_]
    left_px: Vector


def calibrate(
    spots_px: ArrayLike,
    directions: ArrayLike,
    start: ApsSunModel,
    *,
    method: str = "auto",
    free: Sequence[str] | None = None,
    seed: int = 0,
) -> CalibrationResult:
    """Calibrate from spots (N, 2) px and the unit directions (N, 3) that made them.

    Parameters
    ----------
    start : ApsSunModel
        Design values: start of the ray model, spot noise, field.
    method : {"auto", "rays", "patent"}
        "auto" adds a spline to the ray model if cross-validation finds that it helps; "patent" is, as
        written, "Error compensation method for the APS sun sensor of a Mars rover" (Chinese patent, 2021),
        with the optical h.
    free : sequence of str, optional
        Parameters that the ray model fits (of `PARAMETERS`).
    seed : int
        Of the folds of the cross-validation.

    Raises
    ------
    ValueError
        For an unknown method, too few points, or points that do not determine the model.
    """
    if method not in METHODS:
        raise ValueError(f"method is one of {', '.join(METHODS)}; got {method!r}")
    xy, s = numbers("spots_px", spots_px), numbers("directions", directions)
    angles = np.arctan(tangents_from_direction(s))
    sensor = start.sensor
    fit, choice, loss = None, None, 0.0
    form: DirectionTable | PatentTables
    if method == "patent":
        used, left = np.ones(len(xy), dtype=bool), np.full(len(xy), np.nan)
        form = fit_patent(xy, angles[:, 0], angles[:, 1])
        error = (angles_of_spots(form, xy) - angles) / (1.0 - leverage(form, xy, angles))
        off = _patent_noise(error, start)
        name = "patent"
    else:
        fit, choice, used, left = _fit_without_outliers(xy, s, start, free, method == "auto", seed)
        spline = choice.spline if choice is not None else None
        form, loss = compile_table(fit.model, spline)
        error = angles_of_spots(form, xy) - angles
        rng, inside = np.random.default_rng(seed), used & np.isfinite(error).all(axis=1)
        unseen, missed_px = held_out_error(xy[used], s[used], fit, choice, rng)
        error[inside] = unseen[inside[used]]
        off = _calibration_noise(fit, spline is not None, missed_px)
        name = "rays" if spline is None else "rays and spline"
    done = Calibration(name, form, sensor.field_half_angle_rad, sensor.spot_noise_px, off)
    return CalibrationResult(done, fit, choice, loss, error, used, left)


def _fit_without_outliers(
    xy: Matrix, s: Matrix, start: ApsSunModel, free: Sequence[str] | None, with_spline: bool, seed: int
) -> tuple[PhysicalFit, ResidualChoice | None, NDArray[np.bool_], Vector]:
    """Ray model and spline fitted to the points that agree, which points those are, and every spot's distance, px.

    Points far off what is usual, by the median, are left out and everything is fitted anew, until no point changes
    sides; first by the ray model alone, because a spline follows a bad point, and before that by a map that no stray
    leads astray (`stray`). Where more than `MOST_LEFT_OUT` would go it is not a few bad points: then all of them stay.
    """
    noise, used, left = start.sensor.spot_noise_px, np.ones(len(xy), dtype=bool), np.zeros(len(xy))
    designed = project(start, s)
    if len(xy) >= FEWEST_WITH_STRAYS and np.isfinite(designed).all() and np.isfinite(xy).all():
        used = agree_at_first(xy, designed, np.random.default_rng(seed), noise, OUTLIER_SIGMA, MOST_LEFT_OUT)
    for spline_too in (False, True) if with_spline else (False,):
        for _ in range(MOST_PASSES):
            fit = fit_physical(xy[used], s[used], start, free=free)
            shifts, choice = xy - project(fit.model, s), None
            if spline_too:
                choice = choose_spline(xy[used], shifts[used], np.random.default_rng(seed))
            follow = choice.spline.shift_px(xy) if choice is not None and choice.spline is not None else 0.0
            left = np.hypot(*(shifts - follow).T)
            usual = max(noise, float(np.median(left)) / np.sqrt(2.0 * np.log(2.0)))  # sigma of an axis
            agree = left < OUTLIER_SIGMA * usual
            if agree.sum() < (1.0 - MOST_LEFT_OUT) * len(xy):
                agree = np.ones(len(xy), dtype=bool)
            if np.array_equal(agree, used):
                break
            used = agree
    return fit, choice, used, left


def as_built(model: ApsSunModel) -> Calibration:
    """The calibration that a model's own dimensions give, as if nothing had been measured."""
    if "as built" not in model.kept:
        model.kept["as built"] = _as_built(model)
    built: Calibration = model.kept["as built"]
    return built


@lru_cache(maxsize=8)
def _as_built(model: ApsSunModel) -> Calibration:
    form, _ = compile_table(model, None)
    sensor = model.sensor
    return Calibration("as built", form, sensor.field_half_angle_rad, sensor.spot_noise_px, 0.0)


def compile_table(
    model: ApsSunModel, spline: SplineResidual | None, *, cells: int | None = None
) -> tuple[DirectionTable, float]:
    """Table of a ray model and its spline over the field and 1.5 deg more, and its largest error, rad.

    Without `cells` (on each axis) they are doubled until the error is below `MOST_LOSS_RAD`.

    Raises
    ------
    ValueError
        If the ray model has no direction for some spot of the table.
    """
    edge = model.sensor.field_half_angle_rad + 1.5 * MARGIN_RAD
    along, ends = np.linspace(-edge, edge, 41), np.full(41, edge)
    sides = ((along, ends), (along, -ends), (ends, along), (-ends, along))
    spots = project(model, np.concatenate([direction_from_angles(*side) for side in sides]))
    low, high = spots.min(axis=0), spots.max(axis=0)
    if not np.all(np.isfinite([low, high])):
        raise ValueError("no light reaches the detector from the edge of the field; make field_half_angle smaller")
    count = CELLS if cells is None else cells
    while True:
        x, y = (np.linspace(low[axis], high[axis], count + 1) for axis in range(2))
        table = DirectionTable(x, y, _tangents(model, spline, x, y))
        loss = _compile_loss(table, model, spline)
        if cells is not None or loss <= MOST_LOSS_RAD or count >= MOST_CELLS:
            return table, loss
        count *= 2


def _compile_loss(table: DirectionTable, model: ApsSunModel, spline: SplineResidual | None) -> float:
    """Largest error of a table within the field at the middles of its cells, rad."""
    x, y = (0.5 * (nodes[1:] + nodes[:-1]) for nodes in (table.x_px, table.y_px))
    exact = _tangents(model, spline, x, y).reshape(-1, 2)
    inside = np.all(np.abs(exact) <= np.tan(model.sensor.field_half_angle_rad), axis=1)
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return float(np.abs(table.directions(places[inside]) - direction_from_tangents(exact[inside])).max())


def spot_to_direction(calibration: Calibration, x_px: float, y_px: float) -> tuple[Vector, Matrix]:
    """Unit vector (3,) of a spot and its slope d(vector)/d(spot px) (3, 2); NaN outside the table."""
    out = np.empty((6, 3))
    direction_into(calibration.form.tangents_with_slope(x_px, y_px), 0.0, 0.0, 0.0, out)
    return out[0], out[1:3].T


def _tangents(model: ApsSunModel, spline: SplineResidual | None, x: Vector, y: Vector) -> Matrix:
    """(tan alpha, tan beta) (nx, ny, 2) at a grid of spots."""
    nodes = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    shift = spline.shift_px(nodes) if spline is not None else 0.0
    tangents = tangents_from_spots(model, nodes - shift)
    if not np.all(np.isfinite(tangents)):
        raise ValueError("the ray model has no direction for some spots of the field; check the dimensions")
    return tangents.reshape(len(x), len(y), 2)


def angles_of_spots(form: DirectionTable | PatentTables, spots_px: Matrix) -> Matrix:
    """(alpha, beta) (N, 2) rad of many spots."""
    if isinstance(form, PatentTables):
        return patent_angles(form, spots_px)[0]
    return np.arctan(tangents_from_direction(form.directions(spots_px)))


def _calibration_noise(fit: PhysicalFit, with_spline: bool, missed_px: Matrix) -> float:
    """1-sigma (px, each coordinate, mean over the field) of what fit and spline are off.

    The fit's own covariance; or, if larger, what held-out points (N, 2) show beyond the spot noise, where the ray model
    is not the sensor: it needs a spline, or leaves more than noise by two standard deviations of a mean square over so
    many points.
    """
    s = _over_the_field(fit.model)
    moved = parameter_jacobian(fit.model, fit.free, s)
    from_fit = 0.5 * float(np.mean(np.einsum("nij,jk,nik->n", moved, fit.covariance, moved)))
    if with_spline or fit.chi2_per_dof > 1.0 + 2.0 / np.sqrt(len(missed_px)):
        noise2 = fit.model.sensor.spot_noise_px**2
        return float(np.sqrt(max(from_fit, float(np.mean(missed_px**2)) - noise2)))
    return float(np.sqrt(from_fit))


def _patent_noise(error_rad: Matrix, model: ApsSunModel) -> float:
    """The same of the patent's tables: what its residual angles show beyond the spot noise, as spot error."""
    tangents = tangents_from_direction(_over_the_field(model))
    slopes = np.linalg.inv(project_jacobian(model, tangents)) / (1.0 + tangents**2)[..., None]
    per_px2 = 0.5 * float(np.mean(np.sum(slopes**2, axis=(1, 2))))
    return float(np.sqrt(max(float(np.mean(error_rad**2)) / per_px2 - model.sensor.spot_noise_px**2, 0.0)))


def _over_the_field(model: ApsSunModel) -> Matrix:
    """Directions (81, 3) on a grid over the field."""
    along = np.linspace(-model.sensor.field_half_angle_rad, model.sensor.field_half_angle_rad, 9)
    alpha, beta = np.meshgrid(along, along)
    return direction_from_angles(alpha.ravel(), beta.ravel())
