"""A gyro that falls silent again and again: what is known of its bias stays true, and its last rate is not trusted."""

import dataclasses

import numpy as np
import pytest

from relnav.accuracy.rendezvous import checkpoint, honesty
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import layout_of
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother

RUNS = 12
FLIGHT = Rendezvous(start_m=5.5, final_m=4.0, fast_m_s=0.05, slow_m_s=0.05, as_believed=True)
"""Half a minute."""


def flown_by(vehicle, *names, noise_deg_sqrt_h=None):
    """With these sensors alone; a bias of 200 deg/h, and the gyro's noise if it is given."""
    gyro = dataclasses.replace(vehicle.gyro, bias_sigma_rad_s=1e-3)
    if noise_deg_sqrt_h is not None:
        gyro = dataclasses.replace(gyro, random_walk_rad_sqrt_s=np.radians(noise_deg_sqrt_h) / 60.0)
    return dataclasses.replace(vehicle, sensor={name: vehicle.sensor[name] for name in names}, gyro=gyro)


def seen(run, is_silent):
    """What is observed, in order of time; without gyro samples that are lost."""
    ordered = sorted(run.observations, key=lambda one: one.t_s)
    return [one for one in ordered if one.sensor != "gyro" or not is_silent(one.t_s)]


def every_four_seconds(t_s):
    return t_s % 4.0 >= 3.0


def at_random(seed):
    """Two of five samples missing, each by itself."""
    lost = np.random.default_rng(seed).random(10_000) < 0.4
    return lambda t_s: bool(lost[round(t_s * 20.0)])


def honest(points, vehicle, *names, least=None):
    """NEES/n of these errors within its bounds; least: where a covariance larger than need be is what is meant."""
    for name in names:
        ratio, dof = honesty(points, layout_of(vehicle).by_name, name)
        lower, upper = chi_square_interval(dof, 0.9999)
        assert (lower if least is None else least) < ratio < upper, name


@pytest.mark.parametrize("smoothed", [False, True])
@pytest.mark.parametrize("names", [("camera",), ("camera", "star")])
def test_a_second_of_four_is_missing(slow, names, smoothed):
    """NEES/n after seven gaps, or of the third second with the whole flight known; nothing is alarmed."""
    vehicle, points = flown_by(slow, *names), []
    for k in range(RUNS):
        run = simulate_rendezvous(vehicle, FLIGHT, seed=900 + k)
        told = VehicleSmoother(vehicle, monitor=False) if smoothed else VehicleNavigator(vehicle)
        for one in seen(run, every_four_seconds):
            told.observe(one.sensor, one.t_s, one.value)
        estimate = told.estimates([7.5])[0] if smoothed else told.state()
        points.append(checkpoint(run, estimate))
        assert not estimate.first_alarm_s
    honest(points, vehicle, "gyro_bias", "chaser_attitude", "velocity", "target_rate", "port")


def test_samples_missing_at_random(slow):
    """Two of five: honest, no star is refused, nothing is alarmed."""
    vehicle, points = flown_by(slow, "camera", "star"), []
    for k in range(RUNS):
        run, nav, refused = simulate_rendezvous(vehicle, FLIGHT, seed=930 + k), VehicleNavigator(vehicle), 0
        for one in seen(run, at_random(k)):
            refused += nav.observe(one.sensor, one.t_s, one.value).name == "REJECTED" and one.sensor != "gyro"
        assert refused <= 1
        assert not nav.state().first_alarm_s
        points.append(checkpoint(run, nav.state()))
    honest(points, vehicle, "gyro_bias", "chaser_attitude", "port", least=0.1)


@pytest.mark.parametrize("ahead_s", [0.5, 5.0, 20.0])
def test_a_noisy_gyros_last_rate(slow, ahead_s):
    """0.3 deg / sqrt(h): predictions, with the rate that is held, and after HELD_S its error in the bias.

    NEES/n of both attitudes; they turn by less than the held rate may walk, which the lower bound leaves out.
    """
    vehicle, points = flown_by(slow, "camera", "star", noise_deg_sqrt_h=0.3), []
    for k in range(2 * RUNS):
        run, nav = simulate_rendezvous(vehicle, FLIGHT, seed=960 + k), VehicleNavigator(vehicle, monitor=False)
        for one in seen(run, lambda _: False):
            if one.t_s < 5.0:
                nav.observe(one.sensor, one.t_s, one.value)
        points.append(checkpoint(run, nav.state(nav.newest_s + ahead_s)))
    honest(points, vehicle, "chaser_attitude", least=0.1)
    turned = [point.port_error[6:9] for point in points]
    known = [point.port_covariance[6:9, 6:9] for point in points]
    ratios = [error @ np.linalg.solve(P, error) / 3.0 for error, P in zip(turned, known, strict=True)]
    assert np.mean(ratios) < chi_square_interval(3 * len(points), 0.9999)[1]


def test_a_noisy_gyro_that_is_lost_for_a_while(slow):
    """For 8 s, of a chaser that is held: no star is refused, nothing is alarmed, and all is honest after it."""
    vehicle, points = flown_by(slow, "camera", "star", noise_deg_sqrt_h=0.3), []
    for k in range(RUNS):
        run, nav = simulate_rendezvous(vehicle, FLIGHT, seed=990 + k), VehicleNavigator(vehicle)
        for one in seen(run, lambda t_s: 5.0 < t_s < 13.0):
            verdict = nav.observe(one.sensor, one.t_s, one.value)
            assert verdict.name == "ACCEPTED" or one.sensor != "star"
            if one.t_s > 15.0:
                break
        assert not nav.state().first_alarm_s
        points.append(checkpoint(run, nav.state()))
    honest(points, vehicle, "chaser_attitude", "gyro_bias", "port")


def test_a_gap_in_which_the_rate_is_learnt(slow):
    """From 5 to 20 s: NEES/n in the gap and after it, filtered; and smoothed, of both times, never too sure."""
    vehicle, times = flown_by(slow, "camera", "star"), (18.0, 25.0)
    filtered, smoothed = {t: [] for t in times}, {t: [] for t in times}
    for k in range(RUNS):
        run = simulate_rendezvous(vehicle, FLIGHT, seed=1020 + k)
        nav, smoother, left = VehicleNavigator(vehicle), VehicleSmoother(vehicle, monitor=False), list(times)
        for one in seen(run, lambda t_s: 5.0 < t_s < 20.0):
            while left and one.t_s > left[0]:
                estimate = nav.state(left.pop(0))
                assert estimate.gyro_lost == (estimate.t_s == times[0])
                filtered[estimate.t_s].append(checkpoint(run, estimate))
            nav.observe(one.sensor, one.t_s, one.value)
            smoother.observe(one.sensor, one.t_s, one.value)
        assert not nav.state().first_alarm_s
        for estimate in smoother.estimates(times):
            smoothed[estimate.t_s].append(checkpoint(run, estimate))
    for found in (filtered, smoothed):
        for points in found.values():
            honest(points, vehicle, "chaser_attitude", "gyro_bias", "velocity", "port", least=0.1)
