"""P3P: the true pose is always among the solutions, every solution reprojects, and nobody else finds more."""

import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.codegen.kernel import is_compiled, kernel
from relnav.geometry.p3p import BLOCK, camera_in_target, p3p, solve_p3p

RANDOM_VIEWS = 10_000  # a tenth of the campaign of benchmarks/three_marker_p3p.py
T3 = np.array([[-0.3, 0.3, 0.0], [0.3, 0.3, 0.0], [0.0, 0.0, -0.3]])


def equilateral(radius=0.3):
    angle = np.radians([90.0, 210.0, 330.0])
    return radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)


def rays_of(points, dcm, position):
    p = points @ np.asarray(dcm).T + position
    return p / np.linalg.norm(p, axis=1)[:, None]


def error(poses, dcm, position):
    """Of the solution nearest to the truth."""
    sizes = [max(np.abs(q[:3] - dcm).max(), np.linalg.norm(q[3] - position) / np.linalg.norm(position)) for q in poses]
    return min(sizes, default=np.inf)


def random_view(rng):
    while True:
        points, dcm = rng.normal(size=(3, 3)), Rotation.random(random_state=rng).as_matrix()
        position = np.array([*rng.uniform(-3.0, 3.0, 2), rng.uniform(2.0, 20.0)])
        if ((points @ dcm.T + position)[:, 2] > 0.1).all():
            return points, dcm, position


def symmetric_view(rng):
    """Exactly on the axis of a pattern with two equal sides or three: a pencil's leading coefficient vanishes."""
    b, c, h, kind = rng.uniform(0.1, 0.6), rng.uniform(0.1, 0.6), rng.uniform(-0.5, 0.5), rng.integers(4)
    points = (
        np.array([[-b, c, 0.0], [b, c, 0.0], [0.0, 0.0, h]]),
        np.array([[-b, c, 0.0], [b, c, 0.0], [0.0, -c, h]]),
        np.array([[-b, 0.0, 0.0], [b, 0.0, 0.0], [0.0, 0.0, 0.6 + h]]),
        equilateral(b),
    )[kind]
    roll = rng.choice([0.0, 90.0, 180.0, rng.uniform(0.0, 360.0)])
    dcm = Rotation.from_euler("z", roll, degrees=True).as_matrix()
    return points, dcm, np.array([0.0, 0.0, rng.uniform(2.0, 100.0)])


def grunert_roots(points, rays):
    """Positive real roots of Grunert's quartic in v = d3 / d1 (1841): another elimination, numpy's eigenvalues."""
    a2, b2, c2 = (np.sum((points[i] - points[j]) ** 2) for i, j in ((1, 2), (0, 2), (0, 1)))
    ca, cb, cg = rays[1] @ rays[2], rays[0] @ rays[2], rays[0] @ rays[1]
    q, p = (a2 - c2) / b2, (a2 + c2) / b2
    coefficients = [
        (q - 1) ** 2 - 4 * c2 / b2 * ca**2,
        4 * (q * (1 - q) * cb - (1 - p) * ca * cg + 2 * c2 / b2 * ca**2 * cb),
        2 * (
            q**2 - 1 + 2 * q**2 * cb**2 + 2 * (b2 - c2) / b2 * ca**2 - 4 * p * ca * cb * cg
            + 2 * (b2 - a2) / b2 * cg**2
        ),
        4 * (-q * (1 + q) * cb + 2 * a2 / b2 * cg**2 * cb - (1 - p) * ca * cg),
        (1 + q) ** 2 - 4 * a2 / b2 * cg**2,
    ]  # fmt: skip
    values = np.roots(coefficients)
    count, margin = 0, np.inf
    for v in values:
        u = ((-1 + q) * v**2 - 2 * q * cb * v + 1 + q) / (2 * (cg - v * ca))
        margin = min(margin, abs(v.imag) if abs(v.imag) > 1e-6 else np.inf)
        count += abs(v.imag) < 1e-6 and v.real > 0 and u.real > 0
    separation = min(abs(x - y) for i, x in enumerate(values) for y in values[:i])
    return count, min(margin, separation)


def test_no_random_view_is_missed():
    rng = np.random.default_rng(11)
    worst = 0.0
    for _ in range(RANDOM_VIEWS):
        points, dcm, position = random_view(rng)
        rays = rays_of(points, dcm, position)
        poses = p3p(rays, points)
        worst = max(worst, error(poses, dcm, position))
        for pose in poses:
            np.testing.assert_allclose(rays_of(points, pose[:3], pose[3]), rays, atol=1e-9)
            np.testing.assert_allclose(pose[:3] @ pose[:3].T, np.eye(3), atol=1e-12)
            assert np.linalg.det(pose[:3]) > 0.0
    assert worst < 1e-8


def test_no_symmetric_view_is_missed():
    rng = np.random.default_rng(12)
    errors = []
    for _ in range(600):
        points, dcm, position = symmetric_view(rng)
        errors.append(error(p3p(rays_of(points, dcm, position), points), dcm, position))
    assert max(errors) < 1e-8


