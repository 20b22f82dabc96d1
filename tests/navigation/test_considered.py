"""What lasts in the spots: its effect on the estimate against derivatives of the whole filter, and what is reported."""

import dataclasses
import itertools

import numpy as np
import pytest

import relnav
from relnav.estimation.factored import compose
from relnav.files import logs
from relnav.files.filter_file import filter_file
from relnav.files.simulated import write_log
from relnav.navigation.log import LogFilter
from relnav.navigation.memory import views
from relnav.navigation.smoothing import smooth_run
from relnav.navigation.status import STARTED
from relnav.sensors.three_beacon.calibrate import calibrate
from relnav.sensors.three_beacon.calibration import Calibration
from relnav.simulation.as_built import as_built
from relnav.simulation.detector import Faults
from relnav.simulation.distortion import typical_distortion
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach

SIGMA_M = 3e-6


def calibrated(model, sigma_m=SIGMA_M):
    """A detector that measures right but for a lasting error of `sigma_m`, inside and outside its box."""
    return dataclasses.replace(
        model,
        calibration=Calibration(0, (0.0, 0.0), (3e-3, 3e-3), (0.0,), (0.0,), sigma_m, 0.0, 225, 1e-5),
    )


def triad(a):
    return ((0.0, a, 0.0), (0.0, -a, 0.0), (3.0**0.5 * a, 0.0, 0.0))


def attitude_known(model):
    """The model with an attitude that is believed without error."""
    return dataclasses.replace(model, attitude=dataclasses.replace(model.attitude, sigma_rad=0.0))


@pytest.fixture(scope="module")
def models():
    vbar = attitude_known(relnav.load_model("three_beacon_psd"))
    more = dataclasses.replace(vbar.sensor, extra_beacons_m=(*triad(0.06), *triad(0.03)))
    return {
        "vbar": calibrated(vbar),
        "rbar": calibrated(attitude_known(relnav.load_model("three_beacon_psd_rbar"))),
        "attitude unknown": calibrated(
            dataclasses.replace(vbar, attitude=dataclasses.replace(vbar.attitude, mode="unknown"))
        ),
        "nine beacons": calibrated(dataclasses.replace(vbar, sensor=more)),
        "near the port": calibrated(dataclasses.replace(vbar, sensor=more)),
    }


def images(
    model, truth, seen, *, focal=0.0, camera=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), shift=0.0, attitude=(0.0, 0.0, 0.0)
):
    """Spots (n, beacons, 2) of a sensor that is built otherwise: relative, rad about its axes, rad and m (docking)."""
    dock, mount = model.dcm_dock_from_lvlh, model.dcm_cam_from_lvlh
    beacons = model.sensor.beacons_dock_m + np.cross(turn, model.sensor.beacons_dock_m) + shift
    sight = model.port_position_m + beacons @ dock - truth[:, None, :3]
    from_chaser = sight @ mount.T
    c = from_chaser - np.cross(attitude, from_chaser) - model.camera_lever_cam_m
    c = c - np.cross(camera, c)  # theta of the camera: exp(-[theta x]) c
    spots = model.sensor.focal_length_m * (1.0 + focal) * c[..., :2] / c[..., 2:]
    return np.where(seen, spots, np.nan)


def flown(model, name, seed=11):
    """A log without noise and with faults; which coordinates are seen."""
    start = (2.5, 0.02, -0.02) if name == "near the port" else (7.0, 0.02, 0.03)
    sensor = dataclasses.replace(model.sensor, spot_noise_m=1e-12)
    silent = dataclasses.replace(model, sensor=sensor, calibration=None)
    log = simulate(silent, Approach(duration_s=40.0, start_m=start, final_range_m=2.0), Faults(), seed=seed)
    seen = np.isfinite(log.spots_m)
    seen[60:70, 0] = False  # two beacons
    seen[90:120] = False  # a gap
    seen[150:154, 1, 0] = False  # half a beacon
    return log, seen


