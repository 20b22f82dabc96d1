"""The answer depends on the events alone: any order within the window gives the same bits."""

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from relnav.vehicle.filters import VehicleFilters
from relnav.vehicle.forward import estimates_at
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.replay import SPARSE_S, Event, Observed, Replay


def numbers_of(estimate):
    """Everything a navigator says, as bytes."""
    port = [getattr(estimate.port, field.name).tobytes() for field in dataclasses.fields(estimate.port)]
    arrays = ("motion", "dcm_lvlh_from_target", "dcm_inertial_from_chaser", "values", "covariance")
    return (
        port
        + [getattr(estimate, name).tobytes() for name in arrays]
        + [repr(dict(estimate.sensors)), repr(estimate.drifts.deviations)]
    )


def fed(vehicle, observations):
    nav = VehicleNavigator(vehicle)
    return nav, [nav.observe(seen.sensor, seen.t_s, seen.value) for seen in observations]


@pytest.fixture(scope="module")
def begin(short_run):
    """All that was seen in the first half second."""
    return sorted((seen for seen in short_run.observations if seen.t_s < 0.5), key=lambda seen: seen.t_s)


@pytest.fixture(scope="module")
def in_order(vehicle, begin):
    return numbers_of(fed(vehicle, begin)[0].state())


@settings(derandomize=True, max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), lateness=st.sampled_from([0.05, 0.2, 1.0]))
def test_any_order_gives_the_same_bits(vehicle, begin, in_order, seed, lateness):
    rng = np.random.default_rng(seed)
    arrival = [seen.t_s + rng.uniform(0.0, lateness) for seen in begin]
    nav, verdicts = fed(vehicle, [begin[k] for k in np.argsort(arrival, kind="stable")])
    assert Observed.TOO_OLD not in verdicts
    assert Observed.REPLAYED in verdicts
    assert numbers_of(nav.state()) == in_order


@pytest.mark.parametrize("gap_s", [(9.0, 9.0), (0.2, 0.35)])
def test_a_whole_flight_in_order_of_time(vehicle, short_run, gap_s):
    """`forward.estimates_at`, which knows all samples from the start, gives the navigator's bits at every time."""
    times = [0.05, 0.2, 0.3, 0.45, 0.5]
    filters = VehicleFilters(vehicle, 0.0)
    lost = (short_run.samples[:, 0] > gap_s[0]) & (short_run.samples[:, 0] < gap_s[1])
    events = [filters.event(seen.sensor, seen.t_s, seen.value, None) for seen in short_run.others]
    found = list(estimates_at(filters, short_run.samples[~lost], events, times))
    assert any(estimate.gyro_lost for estimate in found) == (gap_s[1] < 1.0)
    nav, left = VehicleNavigator(vehicle), list(zip(times, found, strict=True))
    for seen in sorted(short_run.observations, key=lambda seen: seen.t_s):
        while left and seen.t_s > left[0][0]:
            t_s, estimate = left.pop(0)
            assert numbers_of(estimate) == numbers_of(nav.state(t_s))
        if seen.sensor != "gyro" or not gap_s[0] < seen.t_s < gap_s[1]:
            nav.observe(seen.sensor, seen.t_s, seen.value)
    assert not left


def test_twice_is_once(vehicle, begin, in_order):
    nav, verdicts = fed(vehicle, [seen for seen in begin for _ in range(2)])
    assert verdicts[1::2] == [Observed.REJECTED] * len(begin)
    assert numbers_of(nav.state()) == in_order


def test_asking_changes_nothing(vehicle, begin, in_order):
    nav, _ = fed(vehicle, begin[:30])
    for t in (0.2, 0.21, 5.0):
        nav.state(t)
    nav.propagate(30.0)
    for seen in begin[30:]:
        nav.observe(seen.sensor, seen.t_s, seen.value)
    assert numbers_of(nav.state()) == in_order


