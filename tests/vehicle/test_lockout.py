"""A filter of which no light is believed any more: it looks for the target anew, and says so."""

import dataclasses
import random

import numpy as np
import pytest

from relnav.accuracy.rendezvous import true_port
from relnav.accuracy.vehicle_lockout import LockOut, fly_lockout
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import bent, ramp_of
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.spacecraft import RESERVED
from relnav.vehicle.acquisition import LOST_IMAGES
from relnav.vehicle.health import Fare
from relnav.vehicle.monitor import Sums
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother
from relnav.vehicle.update import Outcome

OFF_M = np.array([0.0, 5.0, -3.0])


@pytest.fixture(scope="module")
def run(slow):
    """Twenty seconds from 5.5 m; hand-over is known to 0.1 m."""
    return simulate_rendezvous(slow, Rendezvous(start_m=5.5, final_m=4.0, fast_m_s=0.06, slow_m_s=0.06), seed=21)


def start(run, **more):
    """A filter that is told a wrong place."""
    return VehicleNavigator(run.truth.vehicle, position_m=run.truth.vehicle.start_position_m + OFF_M, **more)


def fed(nav, seen):
    for one in seen:
        nav.observe(one.sensor, one.t_s, one.value)
    return nav


def off_m(run, estimate):
    return np.abs(true_port(run, estimate.t_s)[0][:3] - estimate.port.position_m)


@pytest.mark.parametrize("kind", list(LockOut))
def test_it_comes_back_and_is_right(slow, kind):
    """Two images a second of each of two sensors: ten refused take five seconds, a search as long."""
    found = [fly_lockout(slow, kind, seed) for seed in (1, 2)]
    assert all(one.restarts >= 1 for one in found)
    assert max(one.back_s for one in found) <= 25.0
    assert max(one.unsaid_s for one in found) <= 6
    assert max(one.nees_later for one in found) < 39.1  # chi-square of twelve, one in 10,000


def test_it_says_so(run):
    nav, seen = start(run, monitor=False), [one for one in run.observations if one.t_s < 15.0]
    said = []
    for one in seen:
        nav.observe(one.sensor, one.t_s, one.value)
        now = nav.state()
        said.append((now.restarts, now.ambiguous))
        if now.restarts == 0:
            assert max(now.sensors[name].refused for name in ("camera", "psd")) <= LOST_IMAGES
    order = list(dict.fromkeys(said))
    assert order == [(0, False), (1, True), (1, False)]
    assert (off_m(run, now) < now.port.protection_level_m()).all()
    assert now.explanations == 1


def test_any_order_gives_the_same_bits(run):
    seen = [one for one in run.observations if one.t_s < 12.0]
    in_order = fed(start(run), seen).state()
    assert in_order.restarts == 1
    for seed in range(2):
        draw = random.Random(seed)
        late = sorted(seen, key=lambda one, draw=draw: one.t_s + draw.uniform(0.0, 1.0))
        found = fed(start(run), late).state()
        assert found.values.tobytes() == in_order.values.tobytes()
        assert found.covariance.tobytes() == in_order.covariance.tobytes()
        assert (found.restarts, found.explanations) == (1, in_order.explanations)


def with_spots(run, begins_s, ends_s, change):
    """The observations, those of lights in between changed."""
    for one in run.observations:
        if one.sensor in ("camera", "psd") and begins_s <= one.t_s < ends_s:
            yield dataclasses.replace(one, value=change(one.sensor, np.array(one.value)))
        else:
            yield one


def test_the_filter_that_was_locked_out_is_one_of_the_explanations(run):
    """The two sensors lie, each in another way, until after the search has begun; then they are right."""

    def lie(sensor, spots):
        return spots + np.array([120.0, 0.0] if sensor == "camera" else [0.0, 4e-4])

    def told(begins_s, ends_s):
        nav = VehicleNavigator(run.truth.vehicle, monitor=False)
        return fed(nav, with_spots(run, begins_s, ends_s, lie)).state()

    usual, lied = told(99.0, 99.0), told(6.0, 14.0)
    assert (usual.restarts, lied.restarts) == (0, 1)
    assert not lied.ambiguous
    assert np.abs(lied.port.position_m - usual.port.position_m).max() < 0.01
    assert (lied.port.sigma[:3] < 1.5 * usual.port.sigma[:3]).all()  # it kept what it had learnt before


def test_single_lights_that_agree_by_chance():
    """A filter at a wrong place believes one light of six for as long as one likes."""
    fare = Fare(Sums(0.0))
    for k in range(12):
        fare = fare.after(0.1 * k, [Outcome(nis=30.0, dof=12, groups=6, used=1)])
    assert (fare.doubted, fare.refused, fare.agreed_s == fare.agreed_s) == (12, 0, False)
    assert fare.after(1.2, [Outcome(nis=30.0, dof=12, groups=6, used=3)]).doubted == 13
    agreed = fare.after(1.2, [Outcome(nis=12.0, dof=12, groups=6, used=4)])
    assert (agreed.doubted, agreed.agreed_s) == (0, 1.2)
    assert fare.after(1.2, [Outcome(nis=30.0, dof=4, groups=2, used=0)]).doubted == 12  # fix no attitude


