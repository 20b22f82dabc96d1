"""A gyro sample that is wrong turns the estimate: the attitude is right again at once, and the gyro is named.

Truth is the simulated flight; what is wrong with gyro and star sensor is added here. A star sensor that is wrong alone
must not turn the filter.
"""

import copy
import dataclasses
import pickle
import random

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.accuracy.rendezvous import checkpoint
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle import smoothing
from relnav.vehicle.attitude_jump import DROP, Jump, Verdict
from relnav.vehicle.health import REFUSED
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother
from relnav.vehicle.update import Outcome

FAULT_S, ENDS_S, SEEDS = 8.0, 24.0, range(6)
LIGHTS, SUNS = ("camera", "psd"), ("sun_aps", "sun_birefringent")
LARGEST = 21.1
"""Chi-square of three that one in 10,000 exceeds."""


@pytest.fixture(scope="module")
def runs(vehicle):
    """Two dozen seconds at 10 m, several times; the hand-over is known to 0.1 m."""
    near = dataclasses.replace(vehicle.hand_over, port_distance_m=(10.0, 0.0, 0.0), position_sigma_m=0.1)
    there = dataclasses.replace(vehicle, hand_over=near)
    flight = Rendezvous(start_m=10.0, final_m=9.0, fast_m_s=0.03, slow_m_s=0.03)
    return [simulate_rendezvous(there, flight, seed=seed) for seed in SEEDS]


def axis_of(seed):
    turn = np.random.default_rng(seed).normal(size=3)
    return turn / np.linalg.norm(turn)


def off(run, seed, wrong, size, lasts_s, *, without=(), ends_s=ENDS_S):
    """The observations without those of some sensors; a fault of the gyro about an axis of the run's own.

    Of the star sensor across the line to the sun, which stands overhead: about it no sun sensor sees a turn.
    """
    for one in run.observations:
        if one.t_s > ends_s or one.sensor in without:
            continue
        value = one.value
        if one.sensor == wrong and FAULT_S <= one.t_s < FAULT_S + lasts_s:
            turn = size * (axis_of(seed) if wrong == "gyro" else np.array([0.0, 1.0, 0.0]))
            value = (
                value + turn if wrong == "gyro" else (Rotation.from_rotvec(turn) * Rotation.from_quat(value)).as_quat()
            )
        yield dataclasses.replace(one, value=value)


def fed(run, observations, **options):
    nav = VehicleNavigator(run.truth.vehicle, **options)
    for one in observations:
        nav.observe(one.sensor, one.t_s, one.value)
    return nav


def nees(run, estimate):
    """Of the chaser's attitude."""
    place = estimate.layout.by_name["chaser_attitude"]
    error = checkpoint(run, estimate).error[place]
    return float(error @ np.linalg.solve(estimate.covariance[place, place], error))


@pytest.mark.parametrize(
    ("size", "lasts_s"), [(0.1, 0.0099), (1.0, 0.0099), (5.0, 0.0099), (100.0, 0.0099), (0.0017, 8.0), (0.01, 8.0)]
)
def test_the_attitude_is_right_again(runs, size, lasts_s):
    """Two seconds after the fault every run, and NEES/3 of all runs within 0.9999 of a chi-square at the end."""
    found = []
    for seed, run in enumerate(runs):
        nav, soon = VehicleNavigator(run.truth.vehicle), None
        for one in off(run, seed, "gyro", size, lasts_s):
            if soon is None and one.t_s > FAULT_S + lasts_s + 2.0:
                soon = nav.state()
            nav.observe(one.sensor, one.t_s, one.value)
        now = nav.state()
        found.append(nees(run, now))
        assert nees(run, soon) < LARGEST
        assert now.sensors["star"].refused == now.sensors["sun_aps"].refused == now.restarts == 0
        assert "gyro" in now.alarms
        assert now.first_alarm_s["gyro"] < FAULT_S + 2.0
        point = checkpoint(run, now)
        assert (np.abs(point.port_error[:3]) < now.port.protection_level_m()).all()
    low, high = chi_square_interval(3 * len(found), 0.9999)
    assert low < np.mean(found) / 3.0 < high


@pytest.mark.parametrize("without", [LIGHTS, SUNS, ("star",), (*LIGHTS, *SUNS)])
def test_with_fewer_sensors_too(runs, without):
    """A sun sensor and lights do where there is no star sensor; a star sensor alone does."""
    for seed, run in enumerate(runs[:3]):
        now = fed(run, off(run, seed, "gyro", 1.0, 0.0099, without=without)).state()
        assert nees(run, now) < LARGEST
        assert "gyro" in now.alarms


