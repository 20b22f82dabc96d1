"""Marker spots of a pose, in pixels, and back: projection with distortion, visibility, and pixel noise as a weight."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Flags, Matrix, Stack
from relnav.geometry.distortion import distort, undistort
from relnav.geometry.pinhole import central_projection, central_projection_jacobian
from relnav.sensors.three_marker.sensor import MarkerCamera


@dataclass(frozen=True)
class Projection:
    """Image of points.

    Attributes
    ----------
    spots_px : (n, 2)
        NaN where the point is not visible.
    jacobian_px_m : (n, 2, 3)
        d(spot)/d(point in camera axes), px/m; NaN where not visible.
    visible : (n,)
        In front of the camera, within the image, and not beyond the radius where the distortion folds back.
    """

    spots_px: Matrix
    jacobian_px_m: Stack
    visible: Flags


def on_image(spots_px: Matrix, camera: MarkerCamera) -> Flags:
    """Which spots (n, 2) px lie on the image; False for what is not finite."""
    size = np.array(camera.image_size_px, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        inside: Flags = np.all((spots_px >= -0.5) & (spots_px <= size - 0.5), axis=-1)
    return inside


def usable_covariance(covariance_px2: Stack) -> Flags:
    """Which spots' covariances (n, 2, 2) are finite, symmetric and positive definite."""
    a, b, c, d = (covariance_px2[:, i, j] for i in (0, 1) for j in (0, 1))
    with np.errstate(invalid="ignore", over="ignore"):
        good = (a > 0.0) & (a * d - b * c > 0.0) & (np.abs(b - c) <= 1e-9 * np.sqrt(np.abs(a * d)))
    usable: Flags = good & np.isfinite(covariance_px2).all(axis=(1, 2))
    return usable


def image_of(points_cam_m: Matrix, camera: MarkerCamera) -> tuple[Matrix, Stack]:
    """Spots (n, 2) px of points (n, 3) m in camera axes, on the image or off it, and their Jacobian (n, 2, 3), px/m.

    NaN behind the camera, and where the distortion folds back.
    """
    xy, pinhole = central_projection(points_cam_m), central_projection_jacobian(points_cam_m)
    focal = np.array(camera.focal_length_px)
    if not any(camera.distortion):
        return xy * focal + np.array(camera.principal_point_px), focal[:, None] * pinhole
    with np.errstate(over="ignore", invalid="ignore"):
        image, bend = distort(xy, np.array(camera.distortion))
        folded = ~(bend[:, 0, 0] * bend[:, 1, 1] - bend[:, 0, 1] * bend[:, 1, 0] > 0.0)
        image[folded] = np.nan
        jacobian = focal[:, None] * (bend @ pinhole)
    jacobian[folded] = np.nan
    return image * focal + np.array(camera.principal_point_px), jacobian


def project(points_cam_m: Matrix, camera: MarkerCamera) -> Projection:
    """Spots of points (n, 3) m in camera axes."""
    p = np.asarray(points_cam_m, dtype=np.float64)
    spots, jacobian = image_of(p, camera)
    visible = on_image(spots, camera)
    if any(camera.distortion):
        image = (spots - np.array(camera.principal_point_px)) / np.array(camera.focal_length_px)
        back, _ = undistort(image, np.array(camera.distortion))
        with np.errstate(invalid="ignore"):
            visible &= np.abs(back * p[:, 2:] - p[:, :2]).max(axis=-1) < 1e-6 * np.abs(p[:, 2])
    return Projection(
        np.where(visible[:, None], spots, np.nan), np.where(visible[:, None, None], jacobian, np.nan), visible
    )


def normalise(spots_px: Matrix, camera: MarkerCamera, covariance_px2: Stack | None = None) -> tuple[Matrix, Matrix]:
    """Undistorted normalised image (n, 2) of spots (n, 2) px, and the information of each (n, 3): w_xx, w_xy, w_yy.

    The information is that of the pixel covariance (n, 2, 2) px^2, or of the camera's own spot noise, through the lens:
    W = B^T F R^-1 F B with B the distortion's Jacobian and F = diag(fx, fy). NaN for a spot no point can have made.
    """
    f = np.array(camera.focal_length_px)
    xy, bend = undistort((spots_px - np.array(camera.principal_point_px)) / f, np.array(camera.distortion))
    stretch = f[:, None] * bend
    if covariance_px2 is None:
        weight = np.swapaxes(stretch, -1, -2) @ stretch / camera.spot_noise_px**2
    else:
        weight = np.swapaxes(stretch, -1, -2) @ np.linalg.solve(covariance_px2, stretch)
    return xy, np.stack([weight[:, 0, 0], weight[:, 0, 1], weight[:, 1, 1]], axis=-1)


def unit_rays(xy: Matrix) -> Matrix:
    """Unit vectors (n, 3), camera axes, toward normalised image points (n, 2)."""
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=-1)
    unit: Matrix = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return unit
