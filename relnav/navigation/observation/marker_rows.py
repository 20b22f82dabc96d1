"""What one image of the markers says of position and attitude: residuals, rows, noise, to second order in the errors.

Marker i, at s in the target, is seen at

    p = C_KB (C_BL (C s - rho) - c_B)        K camera, B chaser, L lvlh_ccsds, c_B the lens in the chaser

so that any number of spots, one included, tells what it can. The noise of the chaser's attitude turns all spots of an
image together: it stands in their covariance. What lasts (the chaser's attitude, the camera's mounting and focal
length, the markers' places) is considered: `by_error` holds what one sigma of each does to each spot.

A spot's second order in the errors d = (drho, theta) is d^T B d / 2. Perspective: a spot moves by row d over the depth
p_z, which d changes itself, so that B = -(row^T g + g^T row), g = d(p_z)/p_z. A turn: p = C exp([theta x]) s has the
part C (theta theta^T - theta^T theta 1) s / 2, so that B = (q^T s^T + s q) / 2 - (q s) 1 with q the row by s. (The bend
of a lens's distortion is left out.) Its mean, tr(B P) / 2, shifts the expected spot, and its covariance,
tr(B_i P B_j P) / 2, is noise (Jazwinski 1970, ch. 9, Gaussian second-order filter): a filter of first order takes the
size of a turn that it sees by its square for knowledge of its sign, and after a gap in which the position has become
uncertain believes lines of sight that it has bent.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.codegen.trace import Shape
from relnav.dynamics.error_state import POSE, RATE, THETA
from relnav.estimation.considered import add_lasting_noise, subtract_taken
from relnav.geometry.distortion import distort_point
from relnav.geometry.linear_algebra import cholesky, cross_into
from relnav.navigation.blocks import CHASER_ATTITUDE, FOCAL_LENGTH, MOUNTING, PLACEMENT
from relnav.navigation.pose_memory import SEEN, PoseMemory


@kernel
def has_spot(spots: Matrix, i: int) -> bool:
    """Whether row i of the spots (n, 2) holds a spot."""
    return math.isfinite(spots[i, 0]) and math.isfinite(spots[i, 1])


@kernel
def on_image(camera: Record, x: float, y: float) -> bool:
    """Whether a spot lies on the image, which spans -0.5 to width - 0.5."""
    size = camera["size"]
    return bool(-0.5 <= x <= size[0] - 0.5 and -0.5 <= y <= size[1] - 0.5)


@kernel
def aim_camera(camera: Record, dcm_chaser_from_lvlh: Matrix) -> None:
    """Write the chaser's attitude, and the camera's that follows."""
    chaser, mount, cam = camera["chaser"], camera["mount"], camera["cam_from_lvlh"]
    for i in range(3):
        for j in range(3):
            chaser[i, j] = dcm_chaser_from_lvlh[i, j]
    for i in range(3):
        for j in range(3):
            cam[i, j] = mount[i, 0] * chaser[0, j] + mount[i, 1] * chaser[1, j] + mount[i, 2] * chaser[2, j]


@kernel
def pose_of(camera: Record, track: Record, pose: Matrix) -> None:
    """Write the target's pose (4, 3) seen from the camera: rows C_KT, r."""
    cam, mount, lens, rho, dcm = camera["cam_from_lvlh"], camera["mount"], camera["lens"], track["motion"], track["dcm"]
    for i in range(3):
        pose[3, i] = 0.0
        for j in range(3):
            pose[3, i] -= cam[i, j] * rho[j] + mount[i, j] * lens[j]
            pose[i, j] = cam[i, 0] * dcm[0, j] + cam[i, 1] * dcm[1, j] + cam[i, 2] * dcm[2, j]


