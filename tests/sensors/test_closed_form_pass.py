"""One pass of the closed form for three beacons near by: the true pose stays, a near one comes nearer."""

import numpy as np
import pytest

from relnav.sensors.measurement import OK, OUTSIDE_DOMAIN
from relnav.sensors.three_beacon.invariants import invariant_gradients, invariants, rays_from_position
from relnav.sensors.three_beacon.perspective import _closed_form_pass, inside_domain, settle, solve_perspective

A, B = 0.3, 0.5


def seen_from(p, truth_turn):
    """Unit vectors (3, 3) to the beacons and (3,) to O, in the axes of a camera at p."""
    beacons = np.array([[0.0, A, 0.0], [0.0, -A, 0.0], [B, 0.0, 0.0], [0.0, 0.0, 0.0]]) - p
    rays = beacons / np.linalg.norm(beacons, axis=1)[:, None] @ truth_turn.T
    return rays[:3].copy(), rays[3].copy()


@pytest.mark.parametrize("p", [(4.0, 1.0, -0.5), (2.0, -0.3, 0.8), (1.5, 0.2, 0.1), (9.0, -3.0, 2.0)])
def test_the_true_pose_stays(p):
    p = np.array(p)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    u, w = seen_from(p, turn)
    guess, line = p.copy(), w.copy()
    assert _closed_form_pass(u, A, B, line, guess, np.zeros((6, 3)))
    np.testing.assert_allclose(guess, p, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(line, w, rtol=0.0, atol=1e-12)
    near, line = 1.05 * p, w.copy()
    assert _closed_form_pass(u, A, B, line, near, np.zeros((6, 3)))
    assert np.linalg.norm(near - p) < 0.05 * np.linalg.norm(p)


def test_a_beacon_behind_is_refused():
    u, w = seen_from(np.array([4.0, 1.0, -0.5]), np.eye(3))
    u[2] = -u[2]
    assert not _closed_form_pass(u, A, B, w, np.array([4.0, 1.0, -0.5]), np.zeros((6, 3)))


def test_newton_ends_at_the_position_or_says_that_it_does_not():
    """From 300 places, some of them far off or behind: where it settles, the invariants are those that were seen."""
    rng, ended = np.random.default_rng(5), []
    for _ in range(300):
        p = np.array([rng.uniform(1.0, 9.0), rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)])
        g, u, distance = np.empty(3), np.empty((3, 3)), np.empty(3)
        rays_from_position(p, A, B, u, distance)
        invariants(u, g)
        q = p * rng.uniform(0.2, 5.0) + rng.normal(size=3) * rng.choice([0.01, 1.0, 3.0])
        if settle(g, A, B, q, np.empty((3, 3))):
            got = np.empty(3)
            rays_from_position(q, A, B, u, distance)
            invariants(u, got)
            assert np.abs(got - g).max() < 1e-13
            ended.append(np.linalg.norm(q - p) < 1e-9 * np.linalg.norm(p))
    assert len(ended) > 40
    assert sum(ended) > 0.8 * len(ended)


def at(range_m, angle_deg, around_deg=70.0):
    """A place so far off the axis of the beacons, around it by an angle."""
    angle, around = np.radians([angle_deg, around_deg])
    return range_m * np.array([np.cos(angle), np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around)])


@pytest.mark.parametrize("around_deg", [0.0, 70.0, 200.0])
@pytest.mark.parametrize(("below_deg", "least"), [(10.0, 1.2), (20.0, 1.54), (30.0, 2.0), (45.0, 3.0), (60.0, 5.0)])
def test_where_there_is_one_pose_alone(below_deg, least, around_deg):
    """Off-axis angle against r / b, in steps: just inside both limits, beyond the one, beyond the other."""
    angle = below_deg - 0.1
    assert inside_domain(at(1.001 * least * B, angle, around_deg), B)
    assert not inside_domain(at(0.999 * least * B, angle, around_deg), B)
    assert not inside_domain(at(1.001 * least * B, below_deg + 0.1, around_deg), B)
    assert not inside_domain(-at(1.001 * least * B, angle, around_deg), B)


def test_behind_and_beyond_sixty_degrees_there_is_none():
    assert not inside_domain(at(100.0, 61.0), B)
    assert not inside_domain(np.array([0.0, 5.0, 5.0]), B)


@pytest.mark.parametrize("p", [(4.0, 1.0, -0.5), (2.0, -0.3, 0.8), (9.0, -3.0, 2.0), (30.0, 4.0, -7.0)])
def test_the_whole_solution(p):
    """Whatever was in the place of the answer, and in the scratch, before."""
    p = np.array(p)
    u, _ = seen_from(p, np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0])
    u = u if np.linalg.det(u) * np.linalg.det(seen_from(p, np.eye(3))[0]) > 0.0 else -u
    got = np.array([5.0, -7.0, 9.0])
    assert solve_perspective(u, A, B, got, np.full((12, 6), 3.0)) == OK
    np.testing.assert_allclose(got, p, rtol=1e-9)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("around_deg", [0.0, 90.0, 270.0])
def test_the_whole_solution_in_any_unit_and_from_any_side(unit, around_deg):
    p = at(10.0 * B, 55.0, around_deg)
    u, _ = seen_from(p, np.eye(3))
    got = np.zeros(3)
    assert solve_perspective(u, A * unit, B * unit, got, np.zeros((12, 6))) == OK
    np.testing.assert_allclose(got, unit * p, rtol=0.0, atol=1e-11 * unit)


def test_a_solution_outside_the_domain_says_so():
    p = at(4.0 * B, 50.0)
    u, _ = seen_from(p, np.eye(3))
    assert solve_perspective(u, A, B, np.zeros(3), np.zeros((12, 6))) == OUTSIDE_DOMAIN


def test_gradients_of_the_invariants_whatever_was_there_before():
    u = seen_from(np.array([4.0, 1.0, -0.5]), np.eye(3))[0]
    out, numeric = np.full((9, 3), np.nan), np.empty((9, 3))
    invariant_gradients(u, out)
    for beacon in range(3):
        for axis in range(3):
            step, ahead, behind = np.zeros((3, 3)), np.empty(3), np.empty(3)
            step[beacon, axis] = 1e-6
            invariants(u + step, ahead)
            invariants(u - step, behind)
            numeric[beacon::3, axis] = (ahead - behind) / 2e-6
    np.testing.assert_allclose(out, numeric, atol=1e-9)
