"""The covariance says what the errors are, with what lasts drawn once a run; one that ignores it does not.

Sampled slower than the shipped vehicle so that many runs are quick; bands are chi-square over runs, 99.99 % each.
"""

import dataclasses

import numpy as np
import pytest

from relnav.accuracy.rendezvous import checkpoint, fly, groups_of, honesty, port_figures, true_port
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import bent, ramp_of
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import layout_of
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.replay import Observed

RUNS = 10
FLIGHT = Rendezvous(start_m=5.5, final_m=2.5, fast_m_s=0.1, slow_m_s=0.1)


@pytest.fixture(scope="module")
def runs(slow):
    flight = dataclasses.replace(FLIGHT, as_believed=True)
    return [simulate_rendezvous(slow, flight, seed=40 + k) for k in range(RUNS)]


@pytest.fixture(scope="module")
def ends(runs):
    return [fly(run, (2.5,))[0] for run in runs]


def test_every_block_is_honest(slow, ends):
    places = layout_of(slow).by_name
    for name, blocks in groups_of(slow).items():
        ratio, dof = honesty(ends, places, blocks)
        lower, upper = chi_square_interval(dof, 0.9999)
        assert lower < ratio < upper, name
    moving = "position velocity target_attitude target_rate chaser_attitude gyro_bias slow_acceleration"
    ratio, dof = honesty(ends, places, moving)
    lower, upper = chi_square_interval(dof, 0.9999)
    assert lower < ratio < upper


def test_it_has_learnt_something(ends):
    """Millimetres and hundredths of a degree, from a tenth of a metre and half a degree."""
    error, sigma = port_figures(ends)
    assert sigma[:3].max() < 0.005
    assert np.degrees(sigma[6:9]).max() < 0.06
    assert error[:3].max() < 0.008


def test_alignment_ignored_is_overconfident(slow, runs):
    """The same flights before a filter that takes its sensors for perfect: it is wrong by many of its sigmas."""
    perfect = {
        name: dataclasses.replace(
            mounted,
            mount_sigma_rad=1e-9,
            **({"lever_sigma_m": 1e-9, "points_sigma_m": 1e-9, "focal_sigma": 1e-9} if mounted.position_m else {}),
        )
        for name, mounted in slow.sensor.items()
    }
    believed = dataclasses.replace(slow, sensor=perfect)
    points = [fly(run, (2.5,), believed=believed)[0] for run in runs[:4]]
    ratio, dof = honesty(points, layout_of(believed).by_name, "port")
    assert ratio > 3.0 * chi_square_interval(dof, 0.9999)[1]


def test_what_is_considered_is_never_corrected(slow, runs):
    nav = VehicleNavigator(slow)
    for seen in sorted(runs[0].observations, key=lambda observation: observation.t_s)[:300]:
        nav.observe(seen.sensor, seen.t_s, seen.value)
    estimate, places = nav.state(), nav.layout.by_name
    prior, now = nav.layout.prior, estimate.covariance
    for name in ("camera.mount", "camera.lever", "psd.mount", "star.mount"):
        assert (estimate.values[places[name]] == 0.0).all()
        np.testing.assert_allclose(now[places[name], places[name]], prior[places[name], places[name]], rtol=1e-12)
    assert (estimate.values[places["camera.points"]] != 0.0).all()
    sigma = np.sqrt(np.diagonal(now))
    assert np.linalg.eigvalsh(now / np.outer(sigma, sigma)).min() > 1e-9


@pytest.mark.parametrize("lost", [("gyro",), ("star",), ("star", "sun_aps", "sun_birefringent"), ("camera",), ("psd",)])
def test_a_sensor_lost_for_ten_seconds(slow, runs, lost):
    """Errors stay within four of their sigmas meanwhile and after, and the covariance says that it knows less."""
    run, nav = runs[1], VehicleNavigator(slow)
    sigma = []
    for seen in sorted(run.observations, key=lambda observation: observation.t_s):
        if len(sigma) < 3 and seen.t_s >= (9.9, 19.9, 29.0)[len(sigma)]:
            estimate = nav.state(seen.t_s)
            point = checkpoint(run, estimate)
            sigma.append(np.sqrt(np.diagonal(point.port_covariance)))
            assert np.abs(point.port_error / sigma[-1]).max() < 4.0
            assert estimate.gyro_lost == ("gyro" in lost and len(sigma) == 2)
        if seen.sensor not in lost or not 10.0 <= seen.t_s < 20.0:
            nav.observe(seen.sensor, seen.t_s, seen.value)
    assert len(sigma) == 3
    if "gyro" in lost:
        assert sigma[1][9:].min() > 1.5 * sigma[0][9:].max()  # the relative rate
        assert sigma[2][9:].max() < 1.2 * sigma[0][9:].max()