@kernel
def project(camera: Record, p: Vector, spot: Vector, by_point: Matrix, bend: Matrix) -> bool:
    """Write a point's spot (2,) px and its derivative (2, 3); False behind the camera, or where the lens folds back.

    Brown and Conrady's distortion as in `relnav.geometry.distortion`; bend (2, 2): its derivative.
    """
    if not p[2] > 0.0:
        return False
    x, y = p[0] / p[2], p[1] / p[2]
    focal, center = camera["focal_length"], camera["principal_point"]
    u, v, xx, xy, yy = x, y, 1.0, 0.0, 1.0
    if camera["distorts"] > 0:
        u, v, xx, xy, yy = distort_point(x, y, camera["distortion"])
        if not xx * yy - xy * xy > 0.0:
            return False
    bend[0, 0], bend[0, 1], bend[1, 0], bend[1, 1] = xx, xy, xy, yy
    spot[0], spot[1] = u * focal[0] + center[0], v * focal[1] + center[1]
    for i in range(2):
        by_point[i, 0] = focal[i] * bend[i, 0] / p[2]
        by_point[i, 1] = focal[i] * bend[i, 1] / p[2]
        by_point[i, 2] = -focal[i] * (bend[i, 0] * x + bend[i, 1] * y) / p[2]
    return True


@kernel
def _linearise(
    camera: Record,
    scratch: Record,
    s: Vector,
    spot: Vector,
    group: Record,
    nearer: Vector,
    q: Matrix,
    turns: Matrix,
) -> bool:
    """Write the group of a marker at s (3,): residual, rows and derivatives; False if it cannot be seen there.

    nearer (6,), q (2, 3) by the marker, turns (2, 3) by the chaser's attitude.
    """
    pose = scratch["pose"]
    p, expected, by_point, bend = scratch["point"], scratch["error"], scratch["projection"], scratch["bend"]
    for i in range(3):
        p[i] = pose[3, i]
        for j in range(3):
            p[i] += pose[i, j] * s[j]
    if not project(camera, p, expected, by_point, bend) or not on_image(camera, spot[0], spot[1]):
        return False
    cam, mount, lens, gradient = camera["cam_from_lvlh"], camera["mount"], camera["lens"], group["gradient"]
    residual, turned = group["residual"], scratch["turned"]
    from_chaser, along = turned[0], turned[1]
    for j in range(3):
        from_chaser[j] = mount[0, j] * p[0] + mount[1, j] * p[1] + mount[2, j] * p[2] + lens[j]
        nearer[j] = -cam[2, j] / p[2]
    cross_into(s, pose[2], nearer[3:6])  # d(p_z) by theta: s x C_z
    for j in range(3):
        nearer[3 + j] /= p[2]
    for axis in range(2):
        residual[axis] = spot[axis] - expected[axis]
        d = by_point[axis]
        for j in range(3):
            gradient[axis, j] = -(d[0] * cam[0, j] + d[1] * cam[1, j] + d[2] * cam[2, j])
            q[axis, j] = d[0] * pose[0, j] + d[1] * pose[1, j] + d[2] * pose[2, j]
            along[j] = d[0] * mount[0, j] + d[1] * mount[1, j] + d[2] * mount[2, j]
        cross_into(q[axis], s, gradient[axis, THETA:RATE])
        for j in range(3):
            gradient[axis, THETA + j] = -gradient[axis, THETA + j]
        cross_into(along, from_chaser, turns[axis])
    return True


@kernel
def _write_lasting(
    camera: Record, scratch: Record, lasting: Record, marker: int, q: Matrix, turns: Matrix, by_error: Matrix
) -> None:
    """Write what one sigma of each lasting error does to a marker's spot, (2, m), as it was linearised last."""
    p, expected, by_point = scratch["point"], scratch["error"], scratch["projection"]
    center, turn = camera["principal_point"], scratch["turned"][0]
    for axis in range(2):
        row = by_error[axis]
        for c in range(row.shape[0]):
            row[c] = 0.0
        for j in range(3):
            row[CHASER_ATTITUDE + j] = lasting["attitude"] * turns[axis, j]
        if lasting["shown"] > MOUNTING:
            cross_into(by_point[axis], p, turn)
            row[FOCAL_LENGTH] = lasting["focal_length"] * (expected[axis] - center[axis])
            for j in range(3):
                row[MOUNTING + j] = lasting["mounting"] * turn[j]
                row[PLACEMENT + 3 * marker + j] = lasting["placement"] * q[axis, j]


