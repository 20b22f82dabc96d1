"""What calls refuse, and in which words: a line for each message that no other test of its package triggers."""

import dataclasses

import numpy as np
import pytest

import relnav

PSD = relnav.load_model("three_beacon_psd")
MARKERS = relnav.load_model("three_marker_vision")
STARS = relnav.load_model("dual_field_star")
VEHICLE = relnav.load_model("rendezvous_demo")
LATE = dataclasses.replace(PSD, filter=dataclasses.replace(PSD.filter, longest_delay_s=1.0))
SPOTS = np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])


def bare(model, *sections):
    return dataclasses.replace(model, **dict.fromkeys(sections))


def four_beacons():
    return dataclasses.replace(PSD, sensor=dataclasses.replace(PSD.sensor, extra_beacons_m=((0.0, 0.5, 0.5),)))


def told(name):
    from relnav.accuracy import faults, marker_faults

    if name == "beacons":
        return faults.told_model(bare(PSD, "tolerances"), faults.DRAWN, next(iter(faults.Fault)))
    return marker_faults.told_mission(bare(MARKERS, "tolerances"), "as drawn", next(iter(marker_faults.Fault)))


def entry_of_words():
    from relnav.codegen.compiler import finish

    return finish("frame_rate", None, ("mean motion", 0.0))


def system_of_nothing():
    from relnav.files.systems import system_of

    return system_of(object())


def orbit_of_one_axis():
    from relnav.geometry.orbital_attitude import dcm_lvlh_from_inertial

    return dcm_lvlh_from_inertial([7e6, 0.0], [0.0, 7e3])


def start_without_variance():
    return relnav.Navigator(PSD).start(0.0, np.zeros(6), np.zeros((6, 6)))


def late_log(times):
    from relnav.navigation.late_log import filter_late_images

    return filter_late_images(LATE, [0.0, 0.1], np.tile(SPOTS, (2, 1, 1)), times)


def kept_by_filterpy():
    from relnav.navigation.pose_log import MarkerLogFilter

    return MarkerLogFilter(MARKERS, keep=True, engine="filterpy")


def sun_spots(name):
    if name == "aps":
        from relnav.sensors.aps_sun.rays import project

        return project(relnav.load_model("aps_sun"), [0.0, 0.0, 2.0])
    from relnav.sensors.birefringent_sun.spots import project

    return project(relnav.load_model("birefringent_sun").sensor, [0.0, 0.0, 2.0])


def calcite_in_radio_waves():
    from relnav.sensors.birefringent_sun.crystal import calcite

    return calcite(1e4)


def stars_of_the_future():
    return relnav.dual_field.measure(np.zeros((5, 2)), STARS, velocity_km_s=np.zeros(3), epoch_jyear=1e9)


def dispersed():
    from relnav.simulation.dispersed import fly_run
    from relnav.simulation.dispersions import AsBuilt, Scenario

    return fly_run(bare(PSD, "tolerances"), Scenario(as_built=AsBuilt(by_tolerances=True)), 1, 0)


def raw(model):
    from relnav.simulation.raw import simulate_raw

    return simulate_raw(model)


def faults_without_times():
    from relnav.simulation.raw import slot_counts

    rng = np.random.default_rng(1)
    return slot_counts(PSD, np.zeros((3, 6)), np.arange(3), rng, faults=(None,))


def rendezvous_that_flees():
    from relnav.simulation.rendezvous import Rendezvous

    return Rendezvous(fast_m_s=-1.0)


def vehicle_without_sensors():
    return dataclasses.replace(VEHICLE, sensor={})


def vehicle(call):
    navigator = relnav.VehicleNavigator(VEHICLE, monitor=False)
    navigator.observe("gyro", 0.0, np.zeros(3))
    return call(navigator)


CALLS = {
    "told beacons": (lambda: told("beacons"), r"three_beacon_psd has no \[tolerances\]: what a built sensor"),
    "told markers": (lambda: told("markers"), r"three_marker_vision has no \[tolerances\]: what a built sensor"),
    "kernel": (entry_of_words, "frame_rate takes numbers, arrays and records; got "),
    "system": (system_of_nothing, r"a loaded model is expected, relnav.load_model\(...\); got <object"),
    "orbit": (orbit_of_one_axis, r"positions and velocities have equal shapes \(..., 3\); got \(2,\) and \(2,\)"),
    "start": (start_without_variance, "covariance has variances above zero; its diagonal is"),
    "late log": (lambda: late_log([0.0]), r"image_t_s has shape \(2,\), one time a row; got \(1,\)"),
    "late image": (lambda: relnav.Navigator(LATE).step(0.0, SPOTS[:2]), r"spots_m has shape \(3, 2\).*got \(2, 2\)"),
    "filterpy": (kept_by_filterpy, "filters marker logs forward alone: leave smoothing out"),
    "aps": (lambda: sun_spots("aps"), "sun directions are unit vectors"),
    "birefringent": (lambda: sun_spots("birefringent"), "sun directions are unit vectors"),
    "calcite": (calcite_in_radio_waves, "calcite's indices are known from 0.204 to 2.172 um; got 10000.0"),
    "year": (stars_of_the_future, r"epoch_jyear is a Julian year, up to .*; got 1000000000.0"),
    "dispersed": (dispersed, r"has no \[tolerances\], by which the scenario draws the sensor as built"),
    "raw": (lambda: raw(bare(PSD, "pulses")), r"has no \[detector\], \[light\] and \[pulses\]: raw logs need"),
    "raw of four": (lambda: raw(four_beacons()), "raw logs hold beacons a, b, c; model three_beacon_psd lists 4"),
    "times": (faults_without_times, r"faults happen at times: t_s \(n,\) is needed with them"),
    "rendezvous": (rendezvous_that_flees, "closing rates are positive; got -1.0"),
    "no sensor": (vehicle_without_sensors, r"a vehicle has sensors: write one section \[sensor.NAME\] for each"),
    "propagate": (lambda: vehicle(lambda n: n.propagate(1e3)), "t_s lies between the last observation .*; got 1000.0"),
    "before": (lambda: vehicle(lambda n: n.state(-1e3)), "within the replay window; got -1000.0"),
}


@pytest.mark.parametrize(("call", "message"), CALLS.values(), ids=CALLS)
def test_a_call_says_what_it_refuses(call, message):
    with pytest.raises((ValueError, TypeError, relnav.UsageError), match=message):
        call()


