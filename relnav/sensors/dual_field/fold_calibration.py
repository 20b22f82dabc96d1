"""The mirror found from the sky: from one frame without any prior, and from many frames jointly."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.wahba import solve_wahba
from relnav.sensors.dual_field.fold import mirror_fold
from relnav.sensors.dual_field.identify import identify
from relnav.sensors.dual_field.sky import Sky
from relnav.sensors.dual_field.solution import StarSolution, StarStatus

MIRRORED = np.diag([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class IdentifiedFrame:
    """Stars of one frame, with the fields they were seen in.

    Attributes
    ----------
    u : (n, 3)
        Unit rays on the detector.
    v : (n, 3)
        Apparent directions of their stars, ICRS.
    field : (n,)
        0 or 1.
    sigma_rad : (n,)
        Of each ray.
    """

    u: Matrix
    v: Matrix
    field: Codes
    sigma_rad: Vector


@dataclass(frozen=True)
class FoldEstimate:
    """A mirror as the sky shows it.

    Attributes
    ----------
    fold : (3, 3)
        M = I - 2 n n^T.
    normal : (3,)
        n, with the sign that makes its first component positive.
    covariance : (2, 2)
        Of n along `axes`, rad^2, attitudes unknown too.
    axes : (2, 3)
        Unit vectors normal to n: in the plane of n and the boresight (it shifts the angle between the fields), and out
        of that plane.
    dcm_cam_from_icrs : (m, 3, 3)
        Attitude of each frame.
    """

    fold: Matrix
    normal: Vector
    covariance: Matrix
    axes: Matrix
    dcm_cam_from_icrs: Matrix


def tangent_axes(normal: Vector) -> Matrix:
    """Unit vectors (2, 3) normal to n: in the plane of n and +z, and out of it."""
    out = np.cross([0.0, 0.0, 1.0], normal)
    out /= np.linalg.norm(out)
    return np.array([np.cross(out, normal), out])


def identify_without_fold(
    u: Matrix,
    sky: Sky,
    *,
    sigma_rad: Vector,
    magnitude: Vector | None = None,
    gate: float = 0.6,
    fainter_mag: float = 0.0,
    velocity_km_s: Vector | None = None,
) -> tuple[StarSolution, StarSolution]:
    """Identify each field of a two-field frame as if it stood alone, the mirror unknown.

    The stars of the other field are so many false spots. Then the spots that are left, mirrored in x, are solved the
    same way, their stars `fainter_mag` fainter than the catalogue has them. Either solution may have failed.
    """
    first = identify(u, sky, sigma_rad=sigma_rad, magnitude=magnitude, gate=gate, velocity_km_s=velocity_km_s)
    left = np.flatnonzero(first.hip == 0) if first.ok else np.arange(len(u))
    second = identify(
        np.ascontiguousarray(u[left] @ MIRRORED),
        sky,
        sigma_rad=sigma_rad[left],
        magnitude=None if magnitude is None else magnitude[left] - fainter_mag,
        gate=gate,
        velocity_km_s=velocity_km_s,
    )
    hip, field = np.zeros(len(u), dtype=np.int32), np.full(len(u), -1, dtype=np.int64)
    residual = np.full(len(u), np.nan)
    hip[left], residual[left] = second.hip, second.residual_rad
    field[left] = np.where(second.hip > 0, 1, -1)
    whole = {"hip": hip, "field": field, "residual_rad": residual}
    return first, StarSolution(**{**vars(second), **whole})


def identify_fields(
    u: Matrix,
    sky: Sky,
    *,
    sigma_rad: Vector,
    magnitude: Vector | None = None,
    gate: float = 0.6,
    fainter_mag: float = 0.0,
    velocity_km_s: Vector | None = None,
) -> IdentifiedFrame | None:
    """Stars of both fields of one frame, the mirror unknown, with catalogue directions; None unless both are found."""
    first, second = identify_without_fold(
        u,
        sky,
        sigma_rad=sigma_rad,
        magnitude=magnitude,
        gate=gate,
        fainter_mag=fainter_mag,
        velocity_km_s=velocity_km_s,
    )
    if first.status is not StarStatus.OK or second.status is not StarStatus.OK:
        return None
    place = {int(h): k for k, h in enumerate(sky.hip)}
    hip = np.where(first.hip > 0, first.hip, second.hip)
    used = hip > 0
    v = sky.arrays.stars[[place[int(h)] for h in hip[used]], :3]
    return IdentifiedFrame(u[used], v, np.where(first.hip[used] > 0, 0, 1), sigma_rad[used])


def mirror_of(frame: IdentifiedFrame) -> Vector | None:
    """The mirror's normal (3,) by M = A B^T diag(-1, 1, 1) of the two fields' attitudes, B from the mirrored spots.

    None if what leads from one field to the other is no mirror.
    """
    dcms = []
    for f, mirrored in ((0, np.eye(3)), (1, MIRRORED)):
        of = frame.field == f
        dcms.append(solve_wahba(frame.u[of] @ mirrored, frame.v[of], frame.sigma_rad[of]).dcm)
    M = dcms[0] @ dcms[1].T @ MIRRORED
    values, vectors = np.linalg.eigh(0.5 * (M + M.T))
    if values[0] > -0.999 or values[1] < 0.999:
        return None
    normal: Vector = vectors[:, 0]
    return normal


def estimate_fold(
    u: Matrix, sky: Sky, *, sigma_rad: Vector, magnitude: Vector | None = None, gate: float = 0.6
) -> FoldEstimate | None:
    """The mirror of one frame without aberration and without a prior; None unless both fields are identified."""
    frame = identify_fields(u, sky, sigma_rad=sigma_rad, magnitude=magnitude, gate=gate)
    normal = None if frame is None else mirror_of(frame)
    return None if frame is None or normal is None else calibrate_fold([frame], normal)


def calibrate_fold(frames: Sequence[IdentifiedFrame], normal: Vector) -> FoldEstimate:
    """The mirror's normal over many frames at once, their attitudes unknown too, from a first normal (3,).

    Gauss-Newton; each frame's attitude is eliminated from the normal equations (Schur's complement).

    Raises
    ------
    ValueError
        If the frames do not fix the normal: two or more stars of each field are needed in at least one.
    """
    n = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    information, dcms = np.zeros((2, 2)), np.empty((len(frames), 3, 3))
    for _ in range(6):
        axes = tangent_axes(n)
        information, gradient = np.zeros((2, 2)), np.zeros(2)
        for index, frame in enumerate(frames):
            w = np.where(frame.field[:, None] == 1, frame.u @ mirror_fold(n), frame.u)
            dcms[index] = solve_wahba(w, frame.v, frame.sigma_rad).dcm
            q = frame.v @ dcms[index].T
            J = np.zeros((len(w), 3, 5))
            J[:, :, :3] = cross_matrix(q)
            for k in range(2):  # d(Mu) = -2 (dn (n.u) + n (dn.u)); the ray moves, so with the other sign
                moved = np.outer(frame.u @ n, axes[k]) + np.outer(frame.u @ axes[k], n)
                J[:, :, 3 + k] = 2.0 * moved * (frame.field == 1)[:, None]
            weight = np.repeat(1.0 / frame.sigma_rad, 3)
            flat, r = J.reshape(-1, 5) * weight[:, None], (w - q).ravel() * weight
            N, g = flat.T @ flat, flat.T @ r
            eliminated = np.linalg.solve(N[:3, :3], np.column_stack([N[:3, 3:], g[:3]]))
            information += N[3:, 3:] - N[3:, :3] @ eliminated[:, :2]
            gradient += g[3:] - N[3:, :3] @ eliminated[:, 2]
        if not np.linalg.eigvalsh(information)[0] > 0.0:
            raise ValueError(
                "the frames do not fix the mirror: two or more stars of each field are needed in one of them"
            )
        n = n + np.linalg.solve(information, gradient) @ axes
        n /= np.linalg.norm(n)
    n = n if n[0] >= 0.0 else -n
    covariance: Matrix = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return FoldEstimate(mirror_fold(n), n, covariance, tangent_axes(n), dcms)


def normal_error(estimate: FoldEstimate, normal: Vector) -> Vector:
    """Error (2,) rad of an estimate along its axes, against the true normal, either sign."""
    true = np.asarray(normal, dtype=np.float64) * math.copysign(1.0, float(estimate.normal @ normal))
    error: Vector = estimate.axes @ (estimate.normal - true)
    return error
