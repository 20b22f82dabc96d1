"""Liu et al. (2013) as published: the depth iteration it sets out to replace, and its small-angle solution.

Liu, Xu, Xu (2013), "Vision-based relative navigation for autonomous rendezvous and docking of spacecraft".
Only the first pages of the paper survive; equations (2) and (3) are reconstructed from its text. The paper's camera
axes are x right, y along the boresight, z up, its image coordinates a = u/f along x and beta = w/f along z. Here, in
camera axes (x right, y down, z boresight), a = x and beta = -y of the normalised image; the closed forms keep the
paper's axes.

The small-angle solution neglects terms of second order in the angles. With one marker raised toward the camera its
error is about 0.007 deg per square degree, whatever the range. With all markers in one plane that faces the camera the
neglected foreshortening is read as perspective, and the error, about theta^2 r / (2 R), grows with the range.
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.geometry.rotation_vector import turn_by_rotation_vector


def depth_iteration(rays: Matrix, points_m: Matrix, start_m: Vector, *, most: int = 50) -> tuple[Vector, int]:
    """Slant distances of three markers by Newton's method on eq. (2), the iteration that the paper criticises.

        |d_i m_i - d_j m_j|^2 = |s_i - s_j|^2,   (i, j) = (1, 2), (1, 3), (2, 3)                                   (2)

    Parameters
    ----------
    rays : (3, 3)
        Unit vectors toward the markers, rows.
    points_m : (3, 3)
        Markers in target axes, m, rows.
    start_m : (3,)
        Distances to start from, m: the result depends on them.
    most : int
        Steps after which it is given up.

    Returns
    -------
    Distances (3,) m, NaN if it did not converge (whichever root it converged to), and the steps taken.
    """
    m, s = np.asarray(rays, dtype=np.float64), np.asarray(points_m, dtype=np.float64)
    d = np.array(start_m, dtype=np.float64)
    pairs = ((0, 1), (0, 2), (1, 2))
    side2 = np.array([np.sum((s[i] - s[j]) ** 2) for i, j in pairs])
    for count in range(1, most + 1):
        jacobian, miss = np.zeros((3, 3)), np.empty(3)
        for row, (i, j) in enumerate(pairs):
            between = d[i] * m[i] - d[j] * m[j]
            miss[row] = between @ between - side2[row]
            jacobian[row, i], jacobian[row, j] = 2.0 * (between @ m[i]), -2.0 * (between @ m[j])
        try:
            step = np.linalg.solve(jacobian, miss)
        except np.linalg.LinAlgError:
            break
        d -= step
        if not np.isfinite(d).all():
            break
        if np.abs(step).max() < 1e-12 * np.abs(d).max():
            return d, count
    return np.full(3, np.nan), most


def small_angle(xy: Matrix, points_m: Matrix, dcm_cam_from_target: Matrix, *, passes: int = 1) -> Matrix:
    """Pose whose attitude differs little from a given one: the paper's analytic solution for any layout, eq. (3).

    With C = C0 (I + [phi x]) a marker stands at p = r + C0 s - C0 [s x] phi, and its image gives two rows e with
    e . p = 0, linear in (r, phi):

        e^T r - e^T C0 [s x] phi = -e^T C0 s,     e = (1, 0, -x) and (0, 1, -y)                                    (3)

    Parameters
    ----------
    xy : (n, 2)
        Normalised image of n >= 3 markers; for n > 3 the rows are solved by least squares.
    points_m : (n, 3)
        Markers in target axes, m.
    dcm_cam_from_target : (3, 3)
        C0, about which the angles are small.
    passes : int
        One is the paper's; each further pass starts from the attitude of the last, and the solution becomes exact.

    Returns
    -------
    (4, 3): rows 0-2 dcm_cam_from_target, row 3 the target's origin in camera axes, m. NaN where (3) is singular.
    """
    xy, s = np.asarray(xy, dtype=np.float64), np.asarray(points_m, dtype=np.float64)
    pose = np.empty((4, 3))
    dcm = np.array(dcm_cam_from_target, dtype=np.float64)
    zero, one = np.zeros(len(xy)), np.ones(len(xy))
    e = np.concatenate([np.stack([one, zero, -xy[:, 0]], axis=-1), np.stack([zero, one, -xy[:, 1]], axis=-1)])
    both = np.concatenate([s, s])
    for _ in range(passes):
        turned = e @ dcm
        rows = np.concatenate([e, np.cross(both, turned)], axis=-1)  # -q^T [s x] = (s x q)^T
        right = -np.sum(turned * both, axis=-1)
        if not np.isfinite(rows).all():
            return np.full((4, 3), np.nan)
        solution, _, rank, _ = np.linalg.lstsq(rows, right)
        if rank < 6:
            return np.full((4, 3), np.nan)
        turn_by_rotation_vector(dcm, solution[3:], pose)
        pose[3] = solution[:3]
        dcm = pose[:3].copy()
    return pose


def closed_form_flat(a: Vector, beta: Vector, points_m: Matrix) -> tuple[Vector, Vector]:
    """Closed form of eq. (3) with C0 = I for three markers in the plane s_y = 0, the paper's axes.

    Parameters
    ----------
    a, beta : (3,)
        Normalised image coordinates along the paper's x and z.
    points_m : (3, 3)
        Markers, paper's axes, m: every y is zero.

    Returns
    -------
    Position r (3,) m and small angles phi (3,) rad, paper's axes.
    """
    s = np.asarray(points_m, dtype=np.float64)
    d = s[1:] - s[0]
    dx, dz = d[:, 0], d[:, 2]
    ai, bi = np.asarray(a)[1:], np.asarray(beta)[1:]
    a1, b1 = float(a[0]), float(beta[0])
    Y, phi_y = np.linalg.solve(np.stack([ai * b1 - bi * a1, -(ai * dx + bi * dz)], axis=-1), bi * dx - ai * dz)
    along_x = ai * (dx - (ai - a1) * Y + dz * phi_y)
    along_z = bi * (dz - (bi - b1) * Y - dx * phi_y)
    phi_x, phi_z = np.linalg.solve(np.stack([-dz, dx], axis=-1), (along_x + along_z) / (ai**2 + bi**2))
    s1x, s1z = s[0, 0], s[0, 2]
    r = np.array([a1 * Y - s1x - phi_y * s1z, Y - phi_z * s1x + phi_x * s1z, b1 * Y - s1z + phi_y * s1x])
    return r, np.array([phi_x, phi_y, phi_z])


def closed_form_raised(a: Vector, beta: Vector, b: float, c: float, h: float, e: float) -> tuple[Vector, Vector]:
    """Closed form of eq. (3) with C0 = I for a symmetric layout with its third marker raised, the paper's axes.

    Parameters
    ----------
    a, beta : (3,)
        Normalised image coordinates along the paper's x and z.
    b, c, h, e : float
        Layout s1 = (-b, 0, -c), s2 = (b, 0, -c), s3 = (0, -h, e), m: h > 0 is toward the camera.

    Returns
    -------
    Position r (3,) m and small angles phi (3,) rad, paper's axes.
    """
    a1, a2, a3 = (float(value) for value in a)
    b1, b2, b3 = (float(value) for value in beta)
    q = c + e
    matrix = np.array(
        [
            [a2 - a1, a1 + a2, 0.0],
            [
                a3 - 0.5 * (a1 + a2) + 0.5 * q * (b2 - b1) / b,
                -0.5 * (a2 - a1) + 0.5 * q * (b1 + b2) / b - h / b,
                -a3 * q,
            ],
            [b3 - 0.5 * (b1 + b2), -0.5 * (b2 - b1), h - b3 * q],
        ]
    )
    Y, D, phi_x = (float(value) for value in np.linalg.solve(matrix, np.array([2.0 * b, a3 * h, b3 * h + q])))
    phi_y = -((b2 - b1) * Y + (b1 + b2) * D) / (2.0 * b)
    r = np.array(
        [
            c * phi_y + 0.5 * (a1 * (Y - D) + a2 * (Y + D)),
            Y - c * phi_x,
            c + 0.5 * (b1 * (Y - D) + b2 * (Y + D)),
        ]
    )
    return r, np.array([phi_x, phi_y, D / b])
