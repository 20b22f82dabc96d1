"""A sensor that is wrong from its first observation on: nothing of it is believed, and that is an alarm with its name.

Truth is the simulated flight; what is wrong is how the vehicle file says that a sensor is mounted.
"""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import bent
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.health import REFUSED
from relnav.vehicle.navigator import VehicleNavigator


@pytest.fixture(scope="module")
def run(slow):
    """Half a minute from hand-over on."""
    return simulate_rendezvous(slow, Rendezvous(start_m=5.5, final_m=4.0, fast_m_s=0.05, slow_m_s=0.05), seed=9)


def mounted_off(vehicle, name, deg):
    """The vehicle as a file says that is off by a turn of one sensor's mounting."""
    mounted = vehicle.sensor[name]
    turned = Rotation.from_rotvec([0.0, np.radians(deg), 0.0]) * Rotation.from_matrix(mounted.dcm_sensor_from_chaser)
    other = dataclasses.replace(mounted, q_sensor_from_chaser=tuple(turned.as_quat()))
    return dataclasses.replace(vehicle, sensor={**vehicle.sensor, name: other})


def fed(vehicle, observations, **options):
    nav, first = VehicleNavigator(vehicle, **options), None
    for seen in observations:
        nav.observe(seen.sensor, seen.t_s, seen.value)
        now = nav.state()
        first = first or (now.alarms and (now.sensors, now.alarms))
    return nav.state(), first


def in_time(run):
    return sorted(run.observations, key=lambda seen: seen.t_s)


@pytest.mark.parametrize("monitor", [True, False])
@pytest.mark.parametrize("deg", [4.0, 45.0, 180.0])
def test_a_star_sensor(slow, run, monitor, deg):
    """The chaser's attitude is then known to 0.3 deg, in which the monitor tests nothing: it cannot see it."""
    now, (sensors, named) = fed(mounted_off(slow, "star", deg), in_time(run), monitor=monitor)
    assert np.isnan(now.sensors["camera"].deviation)
    assert sensors["star"].refused == REFUSED
    assert named == now.alarms == ("star",)
    assert now.sensors["star"].alarm
    assert not now.sensors["camera"].alarm


@pytest.mark.parametrize("name", ["camera", "psd"])
def test_a_sensor_that_looks_away(slow, run, name):
    """No light is before its lens: what it sees cannot be of them."""
    now, (sensors, named) = fed(mounted_off(slow, name, 180.0), in_time(run))
    assert sensors[name].refused == REFUSED
    assert named == now.alarms == (name,)


def test_one_that_is_right_again(slow, run):
    """A star sensor off by 3 deg for ten seconds: it is in alarm no more, which `alarms` holds for a while."""
    nav = VehicleNavigator(slow, monitor=False)
    for seen in in_time(run):
        nav.observe(seen.sensor, seen.t_s, bent(slow, seen, "star", np.radians(3.0) if 5.0 < seen.t_s < 15.0 else 0.0))
        if 10.0 < seen.t_s < 15.0:
            assert nav.state().alarms == ("star",)
    assert not nav.state().sensors["star"].alarm
    assert nav.state().alarms == ("star",)


def test_in_any_order(slow, run):
    """Late images make the same alarm at the same time."""
    vehicle = mounted_off(slow, "star", 45.0)
    one, other = VehicleNavigator(vehicle, monitor=False), VehicleNavigator(vehicle, monitor=False)
    for nav, observations in ((one, in_time(run)), (other, run.observations)):
        for seen in observations:
            nav.observe(seen.sensor, seen.t_s, seen.value)
    for t_s in (one.newest_s - 1.0, one.newest_s):
        assert one.state(t_s).sensors == other.state(t_s).sensors


def test_what_is_not_seen_is_not_refused(slow, run):
    """Spots that are not there, and a flight in which nothing is wrong."""
    dark = [seen for seen in in_time(run) if seen.sensor != "camera"]
    nothing = [dataclasses.replace(seen, value=np.full_like(seen.value, np.nan)) for seen in in_time(run)
               if seen.sensor == "camera"]  # fmt: skip
    now, first = fed(slow, sorted([*dark, *nothing], key=lambda seen: seen.t_s))
    assert (first, now.sensors["camera"].refused) == ((), 0)
    assert fed(slow, in_time(run))[1] == ()


@pytest.mark.parametrize(
    ("wrong", "deg", "named"),
    [("psd", 1.0, {"camera"}), ("star", 1.0, {"sun_aps", "sun_birefringent"})],
)
def test_where_two_disagree_the_one_that_is_refused_is_named(slow, run, wrong, deg, named):
    """The other was believed first, within what the hand-over allows."""
    now, _ = fed(mounted_off(slow, wrong, deg), in_time(run))
    assert now.sensors[wrong].refused == 0
    assert set(now.alarms) == named