def test_late_images_are_not_taken_as_current(slow, runs):
    """Images come half a second late. By their time of exposure: as if they had not been late, to the last bit."""
    observations = sorted((seen for seen in runs[2].observations if seen.t_s < 12.0), key=lambda seen: seen.t_s)
    arriving = sorted(observations, key=lambda seen: seen.t_s + 0.5 * (seen.sensor == "camera"))
    in_order, late, stamped_late = (VehicleNavigator(slow) for _ in range(3))
    for seen, came in zip(observations, arriving, strict=True):
        in_order.observe(seen.sensor, seen.t_s, seen.value)
        late.observe(came.sensor, came.t_s, came.value)
        delay = 0.5 * (came.sensor == "camera")
        stamped_late.observe(came.sensor, came.t_s + delay, came.value)
    one, other = in_order.state(12.0), late.state(12.0)
    assert one.covariance.tobytes() == other.covariance.tobytes()
    assert one.port.position_m.tobytes() == other.port.position_m.tobytes()
    good, bad = (checkpoint(runs[2], nav.state(12.0)) for nav in (late, stamped_late))
    off = [abs(point.port_error[0]) / point.port_covariance[0, 0] ** 0.5 for point in (good, bad)]
    assert off[0] < 4.0
    assert abs(bad.port_error[0]) > 3.0 * abs(good.port_error[0])
    assert off[1] > 3.0


def test_an_eccentric_orbit(slow):
    """By Yamanaka and Ankersen, e = 0.1: the frame turns unevenly, and chaser, target and frame still agree."""
    orbit = dataclasses.replace(slow.orbit, eccentricity=0.1, true_anomaly_rad=1.0)
    vehicle = dataclasses.replace(slow, orbit=orbit)
    flight = dataclasses.replace(FLIGHT, final_m=4.0, as_believed=True)
    run = simulate_rendezvous(vehicle, flight, seed=77)
    point = fly(run, (4.0,))[0]
    scaled = point.port_error / np.sqrt(np.diagonal(point.port_covariance))
    assert np.abs(scaled).max() < 4.0
    round_orbit = dataclasses.replace(vehicle, orbit=dataclasses.replace(orbit, eccentricity=0.0))
    lost = fly(run, (4.0,), believed=round_orbit)[0]
    assert np.abs(lost.error[3:6] / np.sqrt(np.diagonal(lost.covariance)[3:6])).max() > 5.0


def test_a_glint_is_left_out(slow, runs):
    """One of six beacons seen 0.5 mm from where it is: the others are believed."""
    clean, struck = VehicleNavigator(slow), VehicleNavigator(slow)
    for seen in sorted((seen for seen in runs[3].observations if seen.t_s < 8.0), key=lambda seen: seen.t_s):
        value = seen.value
        if seen.sensor == "psd" and seen.t_s > 5.0 and np.isfinite(value[2]).all():
            value = value.copy()
            value[2] += 5e-4
        clean.observe(seen.sensor, seen.t_s, seen.value)
        assert struck.observe(seen.sensor, seen.t_s, value) is Observed.ACCEPTED
    one, other = clean.state(), struck.state()
    assert np.abs((one.port.position_m - other.port.position_m) / one.port.sigma[:3]).max() < 1.5
    assert other.sensors["psd"].nis_ratio > 5.0 * one.sensors["psd"].nis_ratio


def watched(vehicle, run, name, begins_s=8.0):
    """Alarms of a run in which a sensor is off by three times the report's ramp, and the estimate at the first."""
    nav = VehicleNavigator(vehicle)
    for seen in sorted(run.observations, key=lambda observation: observation.t_s):
        off = 3.0 * ramp_of(vehicle, name) if name and seen.t_s > begins_s else 0.0
        nav.observe(seen.sensor, seen.t_s, bent(vehicle, seen, name, off))
        now = nav.state()
        if now.alarms:
            return now.alarms, now
    return (), now


def test_healthy_flights_raise_no_alarm(slow, runs):
    for run in runs[:4]:
        alarms, last = watched(slow, run, "")
        assert alarms == ()
        assert all(abs(health.deviation) < 4.5 for health in last.sensors.values())


@pytest.mark.parametrize("name", ["camera", "psd", "star", "sun_aps"])
def test_a_sensor_that_is_off_raises_an_alarm_before_the_port_is_lost(slow, runs, name):
    alarms, now = watched(slow, runs[4], name)
    assert alarms, name
    assert now.t_s > 8.0
    off = true_port(runs[4], now.t_s)[0][:3] - now.port.position_m
    assert (np.abs(off) < now.port.protection_level_m()).all()


def test_without_the_second_filter_the_estimate_is_the_same(slow, runs):
    alone, both = VehicleNavigator(slow, monitor=False), VehicleNavigator(slow)
    for seen in sorted(runs[0].observations, key=lambda observation: observation.t_s)[:150]:
        for nav in (alone, both):
            nav.observe(seen.sensor, seen.t_s, seen.value)
    one, other = alone.state(), both.state()
    assert one.covariance.tobytes() == other.covariance.tobytes()
    assert one.values.tobytes() == other.values.tobytes()
    assert one.alarms == ()
    assert np.isnan(one.sensors["star"].deviation)
    assert np.isfinite(other.sensors["star"].deviation)
