"""What calls refuse, and in which words: a line for each message that no other test of its package triggers."""

import dataclasses
import math
from types import SimpleNamespace

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


def vehicle(call):
    navigator = relnav.VehicleNavigator(VEHICLE, monitor=False)
    navigator.observe("gyro", 0.0, np.zeros(3))
    return call(navigator)


def patent_of_one_field(which):
    from relnav.accuracy import dual_field_patent, dual_field_runs

    camera = relnav.load_model("ground_camera")
    if which == "angle":
        return dual_field_patent.cross_angle_error(camera, 0.2, 10, 1)
    if which == "rates":
        rates = SimpleNamespace(sensor=camera)
        return dual_field_runs._rates(rates, None, 1, np.random.default_rng(1), np.zeros(3))
    return dual_field_patent.spurious_quadruples(camera, 1, 1)


def birefringent_fit():
    from relnav.sensors.birefringent_sun.direction import fit_two_spots

    sensor = relnav.load_model("birefringent_sun").sensor
    return fit_two_spots(sensor, np.array([[0.0, 0.0], [1e-4, 0.0]]), -np.eye(4))


def sun_seen(**changes):
    from relnav.sensors.sun_direction import attitude_observation

    given = {"sun_inertial": [0.0, 0.0, 1.0], "dcm_body_from_inertial": np.eye(3), "sun_sigma_rad": 0.0} | changes
    sun = relnav.aps_sun.SunDirection(np.array([0.0, 0.0, 1.0]), np.diag([1e-8, 1e-8, 0.0]), relnav.Status.OK)
    return attitude_observation(sun, **given)


def yaw_without_sun():
    dark = relnav.aps_sun.SunDirection(np.full(3, np.nan), np.full((3, 3), np.nan), relnav.Status.NOT_SEEN)
    return relnav.aps_sun.yaw_from_sun(dark, [0.0, 0.0, 1.0], 0.0)


def branching():
    from relnav.codegen.trace import Symbol, Tape

    return bool(Symbol(Tape(), 0))


def no_light(angle_rad, **changes):
    from relnav.sensors.aps_sun.calibration import compile_table

    model = relnav.load_model("aps_sun")
    sensor = dataclasses.replace(model.sensor, field_half_angle_rad=angle_rad, **changes)
    return compile_table(dataclasses.replace(model, sensor=sensor), None, cells=8)


def strange_kind():
    vehicle = SimpleNamespace(models={"psd": object()}, sensor={"psd": SimpleNamespace(model="x")})
    return type(VEHICLE).kind(vehicle, "psd")


def two_mirrors():
    from relnav.sensors.dual_field import fold_fit

    with pytest.MonkeyPatch.context() as patch:
        for name, value in {"_identified": True, "mirror_of": True, "_distance": math.inf, "_middle": None}.items():
            patch.setattr(fold_fit, name, lambda *_, value=value: value)
        patch.setattr(fold_fit, "calibrate_fold", lambda *_: SimpleNamespace(normal=np.ones(3)))
        return fold_fit.fit_fold([(SPOTS, None, None)], STARS, np.zeros(3))


def contradicting_pairs():
    from relnav.files.sun_self_calibration import _agreeing

    return _agreeing(np.array([1.0] * 3 + [1e9] * 2))


def spinning(mean_motion_rad_s):
    from relnav.dynamics.rigid_body import RigidBody

    return RigidBody(np.eye(3), mean_motion_rad_s)


def certain():
    from relnav.estimation.consistency import chi_square_interval

    return chi_square_interval(6, 1.0)


def saved_by_another():
    from relnav.navigation.arguments import refuse_another_version

    return refuse_another_version("0.0.0")


def attitude(call):
    inertia = np.diag([100.0, 120.0, 140.0])
    return call(relnav.TargetAttitude(inertia, 1e-3, rate_noise_density_rad2_s3=1e-8, initial_rate_sigma_rad_s=0.01))


