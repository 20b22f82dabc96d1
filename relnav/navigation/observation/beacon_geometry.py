"""Where the camera and the beacons are for a state, and whether a fix can be believed there."""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import entry, kernel, straight_line
from relnav.codegen.together import quotient
from relnav.dynamics.error_state import MOTION
from relnav.navigation.memory import SPOTS, Memory
from relnav.sensors.measurement import MISALIGNED, OK, SWAPPED
from relnav.sensors.three_beacon.fix import RAYS_ROW, solve_fix
from relnav.sensors.three_beacon.invariants import rays_from_position

COS_MISALIGNED = 0.984807753012208  # 10 deg
MOST_SIGMAS2 = 25.0  # what noise may turn an image by
TIGHT_SHARE2 = 4e-4  # of the range squared: position sigma below 2 % of the range


@kernel
def uses_coordinates(sensor: Record) -> bool:
    """Whether the measurement is the detector coordinates themselves, one group a beacon."""
    return bool(sensor["method"] == SPOTS and sensor["attitude_known"] > 0)


@straight_line(dock=(3, 4), mount=(3, 4), cam_from_dock=(3, 3), offset=(3,))
def _combine_attitude(dock: Matrix, mount: Matrix, cam_from_dock: Matrix, offset: Vector) -> None:
    """Write mount dock^T and mount^T lever - port; the fourth columns of mount and dock are lever and port."""
    for i in range(3):
        offset[i] = mount[0, i] * mount[0, 3] + mount[1, i] * mount[1, 3] + mount[2, i] * mount[2, 3] - dock[i, 3]
        for j in range(3):
            cam_from_dock[i, j] = mount[i, 0] * dock[j, 0] + mount[i, 1] * dock[j, 1] + mount[i, 2] * dock[j, 2]


@entry
def attitude_changed(kept: Record, sensor: Record) -> None:
    """Derive what follows from `mount` and `dock`; called whenever `mount` was written."""
    _combine_attitude(kept["dock"], kept["mount"], sensor["cam_from_dock"], sensor["offset"])


@straight_line(state=(MOTION,), ld=(MOTION, MOTION), offset=(3,), dock=(3, 4), place=(3,))
def _locate(state: Vector, ld: Matrix, offset: Vector, dock: Matrix, place: Vector) -> tuple[bool, float, float]:
    """Write the camera's place in the docking frame; returns whether the track says anything, range^2, and variance.

    It must hold numbers only, and a position sigma below the range: over a long gap a prediction becomes worthless (and
    over an absurd one overflows), and images could then be believed anywhere.
    """
    s = np.zeros(3)
    range2, variance, nothing = 0.0, 0.0, 0.0
    for i in range(3):
        s[i] = state[i] + offset[i]
        variance = variance + ld[i, i]
        for j in range(i):
            variance = variance + ld[i, j] * ld[i, j] * ld[j, j]
    for i in range(3):
        place[i] = dock[i, 0] * s[0] + dock[i, 1] * s[1] + dock[i, 2] * s[2]
        range2 = range2 + place[i] * place[i]
    for j in range(MOTION):  # differences of equal numbers: 0, or NaN for what is not a number
        nothing = nothing + (state[j] - state[j])
        for i in range(j, MOTION):
            nothing = nothing + (ld[i, j] - ld[i, j])
    return (abs(nothing) <= 0.0) & (variance < range2), range2, variance


@kernel
def locate(m: Memory, track: Record) -> bool:
    """Write the prior of a predicted track; False if the track says nothing any more."""
    prior = m.prior
    usable, range2, variance = _locate(track["state"], track["ld"], m.sensor["offset"], m.kept["dock"], prior["place"])
    prior["range2"], prior["variance"] = range2, variance
    return bool(usable)


@kernel
def prior_is_tight(prior: Record) -> bool:
    """Whether the predicted geometry can stand for the true one: position sigma below 2 % of the range."""
    return bool(prior["variance"] < TIGHT_SHARE2 * prior["range2"])


@kernel
def _image_spread2(sensor: Record, beacons: Record, range2: float) -> float:
    """(sigma r / (f a))^2 of the spots of A and B: twice the variance of the range, over its square, of one image."""
    first, second = beacons[0]["spot_sigma"], beacons[1]["spot_sigma"]
    size = sensor["focal_length"] * sensor["half_spacing"]
    sigma2 = 0.25 * (first[0] ** 2 + first[1] ** 2 + second[0] ** 2 + second[1] ** 2)
    return float(sigma2 * range2 / (size * size))


@kernel
def prior_beats_image(m: Memory) -> bool:
    """Whether the predicted place is known better than by one image, whose three variances are 1.5 spread^2 r^2 in all.

    Beyond 30 m (spots of 10 um) a start is not tight for many images. Noise taken at their own fixes would then hang
    together with their errors: short ranges have the smaller covariance, and would count for more.
    """
    range2 = m.prior["range2"]
    return bool(m.prior["variance"] < _image_spread2(m.sensor, m.beacons, range2) * range2)


