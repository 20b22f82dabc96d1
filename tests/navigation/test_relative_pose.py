"""The pose navigator on simulated flights: accuracy, honesty, few markers, late images, wrong starts, bad data."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.accuracy.pose_filter import flown, loose_errors, tight_errors
from relnav.navigation.pose_state import PoseState
from relnav.navigation.relative_pose import PoseNavigator
from relnav.navigation.status import EpochStatus
from relnav.simulation.marker_flight import MarkerFaults, simulate_flight
from relnav.simulation.trajectory import Approach

NEAR = Approach(
    duration_s=60.0, rate_hz=10.0, start_m=(6.8, 0.25, -0.15), final_range_m=2.5, speed_m_s=0.1, assumed_noise=True
)
FAR = Approach(
    duration_s=60.0, rate_hz=2.0, start_m=(17.0, 0.25, -0.15), final_range_m=3.0, speed_m_s=0.1, assumed_noise=True
)


@pytest.fixture(scope="module")
def mission():
    return relnav.load_model("three_marker_vision")


@pytest.fixture(scope="module")
def flight(mission):
    return simulate_flight(mission, FAR, seed=5)


def fields(record):
    values = [record.t_s, record.state, record.dcm_lvlh_from_target, record.rate_rad_s, record.covariance]
    values += [record.hypotheses, record.observable]
    return values + (list(vars(record.docking).values()) if record.docking is not None else [])


def same(one, other):
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(fields(one), fields(other), strict=True))


def test_near_the_target(mission):
    """What the noise of the images leaves; what the chaser's lasting attitude error adds is that error itself."""
    exact = dataclasses.replace(mission.chaser, attitude_sigma_rad=0.0)
    errors = flown(dataclasses.replace(mission, chaser=exact), NEAR, MarkerFaults(), 4, 20)
    settled = errors.where((errors.t_s > 20.0) & (errors.range_m < 7.0))
    assert settled.position_rms_m <= 1.5e-3
    assert settled.attitude_rms_rad <= math.radians(0.02)
    assert 0.6 < settled.nees_ratio < 1.4  # four flights; the benchmark flies more
    assert np.nanmean(settled.nis_ratio) == pytest.approx(1.0, abs=0.05)  # 3.5 sigma of 9600 degrees of freedom


def test_honest_over_an_approach(mission):
    errors = flown(mission, FAR, MarkerFaults(dropout=0.1), 16, 40)
    last = errors.where(errors.t_s > 15.0)
    assert 0.85 <= last.nees_ratio <= 1.25
    assert np.nanmean(last.nis_ratio) == pytest.approx(1.0, abs=0.05)


def few_markers(mission, density_m2_s3, runs):
    """Errors tight and loose while one marker of three is hidden for half a minute, then two."""
    noise = dataclasses.replace(mission.process_noise, acceleration_noise_density_m2_s3=density_m2_s3)
    restless = dataclasses.replace(mission, process_noise=noise)
    flight = dataclasses.replace(FAR, duration_s=92.0, start_m=(10.0, 0.25, -0.15), speed_m_s=0.05)
    faults = MarkerFaults(hidden=((2, 31.0, 91.0), (1, 61.0, 91.0)))
    both = [flown(restless, flight, faults, runs, 60, way) for way in (tight_errors, loose_errors)]
    return [[e.where((e.t_s > at) & (e.t_s < at + 30.0)) for e in both] for at in (31.0, 61.0)]


def test_two_markers_then_one(mission):
    """The tight filter goes on measuring where the loose one only predicts.

    Under the conditions of the design's prototype, which on two markers for half a minute was off by 33 mm along the
    range and 17 on each axis across when loose, by 4.5 and 1.9 when tight; then, on one, by 81 and 59, 18 and 3.2: that
    is acceleration noise of 1e-7 m^2/s^3, by the size of the drift.
    """
    prototype = ((32.9e-3, 17e-3), (4.5e-3, 1.9e-3)), ((80.9e-3, 59e-3), (17.9e-3, 3.2e-3))
    for (tight, loose), figures, factor in zip(few_markers(mission, 1e-7, 6), prototype, (5.0, 4.0), strict=True):
        assert factor * tight.position_rms_m <= loose.position_rms_m
        for errors, (along, across) in zip((loose, tight), figures, strict=True):
            reported = math.sqrt(np.trace(errors.covariance[:, :3, :3], axis1=1, axis2=2).mean())
            assert reported == pytest.approx(math.sqrt(along**2 + 2.0 * across**2), rel=0.25)
        assert tight.nees_ratio < 1.5
        assert np.nanmean(tight.nis_ratio) == pytest.approx(1.0, abs=0.1)