def run(model, log, spots, method="spots", *, smooth=False):
    """Epochs with the filter's own factors, and what is considered."""
    filter_, control = LogFilter(model, method), np.zeros((len(log.t_s), 6))
    control[:, :3] = log.acceleration_m_s2
    epochs = filter_.room(len(log.t_s), smooth=True)
    filter_.forward(log.t_s, spots, control, np.empty((0, 4)), epochs)
    if smooth:
        views(filter_.block).motion["acceleration"] = 0.0
        forward = epochs.codes, epochs.state, epochs.factor, epochs.considered
        smooth_run(filter_.block, log.t_s, control, *forward, filter_.nothing_later())
    return epochs


def noisy(model, log, seen):
    """The log's spots with noise, and a glint."""
    noise = np.random.default_rng(4).normal(size=seen.shape) * model.sensor.spot_noise_m
    spots = images(model, log.truth, seen) + noise
    spots[200, 2] += 1e-3
    return spots


def covariances(packed):
    ld = np.zeros((len(packed), 6, 6))
    ld[:, *np.tril_indices(6)] = packed
    return compose(ld)


CASES = [
    ("vbar", "spots"),
    ("vbar", "fix"),
    ("rbar", "spots"),
    ("rbar", "fix"),
    ("attitude unknown", "spots"),
    ("attitude unknown", "fix"),
    ("nine beacons", "spots"),
    ("near the port", "spots"),
]


def check_derivatives(model, name, method, smooth, errors, felt_share=0.3):
    """The filter's estimate by each error (built with +-1 % of a sigma of it) beside its sensitivities."""
    log, seen = flown(model, name)
    nominal = images(model, log.truth, seen)
    np.testing.assert_allclose(nominal[seen], log.spots_m[seen], atol=1e-10)
    epochs = run(model, log, nominal, method, smooth=smooth)
    running = np.isfinite(epochs.state[:, 0])
    assert running.mean() > 0.9
    assert np.sum(epochs.codes[:, 1] == STARTED) == 1
    own = np.sqrt(np.diagonal(covariances(epochs.factor), axis1=1, axis2=2))[running]
    scale = np.sqrt(np.einsum("nji,nji->ni", epochs.considered, epochs.considered))[running]
    allowed = 0.01 * scale + 7e-3 * own  # the gain depends on the estimate; 3 % of an error more or less fails
    assert np.median(scale[:, :3] / own[:, :3]) > felt_share
    assert epochs.considered.shape[1] == len(errors)
    untouched = (error(model, log.truth, seen, 1.0) for error in errors)
    felt = [j for j, spots in enumerate(untouched) if not np.array_equal(spots, nominal, equal_nan=True)]
    assert not np.delete(epochs.considered[running], felt, axis=1).any()
    for j in felt:
        error, moved = errors[j], []
        for part in (0.01, -0.01):
            other = run(model, log, error(model, log.truth, seen, part), method, smooth=smooth)
            assert np.array_equal(other.codes, epochs.codes)
            moved.append(other.state[running])
        derivative = (moved[0] - moved[1]) / 0.02
        difference = np.abs(derivative - epochs.considered[running, j])
        np.testing.assert_array_less(difference, allowed, err_msg=f"error {j}")


def field(spots, box_m=3e-3):
    """Weights (n, beacons, 16) of 4 x 4 nodes over +-box for spots: bilinear, of unit length."""
    u = np.clip(np.nan_to_num(spots) / box_m, -1.0, 1.0)
    sides = np.maximum(0.0, 1.0 - np.abs(1.5 * (u[..., None] + 1.0) - np.arange(4)))
    sides /= np.sqrt((sides**2).sum(axis=-1, keepdims=True))
    return (sides[..., 0, :, None] * sides[..., 1, None, :]).reshape(*spots.shape[:-1], 16)


