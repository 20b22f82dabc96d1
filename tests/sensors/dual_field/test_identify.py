"""The default method on simulated frames: right or refused, whatever is false, missing, moving or misaligned."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.dual_field_runs import fly_frames
from relnav.sensors.dual_field.solution import StarStatus
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator, random_velocity

REST = (0.0, 0.0, 0.0)
measure = relnav.dual_field.measure


def test_ten_thousand_superimposed_frames(sensor):
    """3 false spots, 5 % missing: none wrong, all solved, all axes below 3e-6 rad, an honest covariance."""
    runs = fly_frames(sensor, SkyConditions(), 10_000, 11, two_fields=True)
    assert runs.wrong == 0
    assert runs.missed == 0
    assert runs.solvable > 9_900
    assert np.all(runs.rms_rad < 3e-6)
    assert runs.nees == pytest.approx(3.0, abs=0.1)
    assert runs.wrong_stars <= 2e-4 * runs.true_stars


@pytest.mark.parametrize("false", [0, 1, 5, 10])
def test_false_spots_do_no_harm(sensor, false):
    runs = fly_frames(sensor, SkyConditions(false_spots=false), 300, false, two_fields=True)
    assert (runs.missed, runs.wrong) == (0, 0)
    assert runs.solvable > 290


def test_ten_thousand_frames_of_false_spots_alone(sensor):
    """None is given an attitude; `benchmarks/star_sensor.py false` has done it a million times."""
    simulator, rng = StarFieldSimulator(sensor, SkyConditions()), np.random.default_rng(1)
    for _ in range(10_000):
        spots, magnitude = simulator.false_frame(rng, int(rng.integers(4, 17)))
        assert not measure(spots, sensor, magnitude=magnitude, velocity_km_s=REST).ok


@pytest.mark.parametrize("kind", ["three times", "hot pixels", "2 % wrong", "distorted", "clusters", "grid"])
def test_spots_that_are_not_what_the_model_says(sensor, kind):
    """Solved rightly or refused with one sentence, whatever was done to the frame."""
    simulator, rng = StarFieldSimulator(sensor, SkyConditions()), np.random.default_rng(13)
    for _ in range(40):
        frame = simulator.frame(rng)
        s, m = frame.spots_px, frame.magnitude
        if kind == "three times":
            s, m = np.repeat(s, 3, axis=0), np.repeat(m, 3)
        elif kind == "hot pixels":
            s, m = np.concatenate([s, (rng.random((30, 2)) - 0.5) * 1400.0]), np.append(m, rng.uniform(1.0, 4.0, 30))
        elif kind == "2 % wrong":
            s = 1.02 * s
        elif kind == "distorted":
            s = s * (1.0 + 0.3 * np.sum((s / 8339.8) ** 2, axis=1))[:, None]
        elif kind == "clusters":
            s = np.repeat((rng.random((5, 2)) - 0.5) * 1400.0, 8, axis=0) + rng.normal(size=(40, 2)) * 0.1
            m = np.repeat(rng.uniform(2.0, 6.0, 5), 8)
        elif kind == "grid":
            s = np.stack(np.meshgrid(np.arange(7.0), np.arange(7.0)), axis=-1).reshape(-1, 2) * 200.0 - 600.0
            m = rng.uniform(2.0, 6.0, 49)
        solution = measure(s, sensor, magnitude=m, velocity_km_s=REST)
        if solution.ok:
            assert kind in ("three times", "hot pixels", "distorted")
            assert np.trace(solution.dcm_cam_from_icrs @ frame.dcm_cam_from_icrs.T) > 3.0 - 1e-7
        else:
            assert solution.reason
            assert solution.matches == 0


def test_every_solvable_frame_of_few_stars(sensor):
    """A shallow sky: three true stars in either field are enough; no frame is ever wrong."""
    conditions = SkyConditions(faintest_mag=4.6, false_spots=2)
    simulator, rng = StarFieldSimulator(sensor, conditions), np.random.default_rng(2)
    solved, solvable = 0, 0
    for _ in range(600):
        frame = simulator.frame(rng)
        solution = measure(frame.spots_px, sensor, magnitude=frame.magnitude, velocity_km_s=REST)
        enough = min(np.sum(frame.field == 0), np.sum(frame.field == 1)) >= 3
        solvable += enough
        solved += solution.ok and enough
        if solution.ok:
            assert np.trace(solution.dcm_cam_from_icrs @ frame.dcm_cam_from_icrs.T) > 2.9999
    assert solvable > 100
    assert solved >= 0.99 * solvable


def test_without_brightness(sensor, error_rad):
    simulator, rng = StarFieldSimulator(sensor, SkyConditions()), np.random.default_rng(3)
    deep = dataclasses.replace(
        sensor, identification=dataclasses.replace(sensor.identification, most_attitudes_tried=2_000_000)
    )
    for _ in range(60):
        frame = simulator.frame(rng)
        assert np.abs(error_rad(measure(frame.spots_px, deep, velocity_km_s=REST), frame)).max() < 3e-5


def test_spots_in_any_order_and_with_gaps(sensor):
    """With brightness the order does not matter; NaN and what lies off the detector is not used."""
    frame = StarFieldSimulator(sensor, SkyConditions()).frame(np.random.default_rng(4))
    plain = measure(frame.spots_px, sensor, magnitude=frame.magnitude, velocity_km_s=REST)
    order = np.random.default_rng(5).permutation(len(frame.hip) + 2)
    spots = np.concatenate([frame.spots_px, [[np.nan, 0.0], [5000.0, 0.0]]])[order]
    mixed = measure(spots, sensor, magnitude=np.append(frame.magnitude, [1.0, 1.0])[order], velocity_km_s=REST)
    np.testing.assert_allclose(mixed.dcm_cam_from_icrs, plain.dcm_cam_from_icrs, atol=1e-12)
    assert np.array_equal(mixed.hip, np.append(plain.hip, [0, 0])[order])
    assert np.array_equal(mixed.field, np.append(plain.field, [-1, -1])[order])


def test_flux_is_magnitude(sensor):
    frame = StarFieldSimulator(sensor, SkyConditions()).frame(np.random.default_rng(6))
    by_flux = measure(frame.spots_px, sensor, flux=10.0 ** (-0.4 * frame.magnitude), velocity_km_s=REST)
    by_magnitude = measure(frame.spots_px, sensor, magnitude=frame.magnitude, velocity_km_s=REST)
    assert np.array_equal(by_flux.hip, by_magnitude.hip)


def test_aberration_must_be_taken_into_account(sensor, error_rad):
    """30 km/s and no velocity given: errors of ten arcseconds, and fields lost; with it none of this."""
    simulator, rng = StarFieldSimulator(sensor, SkyConditions()), np.random.default_rng(7)
    with_it, without, one_field = [], [], 0
    for _ in range(150):
        frame = simulator.frame(rng, velocity_km_s=random_velocity(rng))
        if min(np.sum(frame.field == 0), np.sum(frame.field == 1)) < 3:
            continue
        good = measure(frame.spots_px, sensor, magnitude=frame.magnitude, velocity_km_s=frame.velocity_km_s)
        with_it.append(error_rad(good, frame))
        bad = measure(frame.spots_px, sensor, magnitude=frame.magnitude, velocity_km_s=REST)
        one_field += bad.status is not StarStatus.OK
        if bad.ok:
            without.append(np.linalg.norm(error_rad(bad, frame)))
    assert np.sqrt(np.mean(np.square(with_it))) < 3e-6
    assert np.median(without) > 3e-5


def test_a_turned_field_is_told_by_its_matches(turned_sensor, error_rad):
    """With a fold of determinant +1 handedness does not tell the fields apart: without the swap half would be wrong."""
    simulator, rng = StarFieldSimulator(turned_sensor, SkyConditions()), np.random.default_rng(9)
    for _ in range(200):
        frame = simulator.frame(rng)
        solution = measure(frame.spots_px, turned_sensor, magnitude=frame.magnitude, velocity_km_s=REST)
        assert solution.status is StarStatus.OK
        assert np.abs(error_rad(solution, frame)).max() < 3e-5
        true = (frame.hip > 0) & (solution.hip > 0)
        assert np.array_equal(solution.field[true], frame.field[true])


def test_one_turned_field_alone_is_ambiguous(turned_sensor, single_sensor):
    """Stars of one field, and two fields they may be: nothing can tell."""
    frame = StarFieldSimulator(single_sensor, SkyConditions()).frame(np.random.default_rng(10))
    solution = measure(frame.spots_px, turned_sensor, magnitude=frame.magnitude, velocity_km_s=REST)
    assert solution.status is StarStatus.AMBIGUOUS
    assert np.isnan(solution.dcm_cam_from_icrs).all()
    assert solution.matches == 0


def test_nothing_to_go_by(sensor):
    few = measure([[0.0, 0.0], [10.0, 10.0], [500.0, 3.0]], sensor, velocity_km_s=REST)
    assert few.status is StarStatus.TOO_FEW
    assert few.reason == "3 spots; 4 or more are needed"
    assert measure(np.empty((0, 2)), sensor, velocity_km_s=REST).status is StarStatus.TOO_FEW
    assert measure(np.full((9, 2), np.nan), sensor, velocity_km_s=REST).hip.shape == (9,)
    same = measure(np.zeros((20, 2)), sensor, magnitude=np.full(20, 4.0), velocity_km_s=REST)
    assert same.status is StarStatus.NO_MATCH


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spots_px": np.zeros(4)}, r"spots_px has shape \(n, 2\)"),
        ({"velocity_km_s": None}, "two fields need velocity_km_s"),
        ({"velocity_km_s": (1.0, 2.0)}, "velocity_km_s is three finite numbers"),
        ({"velocity_km_s": (1.0, np.nan, 2.0)}, "velocity_km_s is three finite numbers"),
        ({"velocity_km_s": (3e4, 0.0, 0.0)}, "velocity_km_s is in km/s and up to 300 in size"),
        ({"flux": np.ones(5), "magnitude": np.ones(5)}, "flux or magnitude is given, not both"),
        ({"magnitude": np.ones(4)}, r"magnitude has one number a spot, shape \(5,\); got \(4,\)"),
        ({"model": "dual_field_star"}, "model is a star sensor"),
    ],
)
def test_wrong_use(sensor, arguments, message):
    call = {"spots_px": np.zeros((5, 2)), "model": sensor, "velocity_km_s": REST} | arguments
    with pytest.raises(ValueError, match=message):
        measure(call.pop("spots_px"), call.pop("model"), **call)