def test_two_markers_on_a_quiet_flight(mission):
    """At the model's own 1e-10 prediction alone drifts 7 mm: there is less to gain, a factor of 2 to 3, not 5."""
    tight, loose = few_markers(mission, mission.process_noise.acceleration_noise_density_m2_s3, 6)[0]
    assert 0.2 < tight.position_rms_m / loose.position_rms_m < 0.5


def test_the_start(mission, flight):
    nav = PoseNavigator(mission)
    record = nav.step(0.0, np.full((3, 2), np.nan))
    assert record.status is EpochStatus.WAITING
    assert np.isnan(record.covariance).all()
    assert record.docking is None
    one = flight.spots_px[0].copy()
    one[2] = np.nan
    assert nav.step(0.5, one).status is EpochStatus.WAITING
    assert nav.step(1.0, flight.spots_px[2]).status is EpochStatus.WAITING  # a trial
    record = nav.step(1.5, flight.spots_px[3])
    assert record.status is EpochStatus.STARTED
    assert record.hypotheses == 1
    truth = PoseState(flight.motion[3], flight.dcm_lvlh_from_target[3], flight.rate_rad_s[3], record.covariance)
    error = PoseState(record.state, record.dcm_lvlh_from_target, record.rate_rad_s, record.covariance).error_of(truth)
    assert error @ np.linalg.solve(record.covariance, error) < 30.0
    assert nav.step(2.0, flight.spots_px[4]).status is EpochStatus.UPDATED


def test_late_images_change_no_bit(mission, flight):
    """Between epochs: exposed in the middle of an interval, arriving 1 to 3 epochs later and out of order."""
    times, rng = flight.t_s, np.random.default_rng(3)
    nav, order = PoseNavigator(mission), PoseNavigator(mission)
    exposed = times[:-4] + 0.21
    arrives = rng.integers(1, 4, size=len(exposed)) + np.arange(len(exposed))
    events = sorted([(t, None, k) for k, t in enumerate(times)] + [(e, k, k + 1) for k, e in enumerate(exposed)])
    for t, image, k in events:
        spots = None if image is None else flight.spots_px[image]
        last = order.step(t, spots, acceleration_m_s2=flight.acceleration_m_s2[k])
    for k, t in enumerate(times):
        record = nav.step(t, acceleration_m_s2=flight.acceleration_m_s2[k])
        for j in np.flatnonzero(arrives == k):
            record = nav.step(t, flight.spots_px[j], image_t_s=exposed[j])
            assert not record.too_late
    final = nav.step(times[-1])
    assert same(final, order.step(times[-1]))
    assert last.hypotheses == 1


def test_a_delayed_stream_is_as_good(mission):
    """A quarter of a second late at 0.1 m/s: taken as present it is off by 25 mm, taken in its place by nothing."""
    flight = simulate_flight(mission, dataclasses.replace(NEAR, rate_hz=4.0, duration_s=40.0), seed=9)
    replayed, naive, errors = PoseNavigator(mission), PoseNavigator(mission), {"replayed": [], "naive": []}
    for k, t in enumerate(flight.t_s):
        push = flight.acceleration_m_s2[k]
        image = flight.spots_px[k - 1] if k else None
        records = {
            "replayed": replayed.step(t, image, image_t_s=flight.t_s[k - 1] if k else None, acceleration_m_s2=push),
            "naive": naive.step(t, image, acceleration_m_s2=push),
        }
        for name, record in records.items():
            if t > 20.0:
                truth = PoseState(flight.motion[k], flight.dcm_lvlh_from_target[k], flight.rate_rad_s[k], None)
                state = PoseState(record.state, record.dcm_lvlh_from_target, record.rate_rad_s, record.covariance)
                error = state.error_of(truth)
                errors[name].append(
                    (np.linalg.norm(error[:3]), error @ np.linalg.solve(record.covariance, error) / 12.0)
                )
    figures = {name: np.mean(values, axis=0) for name, values in errors.items()}
    assert figures["replayed"][0] < 3e-3
    assert figures["replayed"][1] < 1.6
    assert figures["naive"][1] > 20.0


