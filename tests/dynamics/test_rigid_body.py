"""Rotation in orbit: against closed forms, an integration of other hands, and the linearisation against differences."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from relnav.dynamics.rigid_body import LARGEST_TURN_RAD, MOST_STEPS, RigidBody, lvlh_rate, propagate_into
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.mission import Orbit
from relnav.simulation.target_rotation import lvlh_from_inertial, rotate_target

N = 1.1313666536110223e-3
INERTIA = np.array([[3000.0, 120.0, -80.0], [120.0, 4200.0, 60.0], [-80.0, 60.0, 4700.0]])


def test_axisymmetric_body_in_free_space():
    """The rate about the axis is constant; the transverse part turns at (Jz - Jt) / Jt of it."""
    body = RigidBody(np.diag([100.0, 100.0, 150.0]), 0.0)
    w0 = np.array([0.02, -0.01, 0.05])
    dcm, w = body.propagate(np.eye(3), w0, 100.0)
    angle = 0.5 * w0[2] * 100.0
    turn = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    np.testing.assert_allclose(w, turn @ w0, atol=1e-9)
    momentum = body.inertia @ w0
    np.testing.assert_allclose(dcm @ body.inertia @ w, momentum, atol=1e-6)


def test_gravity_gradient_libration():
    """Small pitch oscillates at n sqrt(3 (J_roll - J_yaw) / J_pitch) (Hughes 1986, section 9.2)."""
    roll, pitch, yaw = 4000.0, 4500.0, 3000.0
    body = RigidBody(np.diag([roll, pitch, yaw]), N)
    frequency = N * np.sqrt(3.0 * (roll - yaw) / pitch)
    tilt = 1e-4
    start = Rotation.from_rotvec([0.0, tilt, 0.0]).as_matrix()
    dcm, rate = body.propagate(start, lvlh_rate(start, N), np.pi / frequency)
    np.testing.assert_allclose(rotation_vector_between(dcm, np.eye(3)), [0.0, -tilt, 0.0], atol=1e-7 * tilt + 1e-10)
    np.testing.assert_allclose(rate, lvlh_rate(dcm, N), atol=1e-9)


def test_against_quaternions_in_inertial_space():
    body, rng = RigidBody(INERTIA, N), np.random.default_rng(3)
    t = np.arange(0.0, 60.01, 0.02)
    q = Rotation.random(3, rng=rng)
    w = np.radians(1.0) * rng.normal(size=(3, 3))
    dcm, rate = rotate_target(t, q.as_quat(), w, INERTIA, Orbit(N), 0.0, rng)
    for k in range(3):
        end, w_end = body.propagate(q[k].as_matrix(), w[k], 60.0)
        assert np.linalg.norm(rotation_vector_between(end, dcm[-1, k])) < 5e-9
        np.testing.assert_allclose(w_end, rate[-1, k], atol=1e-11)


def test_the_frame_turns_as_stated():
    """A body at rest in inertial space, seen from lvlh after a quarter orbit: nadir there is forward here."""
    t = 0.5 * np.pi / N
    np.testing.assert_allclose(lvlh_from_inertial(t, Orbit(N)).apply([0.0, 0.0, 1.0]), [1.0, 0.0, 0.0], atol=1e-12)
    dcm, _ = RigidBody(100.0 * np.eye(3), N).propagate(np.eye(3), np.zeros(3), t)
    np.testing.assert_allclose(dcm, lvlh_from_inertial(t, Orbit(N)).as_matrix(), atol=1e-8)


@pytest.mark.parametrize("dt", [0.1, 5.0, 40.0])
def test_transition_of_errors(dt):
    body, rng = RigidBody(INERTIA, N), np.random.default_rng(4)
    dcm = Rotation.random(rng=rng).as_matrix()
    w = np.radians([0.5, -0.3, 0.8])
    end, w_end, phi, _ = body.propagate_with_errors(dcm, w, dt, 0.0)
    eps = 1e-5
    for i in range(6):
        step = np.zeros(6)
        step[i] = eps
        ends = [body.propagate(turned(dcm, s * step[:3]), w + s * step[3:], dt) for s in (1.0, -1.0)]
        column = np.concatenate([rotation_vector_between(e[0], end) for e in ends]).reshape(2, 3)
        np.testing.assert_allclose((column[0] - column[1]) / (2 * eps), phi[:3, i], atol=1e-4 * dt)
        np.testing.assert_allclose((ends[0][1] - ends[1][1]) / (2 * eps), phi[3:, i], atol=1e-4)
    np.testing.assert_allclose(w_end, body.propagate(dcm, w, dt)[1], atol=1e-12)


def test_error_rates():
    """F against differences of the equations themselves, written here once more."""
    body, rng = RigidBody(INERTIA, 10.0 * N), np.random.default_rng(5)
    dcm, w = Rotation.random(rng=rng).as_matrix(), 0.01 * rng.normal(size=3)

    def acceleration(dcm, w):
        o = dcm.T @ [0.0, 0.0, 1.0]
        torque = 3.0 * (10.0 * N) ** 2 * np.cross(o, INERTIA @ o) - np.cross(w, INERTIA @ w)
        return np.linalg.solve(INERTIA, torque)

    F, eps = body.error_rates(dcm, w), 1e-6
    for i in range(3):
        step = np.zeros(3)
        step[i] = eps
        by_turn = (
            acceleration(dcm @ expm(cross_matrix(step)), w) - acceleration(dcm @ expm(cross_matrix(-step)), w)
        ) / (2 * eps)
        by_rate = (acceleration(dcm, w + step) - acceleration(dcm, w - step)) / (2 * eps)
        np.testing.assert_allclose(F[3:, i], by_turn, atol=1e-10)
        np.testing.assert_allclose(F[3:, 3 + i], by_rate, atol=1e-9)


def test_process_noise_of_a_body_at_rest():
    """White angular acceleration of density s: s t^3 / 3, s t^2 / 2 and s t of angle and rate, however many steps."""
    body, density = RigidBody(100.0 * np.eye(3), 0.0), 4e-10
    for t in (0.25, 3.0):
        *_, noise = body.propagate_with_errors(np.eye(3), np.zeros(3), t, density)
        parts = np.array([[t**3 / 3.0, 0.5 * t**2], [0.5 * t**2, t]])
        np.testing.assert_allclose(noise, density * np.kron(parts, np.eye(3)), rtol=1e-12, atol=1e-30)


def test_process_noise_is_that_of_many_small_steps():
    body = RigidBody(INERTIA, N)
    dcm, w = np.eye(3), np.radians([0.5, -0.3, 0.8])
    whole = body.propagate_with_errors(dcm, w, 10.0, 1e-8)[3]
    total = np.zeros((6, 6))
    for _ in range(1000):
        dcm, w, phi, added = body.propagate_with_errors(dcm, w, 0.01, 1e-8)
        total = phi @ total @ phi.T + added
    scale = np.sqrt(np.outer(np.diag(total), np.diag(total)))
    np.testing.assert_allclose(whole / scale, total / scale, atol=1e-2)


@pytest.mark.parametrize("torque", [None, [0.3, -0.2, 0.1]])
@pytest.mark.parametrize("dt", [0.1, 40.0])
def test_the_kernel_does_all_that_the_method_does(dt, torque):
    body, rng = RigidBody(INERTIA, N), np.random.default_rng(6)
    dcm, w = Rotation.random(rng=rng).as_matrix(), np.radians([0.5, -0.3, 0.8])
    expected = body.propagate_with_errors(dcm, w, dt, 1e-8, torque)
    alone = np.array(body.matrix)
    phi, q = np.full((6, 6), np.nan), np.full((6, 6), np.nan)
    assert propagate_into(alone, dt, dcm, w, 1e-8, phi, q, np.full((50, 6), np.nan))
    for got, value in zip((dcm, w, phi, q), expected, strict=True):
        np.testing.assert_array_equal(got, value)
    end, rate = body.propagate(Rotation.random(rng=np.random.default_rng(6)).as_matrix(), np.radians([0.5, -0.3, 0.8]),
                               dt, torque)  # fmt: skip
    np.testing.assert_allclose(dcm, end, atol=1e-12)
    np.testing.assert_allclose(w, rate, atol=1e-12)


@pytest.mark.parametrize(("rate", "dt"), [(3.0, 86400.0), (1e-3, 1e9), (np.nan, 1.0), (0.01, np.nan), (0.01, np.inf)])
def test_a_step_after_which_nothing_is_known(rate, dt):
    body, dcm, w = RigidBody(INERTIA, N), np.eye(3), np.array([0.0, rate, 0.0])
    phi, q = np.ones((6, 6)), np.ones((6, 6))
    assert not propagate_into(body.matrix, dt, dcm, w, 1e-12, phi, q, np.empty((50, 6)))
    np.testing.assert_array_equal(dcm, np.eye(3))
    np.testing.assert_array_equal(w, [0.0, rate, 0.0])
    assert (phi == 1.0).all()
    assert (q == 1.0).all()
    end, w_end, phi, noise = body.propagate_with_errors(dcm, w, dt, 1e-12)
    np.testing.assert_array_equal(end, dcm)
    np.testing.assert_array_equal(w_end, w)
    np.testing.assert_array_equal(phi, np.eye(6))
    np.testing.assert_allclose(np.sqrt(np.diag(noise)[:3]), np.pi)
    if np.isfinite(rate * dt):
        assert (np.sqrt(np.diag(noise)[3:]) >= 2.0 * rate).all()
    assert body.steps(w, dt) == 0
    np.testing.assert_array_equal(body.propagate(dcm, w, dt)[0], dcm)


def test_the_longest_step():
    body, w = RigidBody(INERTIA, 0.0), np.array([0.0, 0.0, 1e-2])
    longest = MOST_STEPS * LARGEST_TURN_RAD / 1e-2
    assert body.steps(w, 0.999 * longest) == pytest.approx(0.999 * MOST_STEPS, abs=1.0)
    assert body.steps(w, 1.001 * longest) == 0


@pytest.mark.parametrize(
    ("inertia", "text"),
    [
        (np.diag([1.0, 1.0, 3.0]), "none exceeds the sum"),
        (np.diag([1.0, 1.0, -1.0]), "positive"),
        (np.ones((2, 2)), "symmetric matrix"),
        (np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "symmetric matrix"),
    ],
)
def test_bodies_that_do_not_exist(inertia, text):
    with pytest.raises(ValueError, match=text):
        RigidBody(inertia, N)
