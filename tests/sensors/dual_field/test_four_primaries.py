"""The patent's method: right whenever its four brightest spots are stars, if it has the exact angle."""

import numpy as np
import pytest

from relnav.sensors.dual_field.fold import fold_rays
from relnav.sensors.dual_field.four_primaries import build_four_sky, identify_patent, primaries, right_handed
from relnav.sensors.dual_field.solution import StarStatus
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

WIDTH = np.radians(14.0)


@pytest.fixture(scope="module")
def sky(sensor):
    part = slice(0, int(np.sum(sensor.catalogue.hp_mag <= 5.6)))
    return build_four_sky(sensor.catalogue.directions(2026.0, stars=part), sensor.catalogue.hip[part], WIDTH)


def outcomes(sensor, sky, as_rays, count, seed, literal=False, **conditions):
    """Of frames: whether the four brightest are stars, solution, frame."""
    simulator = StarFieldSimulator(sensor, SkyConditions(faintest_mag=5.3, missing=0.03, **conditions))
    rng = np.random.default_rng(seed)
    for _ in range(count):
        frame = simulator.frame(rng)
        u, sigma = as_rays(frame, sensor)
        yield (
            bool(np.all(frame.hip[:4] > 0)),
            identify_patent(u, sky, fold=sensor.fold.matrix, sigma_rad=sigma, literal=literal),
            frame,
        )


def right(solution, frame):
    return solution.ok and np.trace(solution.dcm_cam_from_icrs @ frame.dcm_cam_from_icrs.T) > 3.0 - 1e-7


def test_without_false_spots(sensor, sky, as_rays):
    results = list(outcomes(sensor, sky, as_rays, 100, 1, false_spots=0))
    good = [(solution, frame) for _, solution, frame in results if right(solution, frame)]
    assert len(good) >= 95  # a close pair may fit a second quadruple
    assert all(solution.status is StarStatus.AMBIGUOUS for _, solution, frame in results if not right(solution, frame))
    stars = sum(np.sum((frame.hip > 0) & (solution.hip == frame.hip)) for solution, frame in good)
    assert stars >= 0.98 * sum(np.sum(frame.hip > 0) for _, frame in good)
    for solution, frame in good:
        both = (solution.hip > 0) & (frame.hip > 0)
        assert np.array_equal(solution.field[both], frame.field[both])


def test_one_false_spot_among_the_four_brightest_ends_it(sensor, sky, as_rays):
    results = list(outcomes(sensor, sky, as_rays, 100, 2, false_spots=5))
    assert all(not right(solution, frame) for four, solution, frame in results if not four)
    four = [right(solution, frame) for four, solution, frame in results if four]
    assert 10 < len(four) < 80
    assert np.mean(four) > 0.9


def test_the_printed_angle_solves_only_one_field_frames(sensor, sky, as_rays):
    """The 90 deg -+ a of the patent finds what lies in one field, and next to nothing across both."""
    results = list(outcomes(sensor, sky, as_rays, 100, 1, literal=True, false_spots=0))
    across = [right(s, f) for _, s, f in results if len(set(f.field[:4])) == 2]
    within = [right(s, f) for _, s, f in results if len(set(f.field[:4])) == 1]
    assert len(across) > 60
    assert np.mean(across) < 0.1
    assert np.mean(within) > 0.8


def test_handedness_chooses_between_the_two_solutions(sensor):
    rng = np.random.default_rng(3)
    v = rng.normal(size=(4, 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert right_handed(v @ turn.T, v)
    assert not right_handed(v @ turn.T @ sensor.fold.matrix, v)


def test_every_quadruple_found_has_the_six_angles(sensor, sky):
    """At a wide tolerance random spots fit something: what is returned does fit, and is right-handed."""
    rng = np.random.default_rng(4)
    M, tolerance, found = sensor.fold.matrix, np.radians(200.0 / 3600.0), 0
    for _ in range(30):
        u = np.column_stack([rng.uniform(-0.1, 0.1, (4, 2)), np.ones(4)])
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        for row in primaries(u, sky, M, tolerance):
            w, v = fold_rays(u, row[4:], M), sky.directions[row[:4]]
            difference = np.arccos(np.clip(w @ w.T, -1, 1)) - np.arccos(np.clip(v @ v.T, -1, 1))
            assert np.abs(difference[np.triu_indices(4, 1)]).max() <= tolerance * 1.001
            assert right_handed(w, v)
            found += 1
    assert found > 3


def test_it_is_for_a_mirror(turned_sensor, sky):
    with pytest.raises(ValueError, match="the patent's method is for a mirror"):
        primaries(np.eye(4, 3), sky, turned_sensor.fold.matrix, 1e-4)


def test_three_spots_are_too_few(sensor, sky):
    solution = identify_patent(np.eye(3), sky, fold=sensor.fold.matrix, sigma_rad=np.full(3, 1e-5))
    assert solution.status is StarStatus.TOO_FEW