_SEES: Shape = "***000***000"
"""Of the twelve errors, position and attitude; in P below they are numbers 0 to 5."""


@straight_line(ld=(POSE, POSE), seen=(SEEN, SEEN))
def _write_seen_covariance(ld: Matrix, seen: Matrix) -> None:
    """Write P of position and attitude, of the factors L D L^T of all errors, into seen."""
    errors = (0, 1, 2, THETA, THETA + 1, THETA + 2)
    for a, i in enumerate(errors):
        for b, j in enumerate(errors[: a + 1]):
            total = ld[j, j] * (1.0 if i == j else ld[i, j])
            for k in range(j):
                total += ld[i, k] * ld[k, k] * ld[j, k]
            seen[a, b] = total
            seen[b, a] = total


@kernel
def _add_lasting_covariance(sensitivities: Matrix, first: int, seen: Matrix) -> None:
    """Add what lasting errors from `first` on have done to position and attitude, (m, 12), to seen (6, 6).

    These are of lens, markers and inertia.
    Turns of chaser or camera turn what is found with the camera's axes: between these and the target all is straight.
    """
    for c in range(first, sensitivities.shape[0]):
        for a in range(SEEN):
            one = sensitivities[c, a + 3 * (a // 3)]
            for b in range(SEEN):
                seen[a, b] += one * sensitivities[c, b + 3 * (b // 3)]


@straight_line(h=_SEES, g=(SEEN,), q=(3,), s=(3,), covariance=(SEEN, SEEN), bend=(SEEN * SEEN,))
def _write_bend(h: Vector, g: Vector, q: Vector, s: Vector, covariance: Matrix, bend: Vector) -> float:
    """Write B P of a row h, (6, 6) row by row, into bend; returns half of its trace.

    g: d(depth) / depth of the row's marker at s; q: the row by the marker.
    """
    B, P = np.zeros((SEEN, SEEN)), covariance
    errors = (0, 1, 2, THETA, THETA + 1, THETA + 2)
    along, mean = q[0] * s[0] + q[1] * s[1] + q[2] * s[2], 0.0
    for i in range(SEEN):
        for j in range(i + 1):
            B[i, j] = -(h[errors[i]] * g[j] + h[errors[j]] * g[i])
            if j >= 3:
                B[i, j] += 0.5 * (q[i - 3] * s[j - 3] + q[j - 3] * s[i - 3])
                B[i, j] -= along if i == j else 0.0
            B[j, i] = B[i, j]
    for i in range(SEEN):
        for j in range(SEEN):
            total = B[i, 0] * P[0, j]
            for k in range(1, SEEN):
                total += B[i, k] * P[k, j]
            bend[SEEN * i + j] = total
        mean += 0.5 * bend[SEEN * i + i]
    return mean


@straight_line(a=(2, SEEN * SEEN), b=(2, SEEN * SEEN), noise=(2, 2))
def _add_half_traces(a: Matrix, b: Matrix, noise: Matrix) -> None:
    """Add half of tr(A B) of the matrices (6, 6), row by row, of the rows of two markers to the noise of these rows.

    For all four at once each number is fetched once; in two strands each additions do not wait for one another.
    """
    for row in range(2):
        for other in range(2):
            strands = np.zeros(2)
            for i in range(SEEN):
                for j in range(SEEN):
                    strands[j % 2] += a[row, SEEN * i + j] * b[other, SEEN * j + i]
            noise[row, other] += 0.5 * (strands[0] + strands[1])


@kernel
def _add_second_order(
    scratch: Record,
    groups: Record,
    points: Matrix,
    which: Vector,
    nearer: Matrix,
    by_marker: Matrix,
    bends: Matrix,
    noise: Matrix,
    ld: Matrix,
    sensitivities: Matrix,
    shown: int,
) -> None:
    """Shift the residuals of groups (k,) by the mean of the second order, and add its covariance to the noise."""
    P, count = scratch["seen_covariance"], groups.shape[0]
    _write_seen_covariance(ld, P)
    _add_lasting_covariance(sensitivities, min(FOCAL_LENGTH, shown), P)
    for row in range(2 * count):
        group, k = groups[row // 2], row % 2
        s = points[int(which[row // 2])]
        mean = _write_bend(group["gradient"][k], nearer[row // 2], by_marker[row], s, P, bends[row])
        group["residual"][k] -= mean
    for first in range(0, 2 * count, 2):
        for second in range(0, first + 1, 2):
            block = noise[first : first + 2, second : second + 2]
            _add_half_traces(bends[first : first + 2], bends[second : second + 2], block)
            for row in range(first, first + 2):
                for other in range(second, second + 2):
                    noise[other, row] = noise[row, other]


@kernel
def _half_log_determinant(noise: Matrix, factor: Matrix) -> float:
    """Half of ln |noise|, (n, n); zero where it is not positive definite. factor (n, n) or more: scratch."""
    if not cholesky(noise, 0.0, factor):
        return 0.0
    total = 0.0
    for i in range(noise.shape[0]):
        total += math.log(factor[i, i])
    return total


@kernel
def new_noise(m: PoseMemory, row: int, other: int, covariances: Stack) -> float:
    """What is new in an image of the covariance of two rows: the chaser's attitude and the spots themselves."""
    a, b, noise, attitude = m.turns[row], m.turns[other], m.camera["noise"], m.camera["attitude_noise"]
    total = attitude * attitude * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
    if covariances.shape[0] == 0:
        total += noise * noise if row == other else 0.0
    elif row // 2 == other // 2:
        total += covariances[int(m.which[row // 2]), row % 2, other % 2]
    return float(total)


@kernel
def observe_markers(
    m: PoseMemory, track: Record, sensitivities: Matrix, spots: Matrix, covariances: Stack
) -> tuple[int, int]:
    """Write the groups of the spots (n, 2) px that can be used, about a track; (markers seen, groups).

    sensitivities (m, 12) of the track: what it has not taken up of lasting errors is in the noise, and in `by_error`.
    covariances (n, 2, 2) px^2, or (0, 2, 2): the camera's noise. A spot off the image, or of a marker expected behind
    the camera, is seen and not used. `bending` in scratch: by how much the second order makes ln |noise| larger.
    """
    pose, seen, count = m.scratch["pose"], 0, 0
    pose_of(m.camera, track, pose)
    for marker in range(spots.shape[0]):
        if has_spot(spots, marker):
            seen += 1
            i, j = 2 * count, 2 * count + 2
            group, nearer, q, turns = m.groups[count], m.nearer[count], m.by_marker[i:j], m.turns[i:j]
            if _linearise(m.camera, m.scratch, m.points[marker], spots[marker], group, nearer, q, turns):
                m.which[count], group["rows"], group["tested"] = marker, 2, 1
                _write_lasting(m.camera, m.scratch, m.lasting, marker, q, turns, m.by_error[i:j])
                count += 1
    for row in range(2 * count):
        for other in range(row + 1):
            m.noise[row, other] = new_noise(m, row, other, covariances)
    by_error = m.by_error[: 2 * count]
    subtract_taken(m.groups[:count], by_error, sensitivities, 0, by_error.shape[1])
    add_lasting_noise(by_error, m.noise)
    n = 2 * count
    before = _half_log_determinant(m.noise[:n, :n], m.factor)
    _add_second_order(
        m.scratch,
        m.groups[:count],
        m.points,
        m.which,
        m.nearer,
        m.by_marker,
        m.bends,
        m.noise,
        track["ld"],
        sensitivities,
        m.lasting["shown"],
    )
    m.scratch["bending"] = 2.0 * max(0.0, _half_log_determinant(m.noise[:n, :n], m.factor) - before)
    for k in range(count):
        variance = m.groups[k]["variance"]
        variance[0], variance[1] = m.noise[2 * k, 2 * k], m.noise[2 * k + 1, 2 * k + 1]
    return seen, count