def test_the_window(mission, flight):
    nav = PoseNavigator(mission)
    for k, t in enumerate(flight.t_s[:20]):
        before = nav.step(t, flight.spots_px[k])
    t = flight.t_s[19]
    outside = nav.step(t, flight.spots_px[3], image_t_s=t - mission.filter.longest_delay_s - 0.1)
    assert outside.too_late
    assert outside.status is EpochStatus.PREDICTED
    np.testing.assert_array_equal(outside.state, before.state)
    assert not nav.step(t, flight.spots_px[16], image_t_s=flight.t_s[16]).too_late
    assert len(nav._timeline.passed) < 3.0 + mission.filter.longest_delay_s / 0.5 + 2.0  # memory does not grow


def test_the_first_image_may_be_late(mission, flight):
    nav = PoseNavigator(mission)
    nav.step(flight.t_s[0])
    nav.step(flight.t_s[3])
    assert nav.step(flight.t_s[3], flight.spots_px[1], image_t_s=flight.t_s[1]).status is EpochStatus.WAITING
    record = nav.step(flight.t_s[3], flight.spots_px[2], image_t_s=flight.t_s[2])
    assert record.hypotheses == 1
    assert record.status is EpochStatus.STARTED
    turned_round = PoseNavigator(mission)
    turned_round.step(flight.t_s[3], flight.spots_px[2], image_t_s=flight.t_s[2])
    assert turned_round.step(flight.t_s[3], flight.spots_px[1], image_t_s=flight.t_s[1]).status is EpochStatus.STARTED


def test_one_marker_at_a_time(mission):
    """Time-multiplexed sources: each spot with its own time, full images only at the start: the two that it takes."""
    flight = simulate_flight(mission, dataclasses.replace(NEAR, duration_s=40.0), seed=3)
    nav = PoseNavigator(mission)
    for k, t in enumerate(flight.t_s):
        spots = flight.spots_px[k].copy()
        if k > 1:
            spots[np.arange(3) != k % 3] = np.nan
        record = nav.step(t, spots, acceleration_m_s2=flight.acceleration_m_s2[k])
    assert np.linalg.norm(record.state[:3] - flight.motion[-1, :3]) < 4e-3
    assert record.observable


def test_a_lone_pair_for_long_is_flagged(mission):
    faults = MarkerFaults(hidden=((2, 10.0, 1e9),))
    flight = simulate_flight(mission, dataclasses.replace(FAR, duration_s=60.0), faults, seed=4)
    nav, flags = PoseNavigator(mission), []
    for k, t in enumerate(flight.t_s):
        flags.append(nav.step(t, flight.spots_px[k], acceleration_m_s2=flight.acceleration_m_s2[k]).observable)
    lost = flight.t_s[1:][np.flatnonzero(~np.array(flags[1:]))]
    assert lost[0] == pytest.approx(10.0 + mission.filter.few_markers_limit_s, abs=0.51)


def test_glints_are_refused(mission):
    flight = simulate_flight(mission, FAR, MarkerFaults(outliers=0.05), seed=8)
    errors = tight_errors(mission, flight)
    last = errors.where(errors.t_s > 20.0)
    assert last.position_rms_m < 0.05
    assert last.nees_ratio < 2.0


def test_a_wrong_start_is_given_up(mission, flight):
    """Spots of another pose first: after three images that fit nothing the navigator starts anew."""
    nav = PoseNavigator(mission)
    nav.step(0.0, flight.spots_px[0][[1, 0, 2]] + [40.0, -20.0])
    for k in range(1, 40):
        record = nav.step(flight.t_s[k], flight.spots_px[k], acceleration_m_s2=flight.acceleration_m_s2[k])
    assert np.linalg.norm(record.state[:3] - flight.motion[39, :3]) < 0.1


def test_bad_data_never_raise_and_covariances_stay_positive(mission, flight):
    nav, rng = PoseNavigator(mission), np.random.default_rng(12)
    for k, t in enumerate(flight.t_s):
        spots = flight.spots_px[k].copy()
        trouble = rng.integers(0, 8)
        if trouble == 0:
            spots[:] = np.nan
        elif trouble == 1:
            spots[rng.integers(3)] = rng.uniform(-1e6, 1e6, size=2)
        elif trouble == 2:
            spots[rng.integers(3)] = [np.inf, 0.0]
        elif trouble == 3:
            spots[:] = spots[0]
        elif trouble == 4:
            spots = rng.uniform(0.0, 1000.0, size=(3, 2))
        gap = 300.0 if k == 60 else 0.0
        record = nav.step(t + gap + (300.0 if k > 60 else 0.0), spots)
        if record.hypotheses:
            assert np.linalg.eigvalsh(record.covariance)[0] > 0.0
            assert np.linalg.eigvalsh(record.docking.covariance)[0] > -1e-18
        else:
            assert np.isnan(record.state).all()