def test_the_past_is_what_it_was(vehicle, begin):
    """state(t) in the window is state() of the observations until then."""
    nav, _ = fed(vehicle, begin)
    until, _ = fed(vehicle, [seen for seen in begin if seen.t_s <= 0.3])
    at = nav.state(0.3)
    assert numbers_of(at) == numbers_of(until.state(0.3))
    assert at.t_s == 0.3


def test_a_refused_call_leaves_the_filter_as_it_was(vehicle, begin, in_order):
    nav, _ = fed(vehicle, begin)
    for call in (
        lambda: nav.observe("lidar", 1.0, np.zeros(3)),
        lambda: nav.observe("camera", 1.0, np.zeros(3)),
        lambda: nav.observe("gyro", np.nan, np.zeros(3)),
        lambda: nav.observe("gyro", 1e6, np.zeros(3)),
        lambda: nav.observe("thrust", 1.0, np.full(3, np.nan)),
        lambda: nav.observe("sun_aps", 1.0, np.zeros(3)),
        lambda: nav.state(-1.0),
        lambda: nav.propagate(100.0),
    ):
        with pytest.raises(ValueError, match=r"expected|lies|later|no sensor|at most"):
            call()
    assert numbers_of(nav.state()) == in_order


def test_too_old_and_not_seen(vehicle, begin):
    nav, _ = fed(vehicle, begin)
    nav.observe("gyro", 3.5, np.zeros(3))
    late = begin[0]
    assert nav.observe(late.sensor, 1.2, late.value) is Observed.TOO_OLD
    assert nav.observe("camera", 3.5, np.full((3, 2), np.nan)) is Observed.REJECTED
    assert VehicleNavigator(vehicle, t_s=2.0).observe("gyro", 1.9, np.zeros(3)) is Observed.TOO_OLD


class Toy:
    """A timeline whose states remember every event in order, (value, ...), and what was asked of it."""

    def __init__(self) -> None:
        self.done, self.again = 0, 0
        self.line = Replay[tuple[float, ...], None]((), 0.0, 100.0, self._do, self._do_again)

    def _do(self, state, event):
        self.done += 1
        return (*state, event.value[0]), None

    def _do_again(self, state, event):
        self.again += 1
        return (*state, event.value[0]), None


def toy_event(t_s, value):
    return Event(t_s, 0, "toy", np.array([float(value)]), np.zeros((0, 0)))


@settings(derandomize=True, max_examples=50, deadline=None)
@given(times=st.lists(st.integers(0, 40), min_size=1, max_size=25), data=st.data())
def test_a_timeline_is_a_fold_over_sorted_events(times, data):
    """Whether states between were kept or not, at its end and wherever it is looked at."""
    events = [toy_event(0.05 * t, k) for k, t in enumerate(times)]
    wanted = sorted(events, key=lambda event: event.key)
    timeline, inserted = Toy().line, []
    for event in data.draw(st.permutations(events)):
        timeline.insert(event)
        inserted.append(event)
        asked = 0.05 * data.draw(st.integers(0, 40))
        before = [one.value[0] for one in wanted if one.t_s <= asked and one in inserted]
        assert asked > timeline.newest_s or timeline.before(asked) == tuple(before)
    assert timeline.newest == tuple(event.value[0] for event in wanted)


def test_states_are_kept_as_far_back_as_it_was_gone():
    toy = Toy()
    for k in range(400):
        toy.line.insert(toy_event(0.01 * k, k))
    assert sum(one.state is not None for one in toy.line._line.passed) <= 3.99 / SPARSE_S + 2.0
    assert toy.line.before(3.6) == tuple(map(float, range(361)))
    assert 0 < toy.again <= SPARSE_S / 0.01
    toy.again = 0
    for k in range(400, 600):
        toy.line.insert(toy_event(0.01 * k, k))
        toy.line.before(0.01 * k - 0.3)
    assert toy.again <= 2.0 * SPARSE_S / 0.01  # once, and from then on they were kept
    toy.again = 0
    toy.line.insert(toy_event(5.695, 0.0))
    assert (toy.again, toy.done) == (0, 600 + 31)
