"""About an eccentric target: honest at 60 m, filtered and smoothed, where a circular model is not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.accuracy.pose_filter import flown
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.simulation.detector import Faults
from relnav.simulation.marker_flight import MarkerFaults
from relnav.simulation.scenario import simulate
from relnav.simulation.target_rotation import rotate_target
from relnav.simulation.trajectory import Approach

FAR = Approach(400.0, 2.0, start_m=(60.0, 0.5, -0.4), final_range_m=20.0, speed_m_s=0.1, assumed_noise=True)


def about(model, eccentricity):
    return replace(model, orbit=replace(model.orbit, eccentricity=eccentricity, true_anomaly_rad=0.7))


def nees_ratio(model, told, nees, *, smooth=False, method="spots"):
    """Mean NEES / 6 after 50 s over four approaches."""
    wide = replace(model, sensor=replace(model.sensor, detector_size_m=(0.02, 0.02)))
    values = []
    for seed in range(4):
        log = simulate(wide, FAR, Faults(), seed)
        solution = relnav.filter_epochs(
            replace(wide, orbit=told.orbit),
            log.t_s,
            log.spots_m,
            acceleration_m_s2=log.acceleration_m_s2,
            method=method,
            smooth=smooth,
        )
        late = log.t_s > 50.0
        values.append(nees((solution.state - log.truth)[late], solution.covariance[late]).mean() / 6.0)
    return np.mean(values)


@pytest.mark.parametrize("eccentricity", [0.02, 0.1])
@pytest.mark.parametrize("smooth", [False, True])
def test_honest(vbar, nees, eccentricity, smooth):
    model = about(vbar, eccentricity)
    assert 0.7 < nees_ratio(model, model, nees, smooth=smooth) < 1.3


def test_a_circular_model_is_not(vbar, nees):
    """E = 0.1: the ratio is 100, by tidal acceleration that the circular model does not know."""
    assert nees_ratio(about(vbar, 0.1), vbar, nees) > 30.0


def test_at_zero_eccentricity_the_anomaly_does_not_matter(vbar, nees):
    turned = replace(vbar, orbit=replace(vbar.orbit, true_anomaly_rad=2.0))
    assert nees_ratio(vbar, turned, nees) == nees_ratio(vbar, vbar, nees)


@pytest.mark.parametrize("eccentricity", [0.0, 0.1])
def test_markers(eccentricity):
    """Position and attitude: the frame in which the target's attitude is told turns by 20 % faster or slower."""
    mission = about(relnav.load_model("three_marker_vision"), eccentricity)
    approach = Approach(100.0, 2.0, start_m=(14.0, 0.25, -0.15), final_range_m=4.0, speed_m_s=0.1, assumed_noise=True)
    errors = flown(mission, approach, MarkerFaults(), 6, 70)
    assert 0.8 < errors.where(errors.t_s > 15.0).nees_ratio < 1.3


@pytest.mark.parametrize("anomaly_rad", [0.0, 2.5])
def test_a_held_target_turns_with_the_frame(anomaly_rad):
    """E = 0.7, markers, the rate known to 0.02 deg/s about that of a held target: 7.9 and 0.5 times the mean motion."""
    mission = about(relnav.load_model("three_marker_vision"), 0.7)
    settings = replace(mission.filter, initial_rate_sigma_rad_s=math.radians(0.02))
    mission = replace(mission, filter=settings, orbit=replace(mission.orbit, true_anomaly_rad=anomaly_rad))
    approach = Approach(20.0, 2.0, start_m=(8.0, 0.25, -0.15), final_range_m=7.0, speed_m_s=0.05, assumed_noise=True)
    errors = flown(mission, approach, MarkerFaults(), 12, 70)
    assert 0.8 < errors.nees_ratio < 1.3


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_the_gravity_gradient_is_that_of_the_place(engine):
    """E = 0.7, past perigee, no image for two minutes: 3 (frame rate)^2 for 3 mu / r^3 would be 2 deg off."""
    mission, tilt = about(relnav.load_model("three_marker_vision"), 0.7), Rotation.from_rotvec([0.5, 0.4, -0.3])
    rate, t = np.radians([0.1, -0.2, 0.1]), np.arange(0.0, 120.01, 0.05)
    dcm, _ = rotate_target(
        t, tilt.as_quat()[None], rate[None], mission.target.inertia_kg_m2, mission.orbit, 0.0, np.random.default_rng(1)
    )
    nav = relnav.PoseNavigator(mission, engine=engine)
    nav.start(0.0, [8.0, 0.0, 0.0, 0.0, 0.0, 0.0], tilt.as_matrix(), rate, 1e-10 * np.eye(12))
    for t_s in np.arange(1.0, 120.5, 1.0):
        record = nav.step(t_s)
    assert np.linalg.norm(rotation_vector_between(record.dcm_lvlh_from_target, dcm[-1, 0])) < 1e-4