def pose(call, **settings):
    return call(relnav.PoseNavigator(MARKERS, **settings))


def pose_log(t_s, spots_px):
    from relnav.navigation.pose_log import filter_marker_epochs

    return filter_marker_epochs(MARKERS, t_s, spots_px)


def unaligned():
    from relnav.codegen.kernel import is_compiled
    from relnav.navigation.attitude.inputs import can_be_used

    if not is_compiled():
        pytest.skip("RELNAV_JIT=0 in this run: nothing is compiled")
    apart = np.ndarray((3, 3), buffer=bytearray(73), offset=1)
    return can_be_used(apart, np.eye(3), np.zeros((3, 3)), np.zeros((3, 3)))


def spun_up():
    from relnav.vehicle.layout import TARGET_RATE

    navigator = relnav.VehicleNavigator(VEHICLE, monitor=False)
    navigator.observe("gyro", 0.0, np.zeros(3))
    at, filters = navigator._timeline.newest.estimates, navigator._filters
    at.values[0, TARGET_RATE] = 1e5, 0.0, 0.0
    return filters.motion.settled(at, filters.samples, 1.0)


def restarted_at(t_s):
    navigator = relnav.Navigator(PSD)
    navigator.step(1.0, SPOTS)
    return navigator.start(t_s, [10.0, 0.0, 0.0, 0.0, 0.0, 0.0], np.eye(6))


def settled_behind():
    from relnav.navigation.steady_state_filter import settled_filter

    return settled_filter(PSD, [-10.0, 0.0, 0.0], 10.0)


def broken_beacon(**wrong):
    from relnav.simulation.beacon_faults import BeaconFault

    return BeaconFault(**({"kind": "dead", "beacon": 0} | wrong))


def dark():
    from relnav.simulation.detector import background_current_a

    return background_current_a(bare(PSD, "light"))


def marker_faults():
    from relnav.simulation.marker_flight import MarkerFaults

    return MarkerFaults(dropout=2.0)


def observed(sensor, value, covariance=None):
    return vehicle(lambda n: n.observe(sensor, 0.1, value, covariance))


def sun(direction, covariance):
    return relnav.aps_sun.SunDirection(np.array(direction), np.array(covariance), relnav.Status.OK)