def test_wrong_use(mission, flight):
    nav = PoseNavigator(mission)
    nav.step(1.0, flight.spots_px[0])
    with pytest.raises(ValueError, match="not before the last epoch"):
        nav.step(0.5)
    with pytest.raises(ValueError, match="image_t_s must be finite and not after"):
        nav.step(2.0, flight.spots_px[0], image_t_s=3.0)
    with pytest.raises(ValueError, match=r"spots_px has shape \(3, 2\)"):
        nav.step(2.0, np.zeros((2, 2)))
    with pytest.raises(ValueError, match="rotation matrix"):
        nav.step(2.0, dcm_chaser_from_lvlh=np.ones((3, 3)))
    with pytest.raises(ValueError, match="acceleration_m_s2 has three finite components"):
        nav.step(2.0, acceleration_m_s2=[np.nan, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"delta_v_m_s has shape \(3,\); got \(2,\)"):
        nav.step(2.0, delta_v_m_s=[1.0, 0.0])
    before = nav.memory.copy()
    for said in ({"delta_v_m_s": [0.0, np.inf, 0.0]}, {"dcm_chaser_from_lvlh": 1.1 * np.eye(3)}):
        with pytest.raises(ValueError, match=r"three finite components|rotation matrix"):
            nav.step(2.0, flight.spots_px[0], **said)
    assert nav.memory.tobytes() == before.tobytes()
    assert nav.step(2.0).t_s == 2.0


def test_records_do_not_change(mission, flight):
    nav = PoseNavigator(mission)
    record = nav.step(0.0, flight.spots_px[0])
    kept = record.state.copy()
    nav.step(0.5, flight.spots_px[1])
    np.testing.assert_array_equal(record.state, kept)
    with pytest.raises(ValueError, match="read-only"):
        record.state[0] = 0.0


def test_docking_port_against_truth(mission, flight):
    nav = PoseNavigator(mission)
    for k, t in enumerate(flight.t_s):
        record = nav.step(t, flight.spots_px[k], acceleration_m_s2=flight.acceleration_m_s2[k])
    C, rho = flight.dcm_lvlh_from_target[-1], flight.motion[-1, :3]
    d_B = np.array(mission.chaser.port_position_m)
    truth = C.T @ (rho + mission.dcm_chaser_from_lvlh.T @ d_B) - np.array(mission.target.port_position_m)
    error = truth - record.docking.position_m
    assert error @ np.linalg.solve(record.docking.covariance[:3, :3], error) < 20.0
    relative = Rotation.from_matrix(record.docking.dcm_target_from_chaser @ mission.dcm_chaser_from_lvlh @ C)
    assert relative.magnitude() < math.radians(0.3)


def test_a_flat_pattern_keeps_the_truth():
    """From 20 m two poses explain an image; where the first one is wrong the record does not rely on it."""
    flat = relnav.load_model("three_marker_vision_flat")
    approach = dataclasses.replace(FAR, duration_s=150.0, rate_hz=1.0, start_m=(20.0, 0.25, -0.15))
    for seed in (1018, 1039, 1046, 1003, 1010):  # the first three are the hardest of a hundred
        flight, nav = simulate_flight(flat, approach, seed=seed), PoseNavigator(flat)
        for k, t in enumerate(flight.t_s):
            record = nav.step(t, flight.spots_px[k], acceleration_m_s2=flight.acceleration_m_s2[k])
        truth = PoseState(flight.motion[-1], flight.dcm_lvlh_from_target[-1], flight.rate_rad_s[-1], None)
        errors = [hypothesis.state.error_of(truth)[6:9] for hypothesis in nav.hypotheses]
        spreads = [hypothesis.state.covariance[6:9, 6:9] for hypothesis in nav.hypotheses]
        right = [
            e @ np.linalg.solve(P, e) < 36.0 or np.linalg.norm(e) < 0.02 for e, P in zip(errors, spreads, strict=True)
        ]
        assert any(right)
        assert right[0] or record.ambiguity < 18.4
