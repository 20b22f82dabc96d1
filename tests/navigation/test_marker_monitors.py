"""Faults of markers that last are told: by name, with none on healthy flights, and over when they are over.

Truth is flown by `relnav.simulation`, which shares nothing with the filter; what lasts is drawn once a run. The shares
of `docs/validation.md` come from `relnav accuracy three_marker_vision --faults`; here a run or two of each class.
"""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.campaign import SEED_STRIDE
from relnav.accuracy.faults import BUILT, DRAWN, TOLD
from relnav.accuracy.marker_faults import UNSEEN, cases, measure_faults, pose_errors, run_once
from relnav.files.marker_logs import write_track
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.navigation.relative_pose import PoseNavigator
from relnav.navigation.status import Alarm
from relnav.simulation.lasting_faults import Fault
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

FROM_S, LASTS_S = 40.0, 15.0
FLIGHT = Approach(80.0, start_m=(8.0, 0.2, -0.2), final_range_m=5.0, assumed_noise=True)


@pytest.fixture(scope="module")
def mission():
    return relnav.load_model("three_marker_vision")


@pytest.fixture(scope="module")
def flight(mission):
    return simulate_flight(mission, FLIGHT, seed=11)


@pytest.fixture(scope="module")
def frozen(flight):
    """Marker b reads as at 40 s until 55 s."""
    spots, t = flight.spots_px.copy(), flight.t_s
    spots[(t >= FROM_S) & (t < FROM_S + LASTS_S), 1] = spots[round(10.0 * FROM_S), 1]
    return spots


def filtered(mission, flight, spots, t=None):
    times = flight.t_s if t is None else t
    return filter_marker_epochs(mission, times, spots, acceleration_m_s2=flight.acceleration_m_s2)


def beyond(solution, flight):
    """Largest error of position and attitude of each epoch, in reported sigmas."""
    sigma = np.sqrt(np.diagonal(solution.covariance, axis1=1, axis2=2))[:, [0, 1, 2, 6, 7, 8]]
    return np.max(np.abs(pose_errors(solution, flight)) / sigma, axis=1)


def has(solution, alarm):
    return solution.alarm & int(alarm) > 0


@pytest.mark.parametrize("flown", [DRAWN, BUILT])
def test_healthy_flights_raise_no_alarm(mission, flown):
    """At most one in 200 is promised; none of four."""
    assert not any(run_once(mission, flown, Fault.HEALTHY, seed).alarmed for seed in range(4))


@pytest.mark.parametrize("fault", [Fault.STUCK, Fault.REFLECTION, Fault.CLOCK, Fault.BIAS_SMALL, Fault.BIAS_LARGE])
def test_faults_are_not_silent(mission, fault):
    for flown in (DRAWN, BUILT):
        assert not run_once(mission, flown, fault, 3).silent


@pytest.mark.parametrize("flown", [DRAWN, BUILT])
def test_noise_does_not_excuse_a_spot_that_was_refused_for_long(mission, flown):
    """After 65 s of two markers the gate has grown; one noisy image puts the displaced spot well inside it."""
    assert not run_once(mission, flown, Fault.BIAS_LARGE, 7 * SEED_STRIDE + 16).silent


@pytest.mark.parametrize("run", [91, 105, 110, 158, 195])
def test_a_witness_that_knows_less_does_not_end_an_alarm(mission, run):
    """The chi-square of a spot that is off for good falls as the witness spreads: the fault was taken for over."""
    assert not run_once(mission, DRAWN, Fault.BIAS_SMALL, 7 * SEED_STRIDE + run).silent


@pytest.mark.parametrize("fault", UNSEEN)
def test_what_images_cannot_tell_is_covered_where_it_is_told(mission, fault):
    assert not run_once(mission, TOLD, fault, 1).silent


def test_a_frozen_spot_is_named_and_left_behind(mission, flight, frozen):
    """STUCK at the tenth reading alike; after it a start, ten seconds RESTARTED, and a state that is right again."""
    solution, t = filtered(mission, flight, frozen), flight.t_s
    named = t[has(solution, Alarm.STUCK)]
    assert named[0] - FROM_S < 1.5
    assert FROM_S + LASTS_S - 0.15 < named[-1] < FROM_S + LASTS_S + 0.05
    assert not solution.alarm[t < FROM_S].any()
    over = t >= FROM_S + LASTS_S + 24.0
    assert not solution.alarm[over].any()
    assert beyond(solution, flight)[over].max() < 5.0