UNSEEN = np.full((2, 3, 2), np.nan)
MOTION = ([20.0, 0.0, 0.0, 0.0, 0.0, 0.0], np.eye(12))
CALLS = {
    "no sun": (yaw_without_sun, "there is no sun direction to take a yaw from"),
    "null": (lambda: relnav.load_model("a\x00b.toml"), "a text or a path without null characters; got 'a"),
    "spinning": (lambda: spinning(-1.0), "mean_motion_rad_s must be >= 0 and finite; got -1.0"),
    "certain": (certain, "0 < probability < 1 is expected; got 1.0"),
    "markers": (lambda: relnav.Navigator(MARKERS), "is a marker mission: it is flown by relnav.PoseNavigator"),
    "no path": (lambda: relnav.load_scenario(5), "is expected, a text or a path; got a int: 5"),
    "off nominal": (
        lambda: relnav.three_beacon.positions(np.zeros((2, 2)), PSD),
        r"spots_m has shape \(3, 2\), rows A, B, C, .*; got \(2, 2\)",
    ),
    "pose back": (lambda: pose(lambda n: [n.step(t) for t in (1.0, 0.5)]), "before the last epoch, 1.0; got 0.5"),
    "pose spots": (lambda: pose(lambda n: n.step(0.0, UNSEEN[0, :2])), r"spots_px has shape \(3, 2\), .*got \(2, 2\)"),
    "no direction seen": (
        lambda: observed("sun_aps", 1.0),
        "sun_aps: .* a SunDirection in sensor axes, .* got a float",
    ),
    "no sensor": (lambda: observed("radar", 1.0), "no sensor 'radar' in rendezvous_demo; there are gyro, .*psd"),
    "gyro": (lambda: observed("gyro", [1.0, 2.0]), "gyro: three finite numbers up to .* are expected; got"),
    "gap": (
        lambda: vehicle(lambda n: n.observe("gyro", 1e6, np.zeros(3))),
        "gyro: t_s is a time at most .* start anew",
    ),
    "no model": (lambda: relnav.Navigator("psd"), r"model is a loaded mission, relnav.load_model\(...\); got 'psd'"),
    "no engine": (lambda: relnav.Navigator(PSD, engine="ekf"), 'engine must be "compiled" or "filterpy"; got'),
    "huge": (lambda: relnav.Navigator(PSD).start(0.0, [1e40] * 6, np.eye(6)), "state must be up to 1e.30 in size"),
    "start at no time": (lambda: restarted_at(math.nan), "t_s must be finite; got nan"),
    "start before": (lambda: restarted_at(0.5), "t_s must be after the last step's 1.0 s; got 0.5"),
    "saved": (saved_by_another, "a navigator saved by relnav 0.0.0 cannot go on in relnav"),
    "degrees": (lambda: attitude(lambda a: a.step(0.0, np.eye(3), 1e101 * np.eye(3))), "covariance_rad2 is in rad.2"),
    "mirrored": (
        lambda: attitude(lambda a: a.step(0.0).relative(-np.eye(3))),
        r"dcm_chaser_from_lvlh must be a rotation matrix \(3, 3\); got",
    ),
    "sigma shape": (
        lambda: relnav.filter_epochs(PSD, [0.0, 0.1], UNSEEN, spot_sigma_m=np.ones(2)),
        r"spot_sigma_m has shape \(2, 3, 2\); got \(2,\)",
    ),
    "sigma": (
        lambda: relnav.filter_epochs(PSD, [0.0, 0.1], UNSEEN + SPOTS, spot_sigma_m=np.zeros((2, 3, 2))),
        "spot_sigma_m is above zero, up to 1e\\+30; got .* at epoch 0",
    ),
    "pose log": (lambda: pose_log([0.0], UNSEEN), "spots_px has shape .*, one row a marker; got"),
    "pose times": (lambda: pose_log([0.0, math.inf], UNSEEN), "t_s must be finite"),
    "pose order": (lambda: pose_log([1.0, 0.0], UNSEEN), "t_s must not go back; the last epoch was at nan s"),
    "pose model": (lambda: relnav.PoseNavigator(PSD), "PoseNavigator flies a marker mission, such as"),
    "pose start": (
        lambda: pose(lambda n: n.start(0.0, MOTION[0], -np.eye(3), np.zeros(3), MOTION[1])),
        r"dcm_lvlh_from_target is a rotation matrix \(3, 3\)",
    ),
    "pose start before": (
        lambda: pose(lambda n: [n.start(t, MOTION[0], np.eye(3), np.zeros(3), MOTION[1]) for t in (1.0, 0.5)]),
        "t_s must not be before the last epoch, 1.0; got 0.5",
    ),
    "pose covariance": (
        lambda: pose(lambda n: n.step(0.0, UNSEEN[0], spot_covariance_px2=np.eye(2))),
        r"spot_covariance_px2 has shape \(3, 2, 2\), one a marker; got \(2, 2\)",
    ),
    "pose late": (
        lambda: pose(lambda n: n.step(0.0, UNSEEN[0], image_t_s=-0.1), engine="filterpy"),
        'engine="filterpy" takes no late images: leave image_t_s out',
    ),
    "settled": (settled_behind, "no measurement at .* m in the docking frame"),
    "fault's kind": (lambda: broken_beacon(kind="bent"), 'kind is "dead", "fading", "swapped" or "glint"; got'),
    "fault's beacon": (lambda: broken_beacon(beacon=3), "a beacon is 0, 1 or 2; got 3 and 0"),
    "dark": (dark, r"has no \[detector\] and \[light\]: a background current needs both"),
    "marker faults": (marker_faults, "dropout is a probability, 0 <= dropout < 1; got 2.0"),
    "quaternion": (lambda: observed("star", np.zeros(3)), r"star: a quaternion \(x, y, z, w\) of v_sensor = R v_in"),
    "star's noise": (lambda: observed("star", [0, 0, 0, 1], np.eye(2)), r"star: a covariance \(3, 3\) rad.2 in sensor"),
    "star's sign": (lambda: observed("star", [0, 0, 0, 1], -np.eye(3)), "star: a covariance is symmetric and positive"),
    "sun's shape": (lambda: observed("sun_aps", sun([0, 0, 1], np.eye(2))), r"sun_aps: a direction \(3,\) and its cov"),
    "sun's sign": (
        lambda: observed("sun_aps", sun([0.0, 0.0, 1.0], [[0.0, 1.0, 0.0], [0.0] * 3, [0.0] * 3])),
        "sun_aps: a covariance is finite and symmetric",
    ),
    "lights": (lambda: observed("psd", np.zeros((6, 2)), np.eye(2)), r"psd: covariances of 6 spots are \(6, 2"),
    "no vehicle": (lambda: relnav.VehicleNavigator(PSD), "a vehicle is expected, as relnav.load_model"),
    "far start": (lambda: relnav.VehicleNavigator(VEHICLE, t_s=1e30), "t_s of the start is a time in seconds, at most"),
    "one accuracy": (
        lambda: relnav.measure_accuracy("three_beacon_psd", runs=1),
        "runs is 2 or more and below .*; got 1",
    ),
    "angle": (lambda: patent_of_one_field("angle"), "a sensor of one field has no angle across fields"),
    "rates": (lambda: patent_of_one_field("rates"), "the patent's method is for two fields"),
    "quadruples": (lambda: patent_of_one_field(""), "the patent's method is for two fields"),
    "branch": (branching, r"cannot branch on its numbers: use select\(condition, a, b\)"),
    "no direction": (lambda: no_light(1.54), "the ray model has no direction for some spots of the field"),
    "no light": (
        lambda: no_light(1.3, misalignment_rad=(0.19, 0.19, 0.0)),
        "no light reaches the detector from the edge of the field; make field_half_angle smaller",
    ),
    "unaligned": (unaligned, r"can_be_used takes aligned arrays of numpy's own class; got <f8\[2C\]"),
    "spun up": (spun_up, r"the target's rate, 1e\+05 rad/s, is no longer known: start anew"),
    "no vehicle's": (strange_kind, "sensor.psd.model: a three_beacon, .* model is expected"),
    "no mirror": (two_mirrors, "1 frames show both fields, but no two agree on the mirror"),
    "covariance": (birefringent_fit, "covariance_m2 is symmetric and positive definite; got"),
    "sun attitude": (lambda: sun_seen(dcm_body_from_inertial=-np.eye(3)), "dcm_body_from_inertial is a rotation"),
    "sun sigma": (lambda: sun_seen(sun_sigma_rad=-1.0), "sun_sigma_rad is an angle in radians, 0 or more; got -1.0"),
    "contradicting": (contradicting_pairs, "2 of 5 pairs of spots contradict the others; are they of this sensor?"),
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
    "propagate": (lambda: vehicle(lambda n: n.propagate(1e3)), "t_s lies between the last observation .*; got 1000.0"),
    "before": (lambda: vehicle(lambda n: n.state(-1e3)), "within the replay window; got -1000.0"),
}


@pytest.mark.parametrize(("call", "message"), CALLS.values(), ids=CALLS)
def test_a_call_says_what_it_refuses(call, message):
    with pytest.raises((ValueError, TypeError, relnav.UsageError), match=message):
        call()