@pytest.mark.parametrize("without", [(), LIGHTS, SUNS])
@pytest.mark.parametrize("size", [3e-3, 5e-3, 0.05])
def test_a_wrong_star_sensor_turns_nothing(runs, size, without):
    """Lights, or sun sensors, say that the attitude is as it was."""
    for seed, run in enumerate(runs[:2]):
        now = fed(run, off(run, seed, "star", size, 99.0, without=without)).state()
        assert now.sensors["star"].refused > REFUSED
        assert nees(run, now) < LARGEST
        assert now.alarms == ("star",)


def test_where_nothing_else_measures_both_are_named(runs):
    """A star sensor that has jumped is then believed: what it sees is what a wrong gyro sample makes it see."""
    for wrong, size, lasts_s in (("star", 0.01, 99.0), ("gyro", 1.0, 0.0099)):
        now = fed(runs[0], off(runs[0], 0, wrong, size, lasts_s, without=(*LIGHTS, *SUNS))).state()
        assert now.alarms == ("gyro", "star")
    assert fed(runs[0], off(runs[0], 0, "gyro", 1.0, 0.0099)).state().alarms == ("gyro",)


@pytest.mark.parametrize("without", [(), LIGHTS])
def test_one_false_image_changes_no_bit(runs, without):
    """The hypothesis that it opens is left with the next image: what is told is as if there were none."""
    seen = list(off(runs[0], 0, "star", 0.01, 0.1, ends_s=FAULT_S + 3.0, without=without))
    one, other = VehicleNavigator(runs[0].truth.vehicle), VehicleNavigator(runs[0].truth.vehicle)
    other._filters.follow_jumps, opened = False, 0
    for each in seen:
        one.observe(each.sensor, each.t_s, each.value)
        other.observe(each.sensor, each.t_s, each.value)
        opened += one._timeline.newest.jump is not None
        assert other._timeline.newest.jump is None
    assert (opened > 0) == (without == LIGHTS)  # lights, which came before, contradict it when it comes
    assert one._timeline.newest.jump is None
    assert one.state().covariance.tobytes() == other.state().covariance.tobytes()
    assert one.state().values.tobytes() == other.state().values.tobytes()
    assert (one.state().alarms, dict(one.state().first_alarm_s)) == ((), {})


def test_in_any_order_the_same_bits(runs):
    seen = list(off(runs[0], 0, "gyro", 1.0, 0.0099, ends_s=11.0))
    in_order = fed(runs[0], sorted(seen, key=lambda one: one.t_s)).state()
    assert in_order.alarms == ("gyro",)
    draw = random.Random(3)
    late = fed(runs[0], sorted(seen, key=lambda one: one.t_s + draw.uniform(0.0, 1.0))).state()
    assert late.covariance.tobytes() == in_order.covariance.tobytes()
    assert late.first_alarm_s == in_order.first_alarm_s


def test_copied_while_it_is_a_hypothesis(runs):
    seen = sorted(off(runs[0], 0, "gyro", 1.0, 0.0099, ends_s=11.0), key=lambda one: one.t_s)
    nav = fed(runs[0], (one for one in seen if one.t_s < FAULT_S + 0.25))
    assert nav._timeline.newest.jump is not None
    others = [nav, copy.deepcopy(nav), pickle.loads(pickle.dumps(nav))]
    for one in seen:
        if one.t_s >= FAULT_S + 0.25:
            for each in others:
                each.observe(one.sensor, one.t_s, one.value)
    states = [each.state() for each in others]
    assert states[0].alarms == ("gyro",)
    assert len({each.covariance.tobytes() for each in states}) == 1


def test_with_separation_the_level_holds(runs):
    """The filters without each sensor are turned back too."""
    for seed, run in enumerate(runs[:2]):
        nav = fed(run, off(run, seed, "gyro", 1.0, 0.0099, ends_s=14.0), separation=True)
        now = nav.state()
        assert (np.abs(checkpoint(run, now).port_error[:3]) < now.protection_level_m()).all()
        assert now.sensors["star"].refused == 0


def smoothed(run, observations, times, **options):
    smoother = VehicleSmoother(run.truth.vehicle, **options)
    for one in observations:
        smoother.observe(one.sensor, one.t_s, one.value)
    return smoother.estimates(times)