def test_an_error_that_stays_keeps_its_alarm(mission, flight):
    """Three sigma of one spot: taken up by the pose within seconds, which the innovations then do not show."""
    spots = flight.spots_px.copy()
    spots[flight.t_s >= FROM_S, 0, 0] += 0.3
    solution = filtered(mission, flight, spots)
    said = flight.t_s[has(solution, Alarm.SHIFTED)]
    assert said[0] - FROM_S < 3.0
    assert has(solution, Alarm.SHIFTED)[flight.t_s >= said[0]].all()
    assert np.nanmean(solution.nis[-100:] / solution.dof[-100:]) < 1.2
    assert beyond(solution, flight)[-1] > 5.0


def test_a_jump_of_the_clock_is_named_and_recovered(mission):
    fast = dataclasses.replace(FLIGHT, speed_m_s=0.06, final_range_m=4.0)
    flight = simulate_flight(mission, fast, seed=11)
    solution = filtered(mission, flight, flight.spots_px, flight.t_s + 3.0 * (flight.t_s >= FROM_S))
    named = flight.t_s[has(solution, Alarm.CLOCK)]
    assert FROM_S <= named[0] < FROM_S + 3.0
    assert not solution.alarm[flight.t_s > FROM_S + 20.0].any()
    assert beyond(solution, flight)[flight.t_s > FROM_S + 20.0].max() < 5.0


def test_a_gap_is_no_alarm(mission, flight):
    spots = flight.spots_px.copy()
    spots[300:380] = np.nan
    spots[500:520, 2] = np.nan
    assert not filtered(mission, flight, spots).alarm.any()


def test_late_images_raise_the_same_alarms(mission, flight, frozen):
    """Each image exposed 40 ms before its row, and arriving there or with one of the next two rows."""
    rows = range(300, 480)
    in_order, late = PoseNavigator(mission), PoseNavigator(mission)
    expected, given = [], []
    for k in rows:
        t = float(flight.t_s[k])
        expected.append(int(in_order.step(t - 0.04, frozen[k]).alarm))
        in_order.step(t)
    waiting = []
    for k in rows:
        t = float(flight.t_s[k])
        waiting.append(k)
        if k % 3 < 2 and k != rows[-1]:
            late.step(t)
            continue
        for image in waiting[::-1]:
            record = late.step(t, frozen[image], image_t_s=float(flight.t_s[image]) - 0.04)
        given.append(int(record.alarm))
        waiting = []
    assert any(expected)
    assert late.step(t + 1.0).alarm == in_order.step(t + 1.0).alarm
    np.testing.assert_array_equal(late.memory[: len(late.memory)], in_order.memory)


def test_epoch_by_epoch_alarms_are_those_of_the_log_and_of_its_track(mission, flight, frozen, tmp_path):
    solution, nav = filtered(mission, flight, frozen), PoseNavigator(mission)
    alarms = [
        int(nav.step(t, spots, acceleration_m_s2=a).alarm)
        for t, spots, a in zip(flight.t_s, frozen, flight.acceleration_m_s2, strict=True)
    ]
    np.testing.assert_array_equal(alarms, solution.alarm)
    smoothed = filter_marker_epochs(
        mission, flight.t_s, frozen, acceleration_m_s2=flight.acceleration_m_s2, smooth=True
    )
    np.testing.assert_array_equal(smoothed.alarm, solution.alarm)
    write_track([solution], mission.name, tmp_path / "track.csv", {})
    written = (tmp_path / "track.csv").read_text().splitlines()
    column = next(line for line in written if line.startswith("t_s")).split(",").index("alarm")
    assert [int(line.split(",")[column]) for line in written[-len(alarms) :]] == alarms


def test_a_start_that_is_given_is_watched_anew(mission, flight, frozen):
    nav = PoseNavigator(mission)
    for k in range(450):
        record = nav.step(flight.t_s[k], frozen[k], acceleration_m_s2=flight.acceleration_m_s2[k])
    assert record.alarm
    nav.start(record.t_s, record.state, record.dcm_lvlh_from_target, record.rate_rad_s, record.covariance)
    assert not nav.step(flight.t_s[450], flight.spots_px[450]).alarm


def test_a_report_of_two_runs(mission, monkeypatch):
    """Only the columns: a row of every case, and those that images cannot tell marked."""
    import relnav.accuracy.marker_faults as module

    with pytest.raises(ValueError, match="runs must be 2 or more; got 1"):
        measure_faults(mission, runs=1)
    verdict = module.Verdict(beyond=True, alarmed=False, silent=True, recovery_s=np.nan)
    monkeypatch.setattr(module, "run_once", lambda *_: verdict)
    report = measure_faults(mission, runs=2)
    assert len(report.rows) == len(cases())
    assert not report.ok
    assert sum(not row.observable for row in report.rows) == 7
    assert any("not observable" in line for line in report.lines())
    assert report.to_dict()["rows"][0]["silent"] == 2
