"""Error budget of a marker layout: what one image can tell at each range, and where the layout fails.

Spot noise is new in every image. What lasts is averaged by no filter: an error d of the spots, normalised, displaces
the pose by (J^T W J)^-1 J^T W d, with J and W as in `relnav.geometry.pose_refinement`. A camera that is mounted turned,
and an attitude of the chaser that is told wrong, turn all that is found about the lens.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import brentq

from relnav.arrays import Matrix, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.pinhole import central_projection_jacobian
from relnav.geometry.pose_refinement import invertible, pose_information
from relnav.mission import VisionMission
from relnav.sensors.three_marker.camera import normalise, project
from relnav.sensors.three_marker.pose import Pose, explaining_poses, rank_roots, root_gap_rad
from relnav.sensors.three_marker.sensor import ThreeMarkerModel

RANGES_M = (0.8, 1.5, 3.0, 7.0, 15.0, 30.0)
LINEAR_RAD = math.radians(1.5)
"""Sigma of the tilt up to which the range's holds to a tenth. To first order it is R theta / 2 on a flat triangle of
radius R; r theta^2 / 2 comes on top. At 1.5 deg that is half of it for the shipped one, and adds a tenth."""
QUANTITIES = {
    "tilt": ("deg", math.degrees(1.0)),
    "roll": ("deg", math.degrees(1.0)),
    "range": ("mm", 1e3),
    "lateral": ("mm", 1e3),
}
"""Of the target's pose before the chaser: unit and its size."""
_NOTHING = 1e-6  # of the total: rounding
_FOCAL_STEP = 1e-6
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
    others : mapping
        Of each other source of error, by name, 1-sigma of `QUANTITIES`, (4,) rad and m; those of size zero are left
        out.
    """

    range_m: float
    tilt_sigma_rad: float
    roll_sigma_rad: float
    range_sigma_m: float
    lateral_sigma_m: float
    root_gap_rad: float
    others: Mapping[str, Vector] = field(default_factory=dict)

    @property
    def noise(self) -> Vector:
        """1-sigma of `QUANTITIES` by spot noise, (4,)."""
        return np.array([self.tilt_sigma_rad, self.roll_sigma_rad, self.range_sigma_m, self.lateral_sigma_m])

    @property
    def total(self) -> Vector:
        """1-sigma of `QUANTITIES` in one image, all sources together, (4,)."""
        everything: Vector = np.sqrt(sum(sigma**2 for sigma in (self.noise, *self.others.values())))
        return everything

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
        lines += self._other_lines()
        danger = ", ".join(f"{value:.3g} m" for value in self.danger_ranges_m) or "none"
        lines.append(f"ranges at which the markers fix no pose (danger cylinder): {danger}")
        lines.append(f"a marker leaves the image below {self.field_exit_m:.3g} m")
        return lines

    def _other_lines(self) -> list[str]:
        rows = [row for row in self.rows if row.others]
        if not rows:
            return ["no tolerances and no error of the chaser's attitude are stated: spot noise is all"]
        lines = ["with what lasts, which no filter averages, 1-sigma:"]
        for k, (name, (unit, size)) in enumerate(QUANTITIES.items()):
            lines.append(f"{f'{name}, {unit}':<34}" + "".join(f"{f'{row.range_m:g} m':>10}" for row in rows))
            parts = {"spot noise, one image": [row.noise for row in rows]}
            parts |= {source: [row.others[source] for row in rows] for source in rows[0].others}
            parts |= {"total": [row.total for row in rows]}
            for source, values in parts.items():
                shown = [
                    f"{size * value[k]:>10.3g}" if value[k] > _NOTHING * row.total[k] else f"{'-':>10}"
                    for value, row in zip(values, rows, strict=True)
                ]
                lines.append(f"  {source:<32}" + "".join(shown))
        return lines

    def to_dict(self) -> dict[str, Any]:
        """The budget as plain values."""
        rows = [
            vars(row) | {"linear": row.linear, "others": {name: sigma.tolist() for name, sigma in row.others.items()}}
            for row in self.rows
        ]
        return {
            "model": self.model,
            "rows": rows,
            "danger_ranges_m": list(self.danger_ranges_m),
            "field_exit_m": self.field_exit_m,
        }


def budget(model: ThreeMarkerModel, ranges_m: tuple[float, ...] = RANGES_M) -> MarkerBudget:
    """What one image of this layout tells at each range, to first order in the errors."""
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
        {name: sigma for name, sigma in _others(model, pose, seen.spots_px, covariance) if sigma.any()},
    )


def _others(
    model: ThreeMarkerModel, pose: Matrix, spots_px: Matrix, covariance: Matrix
) -> Iterator[tuple[str, Vector]]:
    """Name and 1-sigma of `QUANTITIES` of every source but spot noise, by which the pose has covariance (6, 6)."""
    if not isinstance(model, VisionMission):
        return
    C, points, camera, built = pose[:3], model.markers.points_m, model.camera, model.tolerances
    if built is not None:
        by_point = central_projection_jacobian(points @ C.T + pose[3])
        J = by_point @ np.concatenate([np.broadcast_to(np.eye(3), (len(points), 3, 3)), -C @ cross_matrix(points)], 2)
        ahead, behind = (
            normalise(spots_px + step * (spots_px - camera.principal_point_px), camera)
            for step in (_FOCAL_STEP, -_FOCAL_STEP)
        )
        w_xx, w_xy, w_yy = normalise(spots_px, camera)[1].T
        weights = np.stack([w_xx, w_xy, w_xy, w_yy], axis=-1).reshape(-1, 2, 2)
        gain = covariance @ np.moveaxis(J.transpose(0, 2, 1) @ weights, 0, 1).reshape(6, -1)
        focal = (ahead[0] - behind[0]).reshape(-1, 1) / (2.0 * _FOCAL_STEP)
        yield "focal length", built.focal_length_relative_sigma * _figures(C, gain @ focal)
        placed = np.concatenate([gain[:, 2 * k : 2 * k + 2] @ by_point[k] @ C for k in range(len(points))], axis=1)
        yield "marker placement", built.marker_placement_sigma_m * _figures(C, placed)
        yield "camera mounting", built.camera_mounting_sigma_rad * _turned(pose)
    yield "chaser attitude", model.chaser.attitude_sigma_rad * _turned(pose)
    yield "chaser attitude, one image", model.chaser.attitude_noise_rad * _turned(pose)


def _turned(pose: Matrix) -> Vector:
    """`QUANTITIES` by a turn about the lens of 1 rad about each axis, for a target straight ahead."""
    return np.array([1.0, 1.0, 0.0, float(np.linalg.norm(pose[3]))])


def _figures(C: Matrix, columns: Matrix) -> Vector:
    """`QUANTITIES` by the poses' errors (dr, dtheta), (6, k), of independent errors; C is dcm_cam_from_target."""
    place, turn = columns[:3] @ columns[:3].T, C @ columns[3:] @ columns[3:].T @ C.T
    worst = [float(np.linalg.eigvalsh(part[:2, :2])[-1]) for part in (turn, place)]
    found: Vector = np.sqrt(np.maximum([worst[0], turn[2, 2], place[2, 2], worst[1]], 0.0))
    return found


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