@pytest.mark.parametrize("monitor", [True, False])
def test_smoothed_apart(runs, monkeypatch, monitor):
    """Right before and after the fault, and where the copy was a hypothesis: it was right then. In pieces of any size.

    Before the fault as a flight that ends there; from the next image on as one that begins there.
    """
    times = np.sort([*np.arange(1.0, ENDS_S), FAULT_S + 0.25, FAULT_S + 0.35])
    for seed, run in enumerate(runs[:3]):
        found = smoothed(run, off(run, seed, "gyro", 1.0, 0.0099), times, monitor=monitor)
        assert [one.t_s for one in found] == times.tolist()
        assert max(nees(run, one) for one in found) < LARGEST
        early = smoothed(run, off(run, seed, "gyro", 1.0, 0.0099, ends_s=FAULT_S), [3.0], monitor=monitor)[0]
        np.testing.assert_allclose(found[2].covariance.diagonal(), early.covariance.diagonal(), rtol=0.05)
    with monkeypatch.context() as patched:
        patched.setattr(smoothing, "CHUNK", 5)
        pieces = smoothed(run, off(run, seed, "gyro", 1.0, 0.0099), times, monitor=monitor)
    for one, other in zip(found, pieces, strict=True):
        assert one.covariance.tobytes() == other.covariance.tobytes()
        assert one.values.tobytes() == other.values.tobytes()


def test_a_hypothesis_that_is_left_is_smoothed_through(runs):
    """A false star image: what was said meanwhile is smoothed as all else, also where the flight ends with it."""
    for lasts_s, ends_s in ((0.1, 12.0), (99.0, FAULT_S + 0.3)):
        seen = list(off(runs[0], 0, "star", 0.01, lasts_s, ends_s=ends_s))
        times = [FAULT_S - 1.0, FAULT_S + 0.12, ends_s - 0.1]
        good = [one for one in seen if one.sensor != "star" or not FAULT_S <= one.t_s < FAULT_S + lasts_s]
        for one, other in zip(smoothed(runs[0], seen, times), smoothed(runs[0], good, times), strict=True):
            np.testing.assert_allclose(one.covariance.diagonal(), other.covariance.diagonal(), rtol=1e-3)
            assert nees(runs[0], one) < LARGEST


def refused_by(used, gain=0.0, groups=1):
    return Outcome(nis=100.0, dof=3, groups=groups, used=used, largest_credible=LARGEST, gains=(0.0, 0.0, gain))


@pytest.fixture
def begun(vehicle):
    """A hypothesis at 5 s, opened by the star sensor, of which a sun sensor was not heard."""
    start = VehicleNavigator(vehicle)._filters.start
    return Jump(start.estimates, start.fares, "star", 5.0, frozenset({"sun_aps"}))


def test_when_it_is_believed(begun):
    good = Outcome(nis=3.0, dof=3, groups=1, used=1, largest_credible=LARGEST)
    for k in range(1, 4):
        begun = begun.after(begun.estimates, "star", begun.fares, good, refused_by(0))
        assert begun.gain == pytest.approx(k * (LARGEST - 3.0))
    assert begun.is_likely
    assert begun.verdict(5.4, "star", refused_by(0), 5.0) is Verdict.CARRIED  # a sun sensor may still say no
    assert begun.verdict(10.0, "star", refused_by(0), 5.0) is Verdict.BELIEVED
    heard = begun.after(begun.estimates, "sun_aps", begun.fares, good, good)
    assert heard.verdict(5.4, "sun_aps", good, 5.0) is Verdict.BELIEVED
    assert heard.verdict(5.4, "star", good, 5.0) is Verdict.LEFT  # believed by the filter after all
    wrong = begun.after(begun.estimates, "sun_aps", begun.fares, refused_by(0), good)
    assert wrong.verdict(10.0, "sun_aps", good, 5.0) is Verdict.CARRIED
    wrong = wrong.after(begun.estimates, "sun_aps", begun.fares, refused_by(0), good)
    assert wrong.against > DROP
    assert wrong.verdict(5.4, "sun_aps", good, 5.0) is Verdict.LEFT


def test_it_is_charged_and_does_not_last(begun):
    good = Outcome(nis=3.0, dof=3, groups=1, used=1, largest_credible=LARGEST, gains=(0.0, 0.0, 50.0))
    charged = begun.after(begun.estimates, "star", begun.fares, good, refused_by(0))
    assert charged.gain == pytest.approx(LARGEST - 3.0 - 100.0)
    assert charged.verdict(14.9, "star", refused_by(0), 5.0) is Verdict.CARRIED
    assert charged.verdict(15.1, "star", refused_by(0), 5.0) is Verdict.LEFT
    unseen = begun.after(begun.estimates, "psd", begun.fares, refused_by(0, groups=0), refused_by(4, groups=4))
    assert unseen.against == pytest.approx(4.0 * DROP)  # four lights could not be where they were seen