@pytest.mark.parametrize(("nearest", "farthest"), [(1.0, 5.0), (5.0, 20.0), (20.0, 100.0), (100.0, 1000.0)])
def test_head_on_equilateral_has_its_four_solutions(nearest, farthest):
    """The true one, and three tilted by about 2 R / r (exactly symmetric, so that all four are real)."""
    rng = np.random.default_rng(13)
    for _ in range(100):
        r = rng.uniform(nearest, farthest)
        poses = p3p(rays_of(equilateral(), np.eye(3), [0.0, 0.0, r]), equilateral())
        assert len(poses) == 4
        tilts = sorted(Rotation.from_matrix(pose[:3]).magnitude() for pose in poses)
        assert tilts[0] < 1e-9
        np.testing.assert_allclose(tilts[1:], 2.0 * 0.3 / r, rtol=2.0 / r**2 + 1e-9)


def test_all_real_solutions_are_found():
    """As many as Grunert's quartic has positive real roots, where those are clear of one another."""
    rng = np.random.default_rng(14)
    compared = 0
    for _ in range(3000):
        points, dcm, position = random_view(rng)
        rays = rays_of(points, dcm, position)
        count, margin = grunert_roots(points, rays)
        if margin > 1e-3:
            compared += 1
            assert len(p3p(rays, points)) == count
    assert compared > 2000


def test_at_least_as_complete_as_others(outside):
    """OpenCV's two solvers and PoseLib, same views: nobody finds a true pose that is missed here."""
    cv2 = pytest.importorskip("cv2", reason="OpenCV, one of the other solvers, is not installed")
    poselib = pytest.importorskip("poselib", reason="PoseLib, one of the other solvers, is not installed")
    rng = np.random.default_rng(15)
    found = dict.fromkeys(("relnav", "poselib", "P3P", "AP3P"), 0)
    views = [random_view(rng) for _ in range(300)] + [symmetric_view(rng) for _ in range(300)]
    for points, dcm, position in views:
        rays = rays_of(points, dcm, position)
        image = rays[:, :2] / rays[:, 2:]
        results = {"relnav": p3p(rays, points)}
        results["poselib"] = [np.vstack([q.R, q.t]) for q in poselib.p3p(list(rays), list(points))]
        for name, flag in (("P3P", cv2.SOLVEPNP_P3P), ("AP3P", cv2.SOLVEPNP_AP3P)):
            _, turns, places = cv2.solveP3P(points, image, np.eye(3), None, flags=flag)
            results[name] = [np.vstack([cv2.Rodrigues(v)[0], t.T]) for v, t in zip(turns, places, strict=True)]
        for name, poses in results.items():
            found[name] += error([q for q in poses if np.isfinite(q).all()], dcm, position) < 1e-6
    for name, other in (("PoseLib p3p", "poselib"), ("OpenCV SOLVEPNP_P3P", "P3P"), ("OpenCV SOLVEPNP_AP3P", "AP3P")):
        told = f"true poses of {len(views)} views that are missed here; missed there: {len(views) - found[other]}"
        outside(name, told, len(views) - found["relnav"], 0)
    assert 0 < max(found["poselib"], found["P3P"], found["AP3P"]) < len(views)  # the symmetric ones defeat them


def test_order_of_the_points_does_not_matter():
    rng = np.random.default_rng(16)
    points, dcm, position = random_view(rng)
    rays = rays_of(points, dcm, position)
    sizes = set()
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1]):
        poses = p3p(rays[order], points[order])
        sizes.add(len(poses))
        assert error(poses, dcm, position) < 1e-12
    assert len(sizes) == 1


@pytest.mark.parametrize("range_m", [1e-3, 1.0, 1e3, 1e6])
def test_any_scale(range_m):
    dcm = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    position = range_m * np.array([0.05, -0.02, 1.0])
    points = range_m * T3 / 5.0
    assert error(p3p(rays_of(points, dcm, position), points), dcm, position) < 1e-12


def view_from_the_danger_cylinder(rng, height):
    """Camera on the cylinder through the points along their normal, looking at their middle: a double solution."""
    side = rng.uniform(0.0, 2.0 * np.pi)
    camera = np.array([0.3 * np.cos(side), 0.3 * np.sin(side), -height])
    boresight = -camera / np.linalg.norm(camera)
    right = np.cross([0.0, 1.0, 0.0], boresight)
    right /= np.linalg.norm(right)
    dcm = np.array([right, np.cross(boresight, right), boresight])
    return dcm, -dcm @ camera


def test_double_solutions_are_found():
    """To about the root of the rounding, which is all that a double root gives (its cube root where three meet)."""
    rng = np.random.default_rng(20)
    errors = []
    for _ in range(1000):
        dcm, position = view_from_the_danger_cylinder(rng, rng.uniform(0.5, 10.0))
        errors.append(error(p3p(rays_of(equilateral(), dcm, position), equilateral()), dcm, position))
    assert np.quantile(errors, 0.98) < 1e-6
    assert max(errors) < 1e-3