def spot_errors(sigma_m):
    """One sigma of every node's error, of x and then of y."""

    def error(axis, node):
        def spots(model, truth, seen, part):
            out = images(model, truth, seen)
            shift = np.zeros(out.shape)
            shift[..., axis] = part * sigma_m * field(out)[..., node]
            return out + shift

        return spots

    return [error(axis, node) for axis in range(2) for node in range(16)]


def tolerance_errors(model):
    t, n = model.tolerances, len(model.beacons_lvlh_m)
    sizes = [("attitude", axis) for axis in model.attitude.sigma_rad * np.eye(3)]
    sizes += [("focal", t.focal_length_relative_sigma)]
    sizes += [("camera", axis) for axis in t.camera_mounting_sigma_rad * np.eye(3)]
    sizes += [("turn", axis) for axis in t.beacon_mounting_sigma_rad * np.eye(3)]
    sizes += [("shift", shift) for shift in t.beacon_placement_sigma_m * np.eye(3 * n).reshape(-1, n, 3)]
    return [
        lambda model, truth, seen, part, key=key, size=size: images(model, truth, seen, **{key: part * size})
        for key, size in sizes
    ]


@pytest.mark.parametrize("smooth", [False, True], ids=["filtered", "smoothed"])
@pytest.mark.parametrize(("name", "method"), CASES)
def test_sensitivities_are_the_derivatives_of_the_filter(models, name, method, smooth):
    model = models[name]
    check_derivatives(model, name, method, smooth, spot_errors(SIGMA_M))


def tolerant(model):
    """The same sensor, its tolerances considered; half a millimetre of placement, to show beside the others."""
    tolerances = dataclasses.replace(model.tolerances, considered=True, beacon_placement_sigma_m=5e-4)
    return dataclasses.replace(model, tolerances=tolerances)


@pytest.mark.parametrize("smooth", [False, True], ids=["filtered", "smoothed"])
@pytest.mark.parametrize(("name", "method"), CASES)
def test_sensitivities_to_tolerances_are_the_derivatives_of_the_filter(models, name, method, smooth):
    model = tolerant(models[name])
    check_derivatives(model, name, method, smooth, spot_errors(SIGMA_M) + tolerance_errors(model))


@pytest.fixture(scope="module")
def levered(models):
    """Nothing considered but an attitude's error, the camera being off the chaser's centre of mass."""
    model = dataclasses.replace(models["vbar"], calibration=None)
    camera = dataclasses.replace(model.camera, position_m=(0.02, -0.03, 0.3))
    return dataclasses.replace(
        model, camera=camera, attitude=dataclasses.replace(model.attitude, sigma_rad=np.radians(0.05))
    )


@pytest.mark.parametrize("smooth", [False, True], ids=["filtered", "smoothed"])
@pytest.mark.parametrize("method", ["spots", "fix"])
def test_sensitivities_to_the_attitude_are_the_derivatives_of_the_filter(levered, method, smooth):
    check_derivatives(levered, "vbar", method, smooth, tolerance_errors(levered)[:3], felt_share=0.0)


@pytest.mark.parametrize("method", ["spots", "fix"])
@pytest.mark.parametrize("smooth", [False, True], ids=["filtered", "smoothed"])
def test_reported_is_the_filters_own_and_what_is_considered(models, method, smooth):
    model = models["vbar"]
    log, seen = flown(model, "vbar")
    spots = images(model, log.truth, seen)
    epochs = run(model, log, spots, method, smooth=smooth)
    solution = relnav.filter_epochs(
        model, log.t_s, spots, acceleration_m_s2=log.acceleration_m_s2, method=method, smooth=smooth
    )
    running = np.isfinite(solution.state[:, 0])
    assert np.array_equal(solution.state, epochs.state, equal_nan=True)
    own = covariances(epochs.factor)[running]
    added = np.einsum("nji,njk->nik", epochs.considered, epochs.considered)[running]
    expected = np.sqrt(np.diagonal(own + added, axis1=1, axis2=2))
    np.testing.assert_allclose(solution.sigma[running], expected, rtol=1e-9)
    assert np.median(solution.sigma[running][200:, 0] ** 2 / own[200:, 0, 0]) > 1.5  # it matters


