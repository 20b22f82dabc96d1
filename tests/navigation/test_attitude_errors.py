"""`spots` under a wrong attitude: one that lasts, one that is new at every image, both; as stated in the model."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.estimation.consistency import nees
from relnav.geometry.pinhole import central_projection
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach

APPROACH = Approach(duration_s=60.0, start_m=(7.0, 0.02, 0.03), assumed_noise=True, assumed_start=True)
RUNS = 30


def model_of(sigma_deg, noise_deg, lever=(0.0, 0.0, 0.0)):
    model = relnav.load_model("three_beacon_psd")
    attitude = dataclasses.replace(model.attitude, sigma_rad=np.radians(sigma_deg), noise_rad=np.radians(noise_deg))
    return dataclasses.replace(
        model, attitude=attitude, camera=dataclasses.replace(model.camera, position_m=lever), tolerances=None
    )


def turned_spots(model, log, seed, sigma_deg, noise_deg):
    """The log's spots as a chaser sees them whose attitude is not the stated one."""
    rng = np.random.default_rng((8, seed))
    theta = np.radians(sigma_deg) * rng.normal(size=3) + np.radians(noise_deg) * rng.normal(size=(len(log.t_s), 3))
    from_chaser = (model.beacons_lvlh_m - log.truth[:, None, :3]) @ model.dcm_cam_from_lvlh.T

    def project(points):
        return model.sensor.focal_length_m * central_projection(points - model.camera_lever_cam_m)

    turned = from_chaser - np.cross(theta[:, None], from_chaser)
    return log.spots_m + project(turned) - project(from_chaser)


def flown(model, sigma_deg, noise_deg, *, smooth=False, runs=RUNS):
    """Mean NEES / 6 after the start, and the solutions."""
    ratios, solutions = [], []
    for seed in range(runs):
        log = simulate(model, APPROACH, Faults(), seed=seed)
        spots = turned_spots(model, log, seed, sigma_deg, noise_deg)
        solution = relnav.filter_epochs(
            model, log.t_s, spots, acceleration_m_s2=log.acceleration_m_s2, method="spots", smooth=smooth
        )
        late = log.t_s > 10.0
        ratios.append(np.mean(nees((solution.state - log.truth)[late], solution.covariance[late])) / 6.0)
        solutions.append(solution)
    return float(np.mean(ratios)), solutions


CASES = [(0.05, 0.0), (0.2, 0.0), (0.0, 0.02), (0.0, 0.05), (0.1, 0.02)]


@pytest.mark.parametrize("smooth", [False, True], ids=["filtered", "smoothed"])
@pytest.mark.parametrize(("sigma_deg", "noise_deg"), CASES)
def test_honest_where_it_is_stated(sigma_deg, noise_deg, smooth):
    """NEES / 6 in [0.6, 1.3] (taken for noise or ignored: 7 to 24,000), and no restarts."""
    ratio, solutions = flown(model_of(sigma_deg, noise_deg, (0.02, -0.03, 0.3)), sigma_deg, noise_deg, smooth=smooth)
    assert 0.6 <= ratio <= 1.3
    assert sum(solution.restarts for solution in solutions) == 0


def test_shipped_defaults_cover_a_twentieth_of_a_degree():
    """The shipped 0.15 deg with an attitude 0.05 deg off: a third of a sigma, where nothing considered had 1,677."""
    model = relnav.load_model("three_beacon_psd")
    ratio, _ = flown(model, 0.05, 0.0)
    assert ratio <= 1.3


def test_the_reported_angle_is_the_attitude_s():
    """Azimuth and elevation by `spots` are those of the stated attitude: so is their sigma.

    A little less: the closed form at the start does not need the attitude.
    """
    _, solutions = flown(model_of(0.15, 0.0), 0.15, 0.0, runs=1)
    assert 0.12 < np.degrees(solutions[0].docking_sigma[-1, 1:3]).min() < 0.15


def test_both_engines_agree_with_noise_of_the_attitude():
    model = model_of(0.1, 0.05)
    log = simulate(model, APPROACH, Faults(), seed=3)
    spots = turned_spots(model, log, 3, 0.1, 0.05)
    spots[100, 2] += 1e-3
    spots[120:130, 1] = np.nan
    spots[140, 0, 0] = np.nan
    ours, theirs = (
        relnav.filter_epochs(
            model, log.t_s, spots, acceleration_m_s2=log.acceleration_m_s2, method="spots", engine=engine
        )
        for engine in ("compiled", "filterpy")
    )
    assert np.array_equal(ours.status, theirs.status)
    assert np.nanmax(np.abs(ours.state - theirs.state) / ours.sigma) < 1e-6
    np.testing.assert_allclose(ours.sigma, theirs.sigma, rtol=1e-6)


def test_noise_told_with_an_image_is_that_of_the_model():
    told, model = model_of(0.1, 0.0), model_of(0.1, 0.05)
    log = simulate(model, APPROACH, Faults(), seed=3)
    spots = turned_spots(model, log, 3, 0.1, 0.05)[:100]
    whole = relnav.filter_epochs(
        model, log.t_s[:100], spots, acceleration_m_s2=log.acceleration_m_s2[:100], method="spots"
    )
    navigator = relnav.Navigator(told, method="spots")
    for k in range(100):
        noise = {"attitude_noise_rad": model.attitude.noise_rad} if k == 0 else {}
        record = navigator.step(log.t_s[k], spots[k], acceleration_m_s2=log.acceleration_m_s2[k], **noise)
        np.testing.assert_array_equal(record.state, whole.state[k])


@pytest.mark.parametrize("wrong", [-1e-3, np.nan, np.inf, "much"])
def test_noise_that_is_none_is_refused_by_name(wrong):
    beacons = relnav.Navigator(relnav.load_model("three_beacon_psd"))
    markers = relnav.PoseNavigator(relnav.load_model("three_marker_vision"))
    for navigator, spots in ((beacons, np.zeros((3, 2))), (markers, np.full((3, 2), np.nan))):
        with pytest.raises(ValueError, match="attitude_noise_rad"):
            navigator.step(0.0, spots, attitude_noise_rad=wrong)
