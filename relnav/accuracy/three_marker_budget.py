"""Error budget of a marker layout: what one image can tell at each range, and where the layout fails."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from relnav.arrays import Matrix
from relnav.geometry.pinhole import central_projection_jacobian
from relnav.geometry.pose_refinement import invertible, pose_information
from relnav.sensors.three_marker.camera import normalise, project
from relnav.sensors.three_marker.pose import Pose, explaining_poses, rank_roots, root_gap_rad
from relnav.sensors.three_marker.sensor import ThreeMarkerModel

RANGES_M = (0.8, 1.5, 3.0, 7.0, 15.0, 30.0)
LINEAR_RAD = math.radians(1.5)
"""Sigma of the tilt up to which the range's holds to a tenth. To first order it is R theta / 2 on a flat triangle of
radius R; r theta^2 / 2 comes on top. At 1.5 deg that is half of it for the shipped one, and adds a tenth."""
_SEARCH_M = (0.02, 1000.0)
_SEARCH_STEPS = 4000
_EXPLAINED = 9.0  # chi-square: a pose of four markers or more that misfits by less cannot be told from the true one


@dataclass(frozen=True)
class BudgetRow:
    """One range, straight ahead, at the nominal attitude; NaN where not all markers are on the image.

    Attributes
    ----------
    range_m : float
        From the camera to the target's centre of mass.
    tilt_sigma_rad, roll_sigma_rad : float
        1-sigma attitude across (the worse axis) and about the boresight, one image.
    range_sigma_m, lateral_sigma_m : float
        1-sigma position along and across (the worse axis) the boresight.
    root_gap_rad : float
        Angle to the nearest other attitude that explains the same spots; infinite if there is none.
    """

    range_m: float
    tilt_sigma_rad: float
    roll_sigma_rad: float
    range_sigma_m: float
    lateral_sigma_m: float
    root_gap_rad: float

    @property
    def linear(self) -> bool:
        """Whether the tilt is small enough for figures of the first order; False where there are none."""
        return self.tilt_sigma_rad <= LINEAR_RAD


@dataclass(frozen=True)
class MarkerBudget:
    """Budget of one model.

    Attributes
    ----------
    model : str
        Its name.
    rows : tuple of BudgetRow
        One a range.
    danger_ranges_m : tuple of float
        Ranges at which three markers fix no pose to first order (the camera stands on their danger cylinder).
    field_exit_m : float
        Range below which a marker is off the image or behind the camera.
    """

    model: str
    rows: tuple[BudgetRow, ...]
    danger_ranges_m: tuple[float, ...]
    field_exit_m: float

    def lines(self) -> list[str]:
        """The budget for a reader."""
        lines = [
            f"model {self.model}: one image, straight ahead, nominal attitude, 1-sigma of spot noise alone",
            "not in it: tolerances of lens, mounting and markers, and the chaser's attitude; a filter considers them",
            f"{'range m':>8}{'tilt deg':>11}{'roll deg':>11}{'range mm':>11}{'lateral mm':>12}{'next root deg':>15}",
        ]
        for row in self.rows:
            angles = [math.degrees(value) for value in (row.tilt_sigma_rad, row.roll_sigma_rad)]
            gap = "none" if math.isinf(row.root_gap_rad) else f"{math.degrees(row.root_gap_rad):.1f}"
            if math.isnan(row.tilt_sigma_rad):
                lines.append(f"{row.range_m:>8g}  not all markers are on the image, or they fix no pose")
                continue
            mark = "" if row.linear else "  *"
            lines.append(
                f"{row.range_m:>8g}{angles[0]:>11.3g}{angles[1]:>11.3g}{1e3 * row.range_sigma_m:>11.3g}"
                f"{1e3 * row.lateral_sigma_m:>12.3g}{gap:>15}{mark}"
            )
        if any(row.tilt_sigma_rad > LINEAR_RAD for row in self.rows):
            limit = math.degrees(LINEAR_RAD)
            lines.append(
                f"* the tilt's sigma is above {limit:g} deg: not linear in the spots, tilt and range are worse"
            )
        danger = ", ".join(f"{value:.3g} m" for value in self.danger_ranges_m) or "none"
        lines.append(f"ranges at which the markers fix no pose (danger cylinder): {danger}")
        lines.append(f"a marker leaves the image below {self.field_exit_m:.3g} m")
        return lines

    def to_dict(self) -> dict[str, Any]:
        """The budget as plain values."""
        return {
            "model": self.model,
            "rows": [vars(row) | {"linear": row.linear} for row in self.rows],
            "danger_ranges_m": list(self.danger_ranges_m),
            "field_exit_m": self.field_exit_m,
        }


def budget(model: ThreeMarkerModel, ranges_m: tuple[float, ...] = RANGES_M) -> MarkerBudget:
    """What one image of this layout tells at each range, to first order in the spot noise."""
    return MarkerBudget(model.name, tuple(_row(model, r) for r in ranges_m), danger_ranges(model), field_exit(model))


def _nominal(model: ThreeMarkerModel, range_m: float) -> Matrix:
    return np.concatenate([model.view.dcm_cam_from_target, [[0.0, 0.0, range_m]]])


def _row(model: ThreeMarkerModel, range_m: float) -> BudgetRow:
    """Budget at one range."""
    nan = math.nan
    pose, points = _nominal(model, range_m), model.markers.points_m
    seen = project(points @ pose[:3].T + pose[3], model.camera)
    if not seen.visible.all():
        return BudgetRow(range_m, nan, nan, nan, nan, nan)
    xy, weights = normalise(seen.spots_px, model.camera)
    information = np.empty((6, 6))
    pose_information(points, xy, weights, pose, information, np.empty(6))
    if not invertible(information):
        return BudgetRow(range_m, nan, nan, nan, nan, nan)
    covariance: Matrix = np.asarray(np.linalg.inv(information), dtype=np.float64)
    attitude = pose[:3] @ covariance[3:, 3:] @ pose[:3].T
    here = Pose(pose[3], pose[:3], covariance)
    others = [root for root in explaining_poses(xy, weights, points) if root[2] < _EXPLAINED]
    return BudgetRow(
        range_m,
        math.sqrt(float(np.linalg.eigvalsh(attitude[:2, :2])[-1])),
        math.sqrt(float(attitude[2, 2])),
        here.range_sigma_m,
        math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1])),
        root_gap_rad(rank_roots(others, here)),
    )


def danger_ranges(model: ThreeMarkerModel) -> tuple[float, ...]:
    """Ranges straight ahead at which the pose Jacobian of three markers is singular, m; none for more markers."""
    points = model.markers.points_m
    if len(points) != 3:
        return ()
    turned = points @ model.view.dcm_cam_from_target.T

    def determinant(range_m: float) -> float:
        rows = range_m * central_projection_jacobian(turned + np.array([0.0, 0.0, range_m]))
        by_turn = np.cross(turned[:, None], rows)
        return float(np.linalg.det(np.concatenate([rows, by_turn], axis=-1).reshape(6, 6)))

    nearest = max(_SEARCH_M[0], 1.001 * float(-turned[:, 2].min()))
    grid = np.geomspace(nearest, _SEARCH_M[1], _SEARCH_STEPS)
    values = np.array([determinant(float(r)) for r in grid])
    crossings = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    return tuple(float(brentq(determinant, grid[k], grid[k + 1])) for k in crossings)


def field_exit(model: ThreeMarkerModel) -> float:
    """Range below which not all markers are on the image, m: straight ahead, nominal attitude."""
    points = model.markers.points_m @ model.view.dcm_cam_from_target.T

    def all_visible(range_m: float) -> bool:
        return bool(project(points + np.array([0.0, 0.0, range_m]), model.camera).visible.all())

    grid = np.geomspace(*_SEARCH_M, 400)
    hidden = [k for k, r in enumerate(grid) if not all_visible(float(r))]
    if not hidden:
        return float(grid[0])
    if hidden[-1] == len(grid) - 1:
        return math.inf
    low, high = float(grid[hidden[-1]]), float(grid[hidden[-1] + 1])
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if all_visible(middle) else (middle, high)
    return high
