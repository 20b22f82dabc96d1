"""Marker spots of a pose, in pixels, and back: projection with distortion, visibility, and pixel noise as a weight."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.geometry.distortion import distort, undistort, undistort_point
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
    return np.array([is_covariance(*four) for four in covariance_px2.reshape(-1, 4).tolist()], dtype=bool)


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


@kernel
def normalise_spot(
    u: float, v: float, xx: float, xy: float, yx: float, yy: float, lens: Vector
) -> tuple[float, float, float, float, float]:
    """Undistorted normalised point of a spot (u, v) px with covariance R px^2, and its information w_xx, w_xy, w_yy.

    W = B^T F R^-1 F B with B the distortion's Jacobian and F = diag(fx, fy); lens (12,) is `MarkerCamera.lens`. NaN for
    a spot that no point can have made.
    """
    fx, fy = lens[0], lens[1]
    x, y, b_xx, b_xy, b_yy = undistort_point((u - lens[2]) / fx, (v - lens[3]) / fy, lens[7:12])
    det = xx * yy - xy * yx
    if not abs(det) > 0.0:
        return math.nan, math.nan, math.nan, math.nan, math.nan
    p, q, r = yy / det, -0.5 * (xy + yx) / det, xx / det  # R^-1
    a, b, c, d = fx * b_xx, fx * b_xy, fy * b_xy, fy * b_yy  # F B
    return (
        x,
        y,
        a * (p * a + q * c) + c * (q * a + r * c),
        a * (p * b + q * d) + c * (q * b + r * d),
        b * (p * b + q * d) + d * (q * b + r * d),
    )


@entry
def usable_into(spots: Matrix, covariance: Stack, lens: Vector, image: Matrix, weights: Matrix, which: Codes) -> int:
    """Write the spots (n, 2) px that can be used into image (n, 2) and weights (n, 3), which they are into which (n,).

    They lie on the image, a point can have made them, and their covariance (n, 2, 2) px^2 is finite, symmetric and
    positive definite; that of the lens where it is empty, (0, 2, 2). Returns how many.
    """
    count, own = 0, covariance.shape[0] > 0
    xx = yy = lens[6] * lens[6]
    xy = yx = 0.0
    for k in range(spots.shape[0]):
        u, v = spots[k, 0], spots[k, 1]
        if not (-0.5 <= u <= lens[4] - 0.5 and -0.5 <= v <= lens[5] - 0.5):
            continue
        if own:
            xx, xy, yx, yy = covariance[k, 0, 0], covariance[k, 0, 1], covariance[k, 1, 0], covariance[k, 1, 1]
            if not is_covariance(xx, xy, yx, yy):
                continue
        x, y, w_xx, w_xy, w_yy = normalise_spot(u, v, xx, xy, yx, yy, lens)
        if not math.isfinite(x + y + w_xx + w_xy + w_yy):
            continue
        image[count, 0], image[count, 1], which[count] = x, y, k
        weights[count, 0], weights[count, 1], weights[count, 2] = w_xx, w_xy, w_yy
        count += 1
    return count


@kernel
def is_covariance(xx: float, xy: float, yx: float, yy: float) -> bool:
    """Whether a 2 x 2 matrix is finite, symmetric and positive definite."""
    finite = math.isfinite(xx) and math.isfinite(xy) and math.isfinite(yx) and math.isfinite(yy)
    return finite and xx > 0.0 and xx * yy - xy * yx > 0.0 and abs(xy - yx) <= 1e-9 * math.sqrt(abs(xx * yy))


def normalise(spots_px: Matrix, camera: MarkerCamera, covariance_px2: Stack | None = None) -> tuple[Matrix, Matrix]:
    """Undistorted normalised image (n, 2) of spots (n, 2) px, and the information of each (n, 3): w_xx, w_xy, w_yy.

    The information is that of the pixel covariance (n, 2, 2) px^2, or of the camera's own spot noise, through the lens.
    NaN for a spot no point can have made.
    """
    noise = camera.spot_noise_px**2 * np.eye(2)
    covariances = np.broadcast_to(noise if covariance_px2 is None else covariance_px2, (len(spots_px), 2, 2))
    found = np.empty((len(spots_px), 5))
    rows = np.column_stack([spots_px, covariances.reshape(-1, 4)]).tolist()
    for k, (u, v, xx, xy, yx, yy) in enumerate(rows):
        found[k] = normalise_spot(u, v, xx, xy, yx, yy, camera.lens)
    return found[:, :2], found[:, 2:]


def unit_rays(xy: Matrix) -> Matrix:
    """Unit vectors (n, 3), camera axes, toward normalised image points (n, 2)."""
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=-1)
    unit: Matrix = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return unit
