"""What is held in `lvlh_ccsds` turns as that frame does at the time: about an eccentric orbit not with the mean motion.

Truth is the simulated frame itself, by Kepler's equation and differences, and a simulated target that holds to it.
"""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.accuracy.rendezvous import checkpoint
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import Rendezvous, stated_frames
from relnav.simulation.target_rotation import rotate_target
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.acquisition import hypothesis_about
from relnav.vehicle.layout import TARGET_RATE
from relnav.vehicle.navigator import VehicleNavigator

TIMES_S = (0.0, 400.0, -1700.0)
H_S = 1e-2


@pytest.fixture(scope="module")
def eccentric(slow):
    """At perigee when the clock is zero."""
    orbit = dataclasses.replace(slow.orbit, eccentricity=0.3, true_anomaly_rad=0.0)
    return dataclasses.replace(slow, orbit=orbit)


def turning(orbit, t_s, dcm_body_from_frame):
    """Inertial rate of a body held in the frame, its axes, by differences of the frame."""
    before, after = stated_frames(orbit, np.array([t_s - H_S, t_s + H_S]))
    return dcm_body_from_frame @ -Rotation.from_matrix(after @ before.T).as_rotvec() / (2.0 * H_S)


@pytest.mark.parametrize("t_s", TIMES_S)
def test_at_hand_over(eccentric, t_s):
    """Target and chaser; the mean motion is off by 1.07e-3 rad/s at perigee, 6 times the stated 1-sigma."""
    nav = VehicleNavigator(eccentric, t_s=t_s)
    now, orbit, target = nav.state(), eccentric.orbit, eccentric.target.dcm_target_from_lvlh
    off = now.target_rate_rad_s - turning(orbit, t_s, target)
    assert np.abs(off).max() < 1e-9
    off = now.chaser_rate_rad_s - turning(orbit, t_s, eccentric.chaser.dcm_chaser_from_lvlh)
    assert np.abs(off).max() < 1e-9


@pytest.mark.parametrize("t_s", TIMES_S)
def test_of_a_hypothesis(eccentric, t_s):
    """A target that is held with another attitude."""
    nav = VehicleNavigator(eccentric, t_s=t_s)
    dcm = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    found = hypothesis_about(nav._timeline.newest.estimates, dcm, nav._filters._begin, nav._filters.frame).estimates
    assert np.abs(found.values[:, TARGET_RATE] - turning(eccentric.orbit, t_s, dcm.T)).max() < 1e-9


def test_of_a_chaser_without_a_gyro(eccentric):
    """The filter that never has one: its chaser stays as held, while the frame's rate falls by a fifth."""
    filters, t_s = VehicleNavigator(eccentric, separation=True)._filters, 400.0
    at = filters.motion.settled(filters.start.estimates, filters.samples, t_s)
    chaser = at.dcm_inertial_from_chaser[filters._without["gyro"]]
    held = eccentric.chaser.dcm_chaser_from_lvlh @ stated_frames(eccentric.orbit, np.array([t_s]))[0]
    assert np.linalg.norm(Rotation.from_matrix(held @ chaser).as_rotvec()) < 1e-6
    rate = filters.motion.chaser_rate(at, filters.samples, filters._without["gyro"])
    assert np.abs(rate - turning(eccentric.orbit, t_s, eccentric.chaser.dcm_chaser_from_lvlh)).max() < 1e-9


def test_the_simulated_target_holds_to_the_frame(eccentric):
    """A truth that controls itself: within the stated 1-sigma of its first rate, and later within its control."""
    run = simulate_rendezvous(eccentric, Rendezvous(start_m=5.5, final_m=1.0, fast_m_s=0.03), seed=5)
    truth, t = run.truth, np.array([0.0, run.truth.end_s])
    sigma = eccentric.hand_over.target_rate_sigma_rad_s
    for t_s, rate in zip(t, truth.target_rate(t), strict=True):
        held = turning(eccentric.orbit, float(t_s), eccentric.target.dcm_target_from_lvlh)
        assert np.abs(rate - held).max() < 4.0 * sigma


def test_the_first_seconds_are_honest(eccentric):
    """NEES/n of the port's twelve over runs, two seconds after hand-over."""
    runs = 12
    flight = Rendezvous(start_m=5.5, final_m=5.0, as_believed=True)
    ratios = []
    for seed in range(runs):
        run, nav = simulate_rendezvous(eccentric, flight, seed=seed), VehicleNavigator(eccentric, monitor=False)
        for seen in sorted(run.observations, key=lambda seen: seen.t_s):
            if seen.t_s <= 2.0:
                nav.observe(seen.sensor, seen.t_s, seen.value)
        point = checkpoint(run, nav.state(2.0))
        ratios.append(point.port_error @ np.linalg.solve(point.port_covariance, point.port_error))
    lower, upper = chi_square_interval(12 * runs, 0.9999)
    assert lower < np.mean(ratios) / 12.0 < upper


def test_the_gravity_gradient_is_that_of_the_place(eccentric):
    """E = 0.7 from perigee, by prediction alone for a minute: 3 (frame rate)^2 for 3 mu / r^3 would be 1 deg off."""
    orbit = dataclasses.replace(eccentric.orbit, eccentricity=0.7)
    tilt = tuple(Rotation.from_rotvec([0.5, 0.4, -0.3]).as_quat().tolist())
    tilted = dataclasses.replace(eccentric.target, q_target_from_lvlh=tilt)
    vehicle = dataclasses.replace(eccentric, orbit=orbit, target=tilted)
    nav, t = VehicleNavigator(vehicle), np.arange(0.0, 60.01, 0.05)
    begin = nav.state()
    dcm, _ = rotate_target(
        t,
        Rotation.from_matrix(begin.dcm_lvlh_from_target).as_quat()[None],
        begin.target_rate_rad_s[None],
        np.array(vehicle.target.inertia_kg_m2),
        orbit,
        0.0,
        np.random.default_rng(1),
    )
    end = nav.propagate(60.0).dcm_lvlh_from_target
    assert np.linalg.norm(Rotation.from_matrix(dcm[-1, 0].T @ end).as_rotvec()) < 1e-4