def test_a_merged_pair_is_offered_as_a_start():
    """Noise that makes two solutions complex: without `near` they are gone, with it their real part is there."""
    rng = np.random.default_rng(17)
    lost = 0
    for _ in range(200):
        dcm, position = view_from_the_danger_cylinder(rng, 2.0)
        rays = rays_of(equilateral(), dcm, position) + 1e-5 * rng.normal(size=(3, 3))
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        lost += error(p3p(rays, equilateral()), dcm, position) > 0.1
        assert error(p3p(rays, equilateral(), near=True), dcm, position) < 0.1
    assert lost > 20


@pytest.mark.parametrize(
    ("rays", "points"),
    [
        (np.eye(3), np.zeros((3, 3))),
        (np.eye(3), np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]])),
        (np.tile([0.0, 0.0, 1.0], (3, 1)), T3),
        (np.full((3, 3), np.nan), T3),
        (np.eye(3), np.full((3, 3), np.nan)),
        (np.full((3, 3), np.inf), T3),
    ],
)
def test_nothing_to_solve(rays, points):
    assert len(p3p(rays, points)) == 0


def test_collinear_points_have_no_pose():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.5, 0.0, 0.0]])
    assert len(p3p(rays_of(points, np.eye(3), [0.0, 0.3, 5.0]), points)) == 0


def test_wrong_shapes():
    with pytest.raises(ValueError, match=r"rows of \(3, 3\), are expected; got shapes \(2, 3\), \(3, 3\)"):
        p3p(np.zeros((2, 3)), T3)


def test_where_the_camera_is():
    rng = np.random.default_rng(18)
    dcm, camera = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
    out = np.empty(3)
    camera_in_target(np.vstack([dcm, -dcm @ camera]), out)
    np.testing.assert_allclose(out, camera, atol=1e-14)


@pytest.mark.parametrize("off_axis_deg", [0.0, 20.0, 45.0, 70.0, 85.0, 110.0, 150.0])
def test_three_beacons_far_off_their_axis(off_axis_deg):
    """Equilateral triangle, a = 0.3 m, from any direction: the camera's position is among the results.

    It is that of Cai, Zhao, Sun, Qiao, Dai (1996),
    "Determination of target relative position and range by PSD optical sensor system".
    Its plane holds the docking axis, so that on the axis all three are seen on one line.
    """
    beacons = np.array([[0.0, 0.3, 0.0], [0.0, -0.3, 0.0], [0.3 * np.sqrt(3.0), 0.0, 0.0]])
    rng = np.random.default_rng(21)
    off = np.radians(off_axis_deg)
    for _ in range(200):
        turn, r = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.8, 10.0)
        camera = r * np.array([np.cos(off), np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn)])
        dcm = Rotation.random(random_state=rng).as_matrix()
        poses, found = p3p(rays_of(beacons, dcm, -dcm @ camera), beacons), np.empty(3)
        misses = []
        for pose in poses:
            camera_in_target(pose, found)
            misses.append(np.linalg.norm(found - camera) / r)
        assert min(misses) < 1e-6


@kernel
def _many(rays, points, poses, times):
    total = 0
    for _ in range(times):
        total += solve_p3p(rays, points, True, poses)
    return total


@pytest.mark.skipif(not is_compiled(), reason="plain Python allocates")
def test_compiled_code_allocates_nothing():
    from numba.core.runtime import _nrt_python, rtsys

    rays, poses = rays_of(T3, np.eye(3), [0.1, 0.0, 3.0]), np.empty((BLOCK, 4, 3))
    _many(rays, T3, poses, 1)
    was_on = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    counts = []
    for times in (0, 1, 1000):
        before = rtsys.get_allocation_stats().alloc
        _many(rays, T3, poses, times)
        counts.append(rtsys.get_allocation_stats().alloc - before)
    if not was_on:
        _nrt_python.memsys_disable_stats()
    assert counts[0] == counts[1] == counts[2]


PLAIN = """
import sys
import numpy as np
from relnav.codegen.kernel import is_compiled
from relnav.geometry.p3p import p3p
assert not is_compiled()
given = np.load(sys.argv[1])
np.savez(sys.argv[2], *[p3p(u, s) for u, s in zip(given["rays"], given["points"])])
"""


def test_plain_python_gives_the_same(tmp_path):
    rng = np.random.default_rng(19)
    views = [random_view(rng) for _ in range(30)] + [symmetric_view(rng) for _ in range(30)]
    rays, points = np.array([rays_of(*view) for view in views]), np.array([view[0] for view in views])
    np.savez(tmp_path / "in.npz", rays=rays, points=points)
    command = [sys.executable, "-c", PLAIN, str(tmp_path / "in.npz"), str(tmp_path / "out.npz")]
    subprocess.run(command, check=True, env=os.environ | {"RELNAV_JIT": "0"}, timeout=120)
    out = np.load(tmp_path / "out.npz")
    for k, view in enumerate(views):
        plain, own = out[f"arr_{k}"], p3p(rays[k], points[k])
        assert len(plain) == len(own)
        assert error(plain, view[1], view[2]) < 1e-8
