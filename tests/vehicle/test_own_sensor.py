"""A sensor that relnav does not know flies with the vehicle's filter: this class is all that it takes."""

import copy
import pickle

import numpy as np
import pytest

from relnav.accuracy.rendezvous import true_port
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import LastingError
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.port import port_state
from relnav.vehicle.replay import Observed
from relnav.vehicle.rows import Rows

NOISE_M, BIAS_M, BIAS_SIGMA_M = 0.001, 0.017, 0.02


class RangeFinder:
    """Distance from port to port, off by a constant."""

    lasting = (LastingError("bias", 1, BIAS_SIGMA_M),)
    most_rows = 1

    def __init__(self, vehicle):
        self._vehicle, self._frame = vehicle, OrbitFrame(vehicle.orbit)

    def placed(self, name, layout):
        self._bias, self._size = layout.by_name[f"{name}.bias"], layout.size

    def taken(self, value, covariance):
        if np.ndim(value) != 0:
            raise ValueError(f"a distance in metres is expected; got shape {np.shape(value)}")
        return np.array([float(value)]), np.array([[NOISE_M**2 if covariance is None else float(covariance)]])

    def rows(self, state, value, noise):
        port, by_errors = port_state(self._vehicle, self._frame, state, np.zeros(3))
        distance = np.linalg.norm(port.position_m)
        H = np.zeros((1, self._size))
        H[0] = port.position_m / distance @ by_errors[:3]
        H[:, self._bias] = 1.0
        return Rows(value - distance - state.values[self._bias], H, noise, 1)


@pytest.fixture(scope="module")
def run(near):
    """Twelve seconds at 5 m."""
    return simulate_rendezvous(near, Rendezvous(start_m=5.6, final_m=5.0), seed=3)


@pytest.fixture(scope="module")
def seen(run):
    """What the file's sensors and the range finder saw in the first eight seconds, in order."""
    rng = np.random.default_rng(8)
    ranges = [
        ("lidar", t, float(np.linalg.norm(true_port(run, t)[0][:3])) + BIAS_M + NOISE_M * rng.normal())
        for t in np.arange(0.25, 8.0, 0.5).tolist()
    ]
    others = [(one.sensor, one.t_s, one.value) for one in run.observations if one.t_s < 8.0]
    return sorted([*others, *ranges], key=lambda event: event[1])


def flown(vehicle, events, sensors):
    nav = VehicleNavigator(vehicle, sensors=sensors)
    for name, t, value in events:
        if name != "lidar" or sensors:
            assert nav.observe(name, t, value) is not Observed.TOO_OLD
    return nav


def test_it_is_flown_and_what_is_off_is_learnt(near, run, seen):
    nav = flown(near, seen, {"lidar": RangeFinder(near)})
    with_it, without = nav.state(8.0), flown(near, seen, {}).state(8.0)
    bias = nav.layout.by_name["lidar.bias"]
    error, sigma = with_it.values[bias][0] - BIAS_M, with_it.covariance[bias, bias][0, 0] ** 0.5
    assert sigma < 0.6 * BIAS_SIGMA_M
    assert abs(error) < 4.0 * sigma
    assert with_it.port.sigma[0] < without.port.sigma[0]
    assert abs(true_port(run, 8.0)[0][0] - with_it.port.position_m[0]) < 4.0 * with_it.port.sigma[0]
    assert with_it.sensors["lidar"].refused == 0


def test_its_drift_is_named(near, seen):
    """By 5 mm/s from the third second on, of a distance that is known to a millimetre."""
    drifting = [(name, t, value + 0.005 * max(0.0, t - 3.0) if name == "lidar" else value) for name, t, value in seen]
    good, bad = (flown(near, events, {"lidar": RangeFinder(near)}).state() for events in (seen, drifting))
    assert good.alarms == ()
    assert bad.alarms == ("lidar",)


def test_without_lasting_errors_it_is_not_watched_for_a_drift(near):
    class Exact(RangeFinder):
        lasting = ()

        def placed(self, name, layout):
            assert not any(block.startswith(name) for block in layout.by_name)

    nav = VehicleNavigator(near, sensors={"lidar": Exact(near)})
    assert "lidar" not in nav.state().drifts.deviations
    assert "gyro" in nav.state().drifts.deviations


def test_late_or_not_the_same_bits(near, seen):
    events = seen[:200]
    late = sorted(events, key=lambda event: event[1] + 0.4 * (event[0] == "lidar"))
    one, other = (flown(near, order, {"lidar": RangeFinder(near)}).state() for order in (events, late))
    assert one.covariance.tobytes() == other.covariance.tobytes()


def test_a_wrong_distance_is_refused(near, seen):
    nav = flown(near, seen, {"lidar": RangeFinder(near)})
    assert nav.observe("lidar", 8.0, 7.0) is Observed.REJECTED
    with pytest.raises(ValueError, match="a distance in metres is expected"):
        nav.observe("lidar", 8.0, [5.0, 5.0])
    with pytest.raises(ValueError, match="the name 'camera' is taken"):
        VehicleNavigator(near, sensors={"camera": RangeFinder(near)})


def test_copied_and_restored_it_goes_on_bit_for_bit(near, seen):
    nav = flown(near, seen[:150], {"lidar": RangeFinder(near)})
    others = [copy.deepcopy(nav), pickle.loads(pickle.dumps(nav))]
    for each in (nav, *others):
        for name, t, value in seen[150:220]:
            each.observe(name, t, value)
    first = nav.state()
    for each in others:
        assert each.state().covariance.tobytes() == first.covariance.tobytes()
        assert each.state().values.tobytes() == first.values.tobytes()


def test_what_is_fed_to_a_copy_leaves_the_original(near, seen):
    """As `copy.deepcopy`, so `copy.copy`: two navigators, and neither moves the other."""
    nav = flown(near, seen[:150], {"lidar": RangeFinder(near)})
    before, other = nav.state(), copy.copy(nav)
    for name, t, value in seen[150:220]:
        other.observe(name, t, value)
    assert other.newest_s > nav.newest_s
    assert nav.state().covariance.tobytes() == before.covariance.tobytes()
    for name, t, value in seen[150:220]:
        nav.observe(name, t, value)
    assert nav.state().covariance.tobytes() == other.state().covariance.tobytes()
