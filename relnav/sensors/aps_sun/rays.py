"""From a sun direction to the spot and back, by exact ray tracing through dome, cover glass and tilted detector.

A ray through the hole is followed both ways from there: outward through the dome, inward through the glass. Seen in
detector axes turned by 180 deg (the spot at +h tan(angle)), the inward ray keeps its direction. So it is in [0030] of
"Error compensation method for the APS sun sensor of a Mars rover" (Chinese patent, 2021).
"""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Flags, Matrix, Vector, numbers
from relnav.geometry.linear_algebra import lengths
from relnav.geometry.projection_angles import direction_from_tangents
from relnav.geometry.refraction import leave_sphere, refract
from relnav.sensors.aps_sun.sensor import ApsSunModel, Dome

DOME_PASSES = 6
NEWTON_PASSES = 12
STEP = 1e-6
SETTLED_PX = 1e-9


def project(model: ApsSunModel, s: ArrayLike) -> Matrix:
    """Spots (..., 2) px of sun directions (..., 3), unit vectors in the reference axes.

    NaN where the sun is not above the detector's plane, or no ray comes through. The detector's edge is not looked at:
    `on_detector` does.

    Raises
    ------
    ValueError
        For another last axis, or vectors that are not of unit length within 1e-6.
    """
    s = numbers("s", s)
    if s.shape[-1:] != (3,):
        raise ValueError(f"a direction has 3 components in its last axis; got shape {s.shape}")
    if np.any(np.abs(lengths(s) - 1.0) > 1e-6):
        raise ValueError("sun directions are unit vectors (within 1e-6)")
    sensor = model.sensor
    d = _through_dome(model.dome, s @ _misalignment(sensor.misalignment_rad).T)
    d = np.where(d[..., 2:] > 1e-3, d, np.nan)
    p = np.zeros_like(d)
    if sensor.glass_thickness_m > 0.0:
        normal = _tilted(sensor.glass_tilt_rad)
        p = _to_plane(p, d, np.array([0.0, 0.0, sensor.glass_depth_m]), normal)
        within = refract(d, normal, 1.0 / sensor.glass_index)
        p = _to_plane(p, within, np.array([0.0, 0.0, sensor.glass_depth_m + sensor.glass_thickness_m]), normal)
        d = refract(within, normal, sensor.glass_index)
    foot = np.array([0.0, 0.0, sensor.hole_height_m])
    normal = _tilted(sensor.detector_tilt_rad)
    p = _to_plane(p, d, foot, normal) - foot
    spots: Matrix = np.array(sensor.zero_spot_px) + p @ _pixel_axes(normal, sensor.detector_rotation_rad).T / (
        sensor.pixel_pitch_m
    )
    return spots


def on_detector(model: ApsSunModel, spots_px: Matrix) -> Flags:
    """Whether spots (..., 2) px lie on the detector."""
    size = np.array(model.sensor.detector_size_px)
    inside: Flags = np.all((spots_px >= -0.5) & (spots_px <= size - 0.5), axis=-1)
    return inside


def pinhole_angles(model: ApsSunModel, spots_px: ArrayLike) -> Matrix:
    """(alpha, beta) (..., 2) rad of spots by a plain hole at the optical height: what is to be compensated."""
    offset = numbers("spots_px", spots_px) - np.array(model.sensor.zero_spot_px)
    angles: Matrix = np.arctan(offset * (model.sensor.pixel_pitch_m / model.sensor.paraxial_height_m))
    return angles


def project_jacobian(model: ApsSunModel, tangents: Matrix) -> Matrix:
    """d(spot px)/d(tan alpha, tan beta), (..., 2, 2), by central differences of the trace."""
    columns = []
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = STEP * 10.0
        ahead, behind = (project(model, direction_from_tangents(tangents + sign * step)) for sign in (1.0, -1.0))
        columns.append((ahead - behind) / (2.0 * step[axis]))
    return np.stack(columns, axis=-1)


def tangents_from_spots(model: ApsSunModel, spots_px: ArrayLike) -> Matrix:
    """(tan alpha, tan beta), (..., 2), that make the spots (..., 2) px: Newton on the trace; NaN where it fails."""
    spots = numbers("spots_px", spots_px)
    if spots.shape[-1:] != (2,):
        raise ValueError(f"a spot has 2 coordinates (x, y px) in its last axis; got shape {spots.shape}")
    sensor = model.sensor
    t: Matrix = (spots - np.array(sensor.zero_spot_px)) * (sensor.pixel_pitch_m / sensor.paraxial_height_m)
    for _ in range(NEWTON_PASSES):
        miss = spots - project(model, direction_from_tangents(t))
        if not np.any(np.abs(miss) > SETTLED_PX):
            return t
        J = project_jacobian(model, t)
        a, b, c, d = J[..., 0, 0], J[..., 0, 1], J[..., 1, 0], J[..., 1, 1]
        adjugate = np.stack([d * miss[..., 0] - b * miss[..., 1], a * miss[..., 1] - c * miss[..., 0]], axis=-1)
        det = (a * d - b * c)[..., None]
        t = t + adjugate / np.where(det > 0.0, det, np.nan)
    settled = np.all(np.abs(spots - project(model, direction_from_tangents(t))) < 1e3 * SETTLED_PX, axis=-1)
    return np.where(settled[..., None], t, np.nan)


def _misalignment(angles: tuple[float, float, float]) -> Matrix:
    """R_z R_y R_x."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    turn: Matrix = z @ y @ x
    return turn


def _tilted(tilt: tuple[float, float]) -> Vector:
    """Unit normal of a plane whose normal leans by these angles from z toward x and toward y."""
    normal = np.array([np.tan(tilt[0]), np.tan(tilt[1]), 1.0])
    unit: Vector = normal / np.linalg.norm(normal)
    return unit


def _pixel_axes(normal: Vector, rotation: float) -> Matrix:
    """The detector's x and y axes (2, 3): in its plane, x without y component, then turned about the normal."""
    x = np.array([normal[2], 0.0, -normal[0]])
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    c, s = np.cos(rotation), np.sin(rotation)
    return np.array([c * x + s * y, c * y - s * x])


def _to_plane(p: Matrix, d: Matrix, foot: Vector, normal: Vector) -> Matrix:
    """Where rays from p along d meet the plane through foot."""
    hit: Matrix = p + (((foot - p) @ normal) / (d @ normal))[..., None] * d
    return hit


def _through_dome(dome: Dome, s: Matrix) -> Matrix:
    """Directions inside the dome of the rays that reach the hole from s: fixed point of the outward trace."""
    if dome.thickness_m == 0.0:
        return s
    d = s
    for _ in range(DOME_PASSES):
        d = d + (s - _out_of_dome(dome, d))
        d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    return d


def _out_of_dome(dome: Dome, d: Matrix) -> Matrix:
    """Direction outside of a ray that leaves the hole along d."""
    outer = np.array(dome.centre_m)
    inner = outer + np.array([*dome.wedge_m, 0.0])
    p = leave_sphere(np.zeros_like(d), d, inner, dome.radius_m - dome.thickness_m)
    d = refract(d, (p - inner) / (dome.radius_m - dome.thickness_m), 1.0 / dome.index)
    p = leave_sphere(p, d, outer, dome.radius_m)
    return refract(d, (p - outer) / dome.radius_m, dome.index)