@straight_line(x=(3,), offset=(3,), dock=(3, 4), p=(3,))
def camera_position_dock(x: Vector, offset: Vector, dock: Matrix, p: Vector) -> None:
    """Write the camera's position in the docking frame of the state x into p (3,): lever arms included."""
    s = np.zeros(3)
    for i in range(3):
        s[i] = x[i] + offset[i]
    for i in range(3):
        p[i] = dock[i, 0] * s[0] + dock[i, 1] * s[1] + dock[i, 2] * s[2]


@straight_line(x=(3,), mount=(3, 4), position=(3,), spot=(2,), residual=(2,), gradient=(2, 3))
def see_beacon(
    x: Vector, mount: Matrix, position: Vector, f: float, spot: Vector, residual: Vector, gradient: Matrix
) -> float:
    """Write a beacon's residual and gradient rows (their position columns); returns its depth, m.

    h(x) = central projection, c = mount (beacon - x) - lever; dh/dx = -f/Z (e_axis - (c_axis/Z) e_z) mount.
    """
    d, c = np.zeros(3), np.zeros(3)
    for i in range(3):
        d[i] = position[i] - x[i]
    for i in range(3):
        c[i] = mount[i, 0] * d[0] + mount[i, 1] * d[1] + mount[i, 2] * d[2] - mount[i, 3]
    near = quotient(1.0, c[2], 0.0)
    g = f * near
    for axis in range(2):
        slope = c[axis] * near
        residual[axis] = spot[axis] - f * slope
        for j in range(3):
            gradient[axis, j] = g * (slope * mount[2, j] - mount[axis, j])
    depth: float = c[2]
    return depth


@straight_line(p=(3,), u=(3, 3), cam_from_dock=(3, 3))
def _alignment(p: Vector, u: Matrix, cam_from_dock: Matrix, a: float, b: float) -> tuple[float, float]:
    """Cosines between the measured (u) and the predicted line from B to A, and line of sight; p, docking frame."""
    v, distance = np.zeros((3, 3)), np.zeros(3)
    rays_from_position(p, a, b, v, distance)
    along, across = 0.0, 0.0
    d2, o2, e2, q2 = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        d, o = 0.0, 0.0
        for j in range(3):
            d = d + cam_from_dock[k, j] * (v[0, j] - v[1, j])
            o = o + cam_from_dock[k, j] * (v[0, j] + v[1, j])
        e, q = u[0, k] - u[1, k], u[0, k] + u[1, k]
        along = along + d * e
        across = across + o * q
        d2, o2, e2, q2 = d2 + d * d, o2 + o * o, e2 + e * e, q2 + q * q
    return quotient(along, math.sqrt(d2 * e2), 0.0), quotient(across, math.sqrt(o2 * q2), 0.0)


@kernel
def implied_attitude(sensor: Record, beacons: Record, rays: Matrix, p: Vector) -> int:
    """Whether the attitude that the fix p of the rays implies is the stated one, to 10 deg; a Status code.

    By the line from B to A and the line of sight: far more than any attitude hold is off, far less than a glint or a
    pair of exchanged beacons turns the image. Far away noise turns the line, and moves the fix across the line of
    sight, by sqrt(1/2) spread each; it may by 5 sigma, as a track without the outermost images would be biased.
    """
    if sensor["attitude_known"] == 0:
        return OK
    along, across = _alignment(p, rays, sensor["cam_from_dock"], sensor["half_spacing"], sensor["c_distance"])
    if along > COS_MISALIGNED and across > COS_MISALIGNED:
        return OK
    range2 = p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
    limit = 1.0 - 0.25 * MOST_SIGMAS2 * _image_spread2(sensor, beacons, range2)
    if along > limit and across > limit:
        return OK
    return SWAPPED if along < 0.0 else MISALIGNED


@kernel
def fix_of_spots(sensor: Record, beacons: Record, work: Matrix, spots: Matrix, p: Vector, rays: Matrix) -> int:
    """Closed form of the spots (rows A, B, C) into p (3,) m, docking frame, and their rays; a Status code.

    work (WORK_ROWS, 6) is scratch.
    """
    half = sensor["half_width"]
    a, b, projection = sensor["half_spacing"], sensor["c_distance"], sensor["projection"]
    status = solve_fix(spots, sensor["focal_length"], half[0], half[1], a, b, projection, p, work)
    if status != OK:
        return status
    for i in range(3):
        for j in range(3):
            rays[i, j] = work[RAYS_ROW + i, j]
    return implied_attitude(sensor, beacons, rays, p)