def test_image_by_image_and_in_pieces(models):
    model = models["vbar"]
    log, seen = flown(model, "vbar")
    spots = noisy(model, log, seen)
    whole = relnav.filter_epochs(model, log.t_s, spots, acceleration_m_s2=log.acceleration_m_s2, method="spots")
    navigator = relnav.Navigator(model, method="spots")
    for e in range(len(log.t_s)):
        record = navigator.step(log.t_s[e], spots[e], acceleration_m_s2=log.acceleration_m_s2[e])
        np.testing.assert_array_equal(record.state, whole.state[e])
        if record.has_state:
            np.testing.assert_array_equal(record.covariance, whole.covariance[e])
            assert record.sigma_range_m == whole.docking_sigma[e, 0]


@pytest.mark.parametrize("smooth", [False, True], ids=["filtered", "smoothed"])
def test_a_streamed_log_is_the_same(models, tmp_path, monkeypatch, smooth):
    model = models["vbar"]
    log, _ = flown(model, "vbar")
    write_log(log, tmp_path / "log.csv")
    filter_file(tmp_path / "log.csv", model, tmp_path / "one.csv", smooth=smooth, method="spots")
    monkeypatch.setattr(logs, "CHUNK_LINES", 64)
    filter_file(tmp_path / "log.csv", model, tmp_path / "many.csv", smooth=smooth, method="spots")
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "many.csv").read_bytes()


@pytest.mark.parametrize(
    ("name", "method"),
    [
        *itertools.product(["vbar", "attitude unknown"], ["spots", "fix"]),
        ("near the port", "spots"),  # a fix needs A and B, which are off the detector
    ],
)
def test_engines_agree(models, name, method):
    model = models[name]
    log, seen = flown(model, name)
    spots = noisy(model, log, seen)
    ours, theirs = (
        relnav.filter_epochs(
            model, log.t_s, spots, acceleration_m_s2=log.acceleration_m_s2, method=method, engine=engine
        )
        for engine in ("compiled", "filterpy")
    )
    assert np.array_equal(ours.status, theirs.status)
    assert np.nanmax(np.abs(ours.state - theirs.state) / ours.sigma) < 1e-9
    assert np.nanmax(np.abs(theirs.sigma / ours.sigma - 1.0)) < 1e-9


@pytest.mark.parametrize(("name", "limit"), [("spots", 10.0), ("tolerances", 100.0)])
def test_nees_of_sensors_with_lasting_errors(models, name, limit):
    """Eighty sensors, a flight each as the filter assumes it: 6; what does not consider them has 24 and 3000."""
    model = models["vbar"] if name == "spots" else tolerant(models["vbar"])
    ignorant = dataclasses.replace(calibrated(model, 0.0), tolerances=None)
    as_noise = np.full((600, 3, 2), np.hypot(model.sensor.spot_noise_m, SIGMA_M))
    approach = Approach(duration_s=60.0, start_m=(7.0, 0.02, 0.03), assumed_noise=True, assumed_start=True)
    runs = []
    for seed in range(80):
        log = simulate(dataclasses.replace(model, calibration=None), approach, Faults(), seed=seed)
        rng = np.random.default_rng((5, seed))
        spots = log.spots_m + rng.normal(size=(3, 2)) * SIGMA_M
        if name == "tolerances":
            t, seen = model.tolerances, np.isfinite(spots)
            built = images(
                model,
                log.truth,
                seen,
                focal=rng.normal() * t.focal_length_relative_sigma,
                camera=rng.normal(size=3) * t.camera_mounting_sigma_rad,
                turn=rng.normal(size=3) * t.beacon_mounting_sigma_rad,
                shift=rng.normal(size=(3, 3)) * t.beacon_placement_sigma_m,
            )
            spots += built - images(model, log.truth, seen)
        run = []
        for mission, sigma, smooth in (
            (model, None, False),
            (model, None, True),
            (ignorant, as_noise, False),
        ):
            solution = relnav.filter_epochs(
                mission,
                log.t_s,
                spots,
                acceleration_m_s2=log.acceleration_m_s2,
                spot_sigma_m=sigma,
                smooth=smooth,
                method="spots",
            )
            late = log.t_s > 30.0
            error = (solution.state - log.truth)[late]
            weighted = np.linalg.solve(solution.covariance[late], error[..., None])[..., 0]
            run.append(np.einsum("ni,ni->n", error, weighted).mean())
        runs.append(run)
    mean, spread = np.mean(runs, axis=0), np.std(runs, axis=0, ddof=1) / 80.0**0.5
    assert (np.abs(mean[:2] - 6.0) < 3.0 * spread[:2]).all(), mean
    assert (spread[:2] < 0.5).all()
    assert mean[2] > limit


