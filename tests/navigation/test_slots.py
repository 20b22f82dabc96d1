"""Raw slots through the filter: what simultaneous slots cost, that slot times remove it, starts, and lost steps."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.navigation.slots import filter_slots
from relnav.sensors.three_beacon.calibrate import calibrate
from relnav.sensors.three_beacon.psd import SlotStatus, currents_of_counts
from relnav.sensors.three_beacon.slots import read_slots
from relnav.simulation.distortion import typical_distortion
from relnav.simulation.raw import simulate_raw, slot_counts
from relnav.simulation.swing import swing
from relnav.simulation.trajectory import Approach

RANGE_M = 6.5


def slots_of(model, t, beacon, counts):
    currents = currents_of_counts(model.detector, counts)
    return read_slots(model.detector, model.pulses, model.sensor.detector_size_m, t, beacon, currents)


@pytest.fixture(scope="module")
def swung(vbar):
    """A minute at 6.5 m, swinging with 0.1 m/s and turning with 1 deg/s."""
    t, beacon = vbar.pulses.schedule(600)
    flown = swing(vbar, t, RANGE_M, 0.1, math.radians(1.0))
    counts = slot_counts(vbar, flown.truth, beacon, np.random.default_rng(5), dcm_cam_from_lvlh=flown.dcm_cam_from_lvlh)
    slots = slots_of(vbar, t, beacon, counts)
    given = {
        "acceleration_m_s2": flown.acceleration_m_s2,
        "q_cam_from_lvlh": Rotation.from_matrix(flown.dcm_cam_from_lvlh).as_quat(),
        "method": "spots",
    }
    return flown, slots, given


@pytest.fixture(scope="module")
def docking():
    """Range, azimuth and elevation of positions (n, 3), by arcsine and arctangent."""

    def run(p):
        r = np.linalg.norm(p, axis=1)
        return np.stack([r, np.arctan2(p[:, 1], p[:, 0]), -np.arcsin(p[:, 2] / r)], axis=1)

    return run


def test_the_swing_is_what_it_says(vbar, swung):
    flown, slots, _ = swung
    np.testing.assert_allclose(np.gradient(flown.truth[:, 1], slots.t_s)[5:-5], flown.truth[5:-5, 4], atol=3e-5)
    assert np.abs(flown.truth[:, 4]).max() == pytest.approx(0.1, rel=1e-3)
    turn = np.gradient(np.arctan2(flown.dcm_cam_from_lvlh @ vbar.dcm_cam_from_lvlh.T, 1.0)[:, 0, 2], slots.t_s)
    assert np.abs(turn).max() == pytest.approx(math.radians(1.0), rel=0.01)


def test_single_images_of_simultaneous_slots_are_wrong_and_interpolated_ones_are_not(vbar, swung, docking):
    flown, slots, _ = swung
    true = docking(flown.truth[:, :3])

    def rms(spots):
        rows = np.flatnonzero(np.isfinite(spots).all(axis=(1, 2)))
        fixes = np.array([relnav.three_beacon.measure(spots[row], vbar).value for row in rows])
        return np.sqrt(np.mean((fixes - true[rows]) ** 2, axis=0))

    wrong, right = rms(slots.simultaneous()[0]), rms(slots.images()[0])
    published = np.array([0.02, math.radians(0.176), math.radians(0.182)])
    assert (right < published).all()
    assert wrong[0] > 1.5 * published[0]
    assert wrong[1] > 2.0 * published[1]
    assert (right[:2] < wrong[:2] / 2.0).all()


def test_slot_times_remove_it_from_the_filter(vbar, swung, docking):
    flown, slots, given = swung
    late = slots.t_s > 20.0
    own = filter_slots(vbar, slots, **given)
    sigma = float(np.sqrt(np.nanmean(slots.sigma_m**2)))
    mission = dataclasses.replace(vbar, sensor=dataclasses.replace(vbar.sensor, spot_noise_m=sigma))
    naive = relnav.filter_epochs(mission, slots.t_s, slots.simultaneous()[0], **given)
    true = docking(flown.truth[:, :3])
    range_own, range_naive = (
        float(np.sqrt(np.nanmean((track.docking - true)[late, 0] ** 2))) for track in (own, naive)
    )
    assert range_own < 0.01
    assert range_naive > 3.0 * range_own

    def nis(track):
        used = late & (track.dof > 0)
        return track.nis[used].sum() / track.dof[used].sum()

    assert 0.8 < nis(own) < 1.1
    assert nis(naive) > 2.0


@pytest.fixture(scope="module")
def approach(vbar):
    log = simulate_raw(vbar, Approach(duration_s=60.0, start_m=(7.0, 0.05, -0.05), final_range_m=5.5), seed=2)
    return log, slots_of(vbar, log.t_s, log.beacon, log.counts)


def test_an_approach_starts_on_images_and_goes_on_slot_by_slot(vbar, approach):
    log, slots = approach
    track = filter_slots(vbar, slots, acceleration_m_s2=log.acceleration_m_s2, method="spots")
    status = track.status
    started = np.flatnonzero(status == relnav.EpochStatus.STARTED)
    assert started.size == 1
    assert log.beacon[started[0]] == 2
    assert log.t_s[started[0]] < 1.0
    after = slice(started[0] + 1, None)
    assert (track.dof[after][log.beacon[after] != 3] == 2).all()
    assert (track.dof[after][log.beacon[after] == 3] == 0).all()
    error = (track.state - log.truth)[-1]
    assert np.linalg.norm(error[:3]) < 0.01
    assert track.restarts == 0


def test_closed_form_and_unknown_attitude_take_images(vbar, unknown_attitude, approach):
    log, slots = approach
    for model, method in ((vbar, "fix"), (unknown_attitude, "spots")):
        track = filter_slots(model, slots, acceleration_m_s2=log.acceleration_m_s2, method=method)
        used = track.dof > 0
        assert (log.beacon[used] == 2).all()
        assert used.sum() > 500
        assert np.linalg.norm((track.state - log.truth)[-1, :3]) < 0.1


def test_sigma_of_slots_is_their_spread(vbar):
    """At rest, so that the spread is the noise."""
    t, beacon = vbar.pulses.schedule(1000)
    for range_m in (5.0, 8.0):
        flown = swing(vbar, t, range_m)
        slots = slots_of(vbar, t, beacon, slot_counts(vbar, flown.truth, beacon, np.random.default_rng(6)))
        for k in range(3):
            own = beacon == k
            np.testing.assert_allclose(slots.spots_m[own].std(axis=0), slots.sigma_m[own].mean(axis=0), rtol=0.08)
        assert (slots.status == SlotStatus.OK).all()


@pytest.mark.parametrize("late_slots", [1, 2, 3])
def test_a_lost_step_is_seen_and_nothing_is_believed(vbar, late_slots):
    t, beacon = vbar.pulses.schedule(20)
    flown = swing(vbar, t, RANGE_M)
    late_s = late_slots * vbar.pulses.slot_s
    slots = slots_of(vbar, t, beacon, slot_counts(vbar, flown.truth, beacon, np.random.default_rng(7), late_s=late_s))
    assert (slots.status == SlotStatus.OUT_OF_STEP).all()
    assert np.isnan(slots.spots_m).all()


def test_a_hidden_beacon_is_under_range_and_the_others_serve(vbar, approach):
    log, _ = approach
    counts = log.counts.copy()
    dark = counts[log.beacon == 3].mean(axis=0)
    counts[log.beacon == 1] = dark
    slots = slots_of(vbar, log.t_s, log.beacon, counts)
    assert (slots.status[log.beacon == 1] == SlotStatus.UNDER_RANGE).all()
    assert (slots.status[log.beacon != 1] == SlotStatus.OK).all()


def test_a_lock_out_ends_in_a_new_start(vbar, approach):
    """At 20 s the log goes on with another chaser, a quarter of a metre beside: rejected, then believed anew."""
    log, slots = approach
    other = simulate_raw(vbar, Approach(duration_s=60.0, start_m=(7.0, 0.3, 0.1), final_range_m=5.5), seed=2)
    moved = slots_of(vbar, other.t_s, other.beacon, other.counts)
    late = log.t_s > 20.0
    spots = np.where(late[:, None], moved.spots_m, slots.spots_m)
    track = filter_slots(
        vbar, dataclasses.replace(slots, spots_m=spots), acceleration_m_s2=log.acceleration_m_s2, method="spots"
    )
    started = log.t_s[track.status == relnav.EpochStatus.STARTED]
    assert len(started) == 2
    assert 20.0 < started[1] < 21.0
    assert track.restarts == 1
    np.testing.assert_array_equal(track.t_s, log.t_s)
    assert np.linalg.norm((track.state - other.truth)[-1, :3]) < 0.02


@pytest.mark.parametrize("seed", [0, 3, 7])
def test_a_calibration_makes_the_filter_accurate_again(vbar, seed, docking):
    """+-250 um of distortion against the published figures: missed without, met five times over with 225 points."""
    distortion = typical_distortion(4e-3, 250e-6, seed=seed)
    line = np.linspace(-3.9e-3, 3.9e-3, 15)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    measured = distortion.apply(grid) + np.random.default_rng(8).normal(size=grid.shape) * 10e-6
    calibrated = dataclasses.replace(vbar, calibration=calibrate(grid, measured).calibration)
    assert calibrated.spot_sigma_m > vbar.spot_sigma_m
    flown = Approach(duration_s=80.0, start_m=(8.0, 0.05, -0.05), final_range_m=6.0)
    log = simulate_raw(vbar, flown, seed=9, distortion=distortion)
    slots = slots_of(vbar, log.t_s, log.beacon, log.counts)
    published = np.array([0.02, math.radians(0.176), math.radians(0.182)])
    late = log.t_s > 30.0
    ratio = {}
    for name, model in (("without", vbar), ("with", calibrated)):
        track = filter_slots(model, slots, acceleration_m_s2=log.acceleration_m_s2, method="spots")
        error = track.docking[late] - docking(log.truth[late, :3])
        ratio[name] = np.sqrt(np.nanmean(error**2, axis=0)) / published
    assert ratio["with"].max() < 0.3
    assert ratio["without"].max() > 5.0


def test_noise_by_received_power_makes_the_filter_consistent(vbar):
    """From 24 um at 10 m to 3 um at 4 m: NIS over degrees of freedom is one in both halves of the approach."""
    log = simulate_raw(vbar, Approach(duration_s=230.0), seed=11)
    slots = slots_of(vbar, log.t_s, log.beacon, log.counts)
    track = filter_slots(vbar, slots, acceleration_m_s2=log.acceleration_m_s2, method="spots")
    for half in (log.t_s < 115.0, log.t_s >= 115.0):
        used = half & (track.dof > 0)
        assert track.nis[used].sum() / track.dof[used].sum() == pytest.approx(1.0, abs=0.06)
    assert (track.status == relnav.EpochStatus.REJECTED).mean() < 1e-3


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_sigma_of_each_row_is_the_filters_noise(vbar, engine):
    """The same number in every row is the model's own; a larger one gives a larger covariance."""
    t = np.arange(30) * 0.1
    spots = np.tile([[-2.3e-3, 0.0], [2.3e-3, 0.0], [0.0, 0.0]], (30, 1, 1))
    given = {"engine": engine}
    own = relnav.filter_epochs(vbar, t, spots, **given)
    same = relnav.filter_epochs(vbar, t, spots, spot_sigma_m=np.full((30, 3, 2), 1e-5), **given)
    np.testing.assert_array_equal(own.state, same.state)
    louder = relnav.filter_epochs(vbar, t, spots, spot_sigma_m=np.full((30, 3, 2), 2e-5), **given)
    assert louder.sigma[-1, 0] > 1.5 * own.sigma[-1, 0]


@pytest.mark.parametrize(
    ("sigma", "text"),
    [
        (np.full((3, 3), 1e-5), r"spot_sigma_m has shape \(30, 3, 2\); got \(3, 3\)"),
        (np.zeros((30, 3, 2)), "spot_sigma_m is above zero, up to 1e\\+30; got .* at epoch 0"),
        (np.full((30, 3, 2), np.inf), "spot_sigma_m is above zero, up to 1e\\+30; got .* at epoch 0"),
    ],
)
def test_sigma_of_another_shape_or_sign(vbar, sigma, text):
    t, spots = np.arange(30) * 0.1, np.zeros((30, 3, 2))
    with pytest.raises(ValueError, match=text):
        relnav.filter_epochs(vbar, t, spots, spot_sigma_m=sigma, method="spots")