def test_two_lights_are_no_reason(run):
    """A reflection or two, seen for long, say nothing of where the target is."""

    def two(_, spots):
        spots[2:] = np.nan
        return spots

    now = fed(start(run, monitor=False), with_spots(run, 0.0, 99.0, two)).state()
    assert max(now.sensors[name].refused for name in ("camera", "psd")) > LOST_IMAGES
    assert (now.restarts, now.ambiguous) == (0, False)


def test_not_before_its_time(run):
    """`restart_after_s` counts from the last light that was believed, of any sensor."""
    vehicle = run.truth.vehicle
    patient = dataclasses.replace(vehicle, filter=dataclasses.replace(vehicle.filter, restart_after_s=9.0))
    lied = list(with_spots(run, 6.0, 99.0, lambda sensor, spots: spots + (120.0 if sensor == "camera" else 4e-4)))
    for flown, least_s, most_s in ((vehicle, 5.0, 8.0), (patient, 9.0, 12.0)):
        nav = VehicleNavigator(flown, monitor=False)
        for one in lied:
            nav.observe(one.sensor, one.t_s, one.value)
            if nav.state().restarts:
                break
        assert least_s <= nav.newest_s - 6.0 + 0.5 < most_s + 0.5


@pytest.mark.parametrize("name", ["psd", "camera"])
@pytest.mark.parametrize("begins_s", [0.0, 12.0])
def test_with_separation_one_sensor_may_be_at_fault_too(run, name, begins_s):
    """An image opens the search in the filter without its sensor too, but so wide that nothing rests on it.

    Off for good: by 2 sigma of what it tells alone from the start, by 20 once the search is over. (By five from the
    start the two sensors contradict one another, and the search goes on, and says so.)
    """
    vehicle, second, usable, shares = run.truth.vehicle, 1.0, [], []
    nav, off = start(run, separation=True), ramp_of(vehicle, name) * (0.4 if begins_s == 0.0 else 4.0)
    for one in (seen for seen in run.observations if seen.t_s < 24.0):
        nav.observe(one.sensor, one.t_s, bent(vehicle, one, name, off if one.t_s >= begins_s else 0.0))
        if one.t_s >= second:
            second, now = second + 1.0, nav.state()
            if now.restarts and not now.ambiguous:
                usable.append(now)
                shares.append((off_m(run, now) / now.protection_level_m()).max())
    assert nav.state().restarts == 1
    assert len(usable) >= 5
    assert max(shares) < 1.0
    assert set(usable[-1].without) == {*RESERVED, *vehicle.sensor}


def test_the_parts_are_smoothed_apart(run):
    """After the search as a flight of its own; while it lasts what the filter said; before it what was known then."""
    nav, smoother = (
        start(run, monitor=False),
        VehicleSmoother(run.truth.vehicle, position_m=run.truth.vehicle.start_position_m + OFF_M, monitor=False),
    )
    times, filtered = np.arange(1.0, 20.0), []
    for one in sorted(run.observations, key=lambda one: one.t_s):
        while len(filtered) < len(times) and one.t_s > times[len(filtered)]:
            filtered.append(nav.state(times[len(filtered)]))
        nav.observe(one.sensor, one.t_s, one.value)
        smoother.observe(one.sensor, one.t_s, one.value)
    smoothed = smoother.estimates(times)
    assert [one.ambiguous for one in smoothed] == [one.ambiguous for one in filtered]
    assert [one.restarts for one in smoothed] == [one.restarts for one in filtered]
    for one, other in zip(smoothed, filtered, strict=True):
        if one.ambiguous:
            np.testing.assert_array_equal(one.port.position_m, other.port.position_m)
        elif one.restarts:
            assert (off_m(run, one) < one.port.protection_level_m()).all()
            assert (one.port.sigma[:3] <= 1.0001 * other.port.sigma[:3]).all()
    first = next(k for k, one in enumerate(filtered) if one.restarts and not one.ambiguous)
    assert (smoothed[first].port.sigma[3:6] < 0.8 * filtered[first].port.sigma[3:6]).all()
    assert any(one.ambiguous for one in smoothed)


def test_a_flight_that_ends_in_a_search_is_smoothed_before_it(run):
    smoother = VehicleSmoother(run.truth.vehicle, monitor=False)
    lied = with_spots(run, 8.0, 99.0, lambda sensor, spots: spots + (120.0 if sensor == "camera" else 4e-4))
    for one in lied:
        if one.t_s < 16.0:
            smoother.observe(one.sensor, one.t_s, one.value)
    early, late = smoother.estimates([5.0, 15.9])
    assert (early.ambiguous, late.ambiguous) == (False, True)
    assert (off_m(run, early) < early.port.protection_level_m()).all()