def test_a_built_sensor_close_in_is_not_refused(models):
    """From 5 m to 0.6 m with spots of 1 um and beacons 0.2 mm off: every image is used; ignored, most have rejects."""
    model, shares = models["nine beacons"], []
    for seed in range(3):
        for considered in (True, False):
            tolerances = dataclasses.replace(model.tolerances, distortion_limit_m=0.0, considered=considered)
            mission = dataclasses.replace(model, calibration=None, tolerances=tolerances)
            approach = Approach(start_m=(5.0, 0.02, -0.02), final_range_m=0.6, duration_s=250.0)
            log = simulate(as_built(mission, seed), approach, seed=seed, by_received_power=True)
            track = relnav.filter_epochs(
                mission,
                log.t_s,
                log.spots_m,
                acceleration_m_s2=log.acceleration_m_s2,
                spot_sigma_m=log.sigma_m,
                method="spots",
            )
            shares.append(track.accepted.mean())
            if considered:
                known = np.isfinite(track.state[:, 0]) & (log.t_s > 5.0)
                error = (track.state - log.truth)[known]
                weighted = np.linalg.solve(track.covariance[known], error[..., None])[..., 0]
                assert np.einsum("ni,ni->n", error, weighted).mean() < 12.0
    assert min(shares[::2]) > 0.99
    assert max(shares[1::2]) < 0.5


@pytest.mark.parametrize(("figure_length", "expected"), [(1.0, (0.52, 0.05)), (4.0, (0.74, 0.44))])
def test_the_field_is_as_smooth_as_what_calibrations_leave(figure_length, expected):
    """Correlation between spots a third and two thirds of the half width apart: of what is left, and of the nodes."""
    half, products, squares = 3.46e-3, np.zeros((2, 2)), np.zeros(2)
    line = np.linspace(-half, half, 15)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    for seed in range(15):
        rng = np.random.default_rng((11, seed))
        detector = typical_distortion(4e-3, 250e-6, length_m=figure_length * half, seed=seed)
        left = calibrate(grid, detector.apply(grid) + rng.normal(size=grid.shape) * 1e-5).calibration
        nodes = rng.normal(size=(16, 2))

        def both(spots, left=left, detector=detector, nodes=nodes):
            return left.correct(detector.apply(spots)) - spots, field(spots, half) @ nodes

        for k, distance in enumerate((half / 3.0, 2.0 * half / 3.0)):
            one, angle = rng.uniform(-half, half, (2000, 2)), rng.uniform(0.0, 2.0 * np.pi, 2000)
            other = one + distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            inside = (np.abs(other) < half).all(axis=1)
            pairs = zip(both(one[inside]), both(other[inside]), strict=True)
            for way, (here, there) in enumerate(pairs):
                products[way, k] += np.mean(here * there)
                squares[way] += 0.25 * np.mean(here**2 + there**2)
    of_left, of_nodes = products / squares[:, None]
    np.testing.assert_allclose(of_left, expected, atol=0.1)
    np.testing.assert_allclose(of_nodes, of_left, atol=0.3)
