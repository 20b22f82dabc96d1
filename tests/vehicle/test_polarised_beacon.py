"""A polarised beacon flies with the vehicle: its row against differences, an honest roll, and what is refused."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.sensors.birefringent_sun.polarised import PolarisedRoll, polarised_roll, shares
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import CHASER_ATTITUDE, POSITION, TARGET_ATTITUDE
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.polarised_beacon import PolarisedBeacon

MOUNTED = Rotation.from_quat([-0.5, -0.5, -0.5, 0.5])
LENS, BEACON, FIELD = np.array([0.9, 0.0, 0.1]), np.array([1.4, 0.05, 0.0]), np.array([0.0, 0.6, 0.8])
FLIGHT = Rendezvous(start_m=5.6, final_m=5.0)


@pytest.fixture(scope="module")
def near(vehicle):
    """The vehicle 5.6 m away, with beacons and stars alone, whose roll about the boresight is known badly."""
    over = dataclasses.replace(
        vehicle.hand_over, port_distance_m=(5.6, 0.0, 0.0), position_sigma_m=0.1, target_attitude_sigma_rad=0.01
    )
    sensor = {"star": vehicle.sensor["star"]}
    return dataclasses.replace(vehicle, hand_over=over, sensor=sensor)


def beacon(vehicle):
    return PolarisedBeacon(
        vehicle, q_sensor_from_chaser=MOUNTED.as_quat(), position_m=LENS, beacon_m=BEACON, polarisation=FIELD
    )


def seen(truth, t_s, sensor, rng, photons=1e6):
    """What the sensor counts of the beacon, from the true attitudes, by scipy's rotations; then its candidates."""
    t = np.array([t_s])
    target = Rotation.from_matrix(truth.dcm_frame_from_target(t)[0])
    chaser = Rotation.from_matrix(truth.dcm_chaser_from_frame(t)[0])
    p = MOUNTED.apply(chaser.apply(target.apply(BEACON) - truth.motion(t)[0, :3]) - LENS)
    a = MOUNTED.apply(chaser.apply(target.apply(FIELD)))
    s = p / np.linalg.norm(p)
    across = np.array([1.0, 0.0, 0.0]) - s[0] * s
    across /= np.linalg.norm(across)
    psi = np.arctan2(a @ np.cross(s, across), a @ across)
    return polarised_roll(sensor, s, *rng.poisson(photons * shares(sensor, s, psi)))


def test_the_row_is_the_derivative(near):
    own = beacon(near)
    nav = VehicleNavigator(near, sensors={"roll": own})
    start = nav._filters.start.estimates
    names, layout = nav.layout.by_name, nav.layout
    value, noise = np.array([0.3, 1.9]), np.eye(2)
    row = own.rows(start.of(0), value, noise)
    for block in (POSITION, TARGET_ATTITUDE, CHASER_ATTITUDE, names["roll.mount"]):
        for k in range(block.start, block.stop):
            ends = []
            for h in (1e-6, -1e-6):
                step = np.zeros((len(start.values), layout.size))
                step[:, k] = h
                ends.append(own.rows(start.corrected(step).of(0), value, noise).residual[0])
            assert row.jacobian[0, k] == pytest.approx(-(ends[0] - ends[1]) / 2e-6, abs=2e-8), (block, k)
    assert np.abs(row.jacobian[0, TARGET_ATTITUDE]).max() > 0.5


def test_the_roll_is_found_and_honest(near):
    """Twelve runs: about the line of sight the attitude's sigma falls ten times, and NEES is one in the mean."""
    sensor = relnav.load_model("birefringent_sun").sensor
    squares, falls = [], []
    for seed in range(12):
        run = simulate_rendezvous(near, FLIGHT, seed=seed)
        rng, nav = np.random.default_rng(seed), VehicleNavigator(near, sensors={"roll": beacon(near)}, monitor=False)
        first = nav.state().port.sigma[6]
        events = [(one.t_s, one.sensor, one.value) for one in run.observations if one.t_s < 3.0]
        events += [(t, "roll", seen(run.truth, t, sensor, rng)) for t in np.arange(0.25, 3.0, 0.25).tolist()]
        verdicts = [nav.observe(name, t, value).name for t, name, value in sorted(events, key=lambda one: one[0])]
        assert "REJECTED" not in verdicts
        end = nav.state()
        t = np.array([end.t_s])
        off = Rotation.from_matrix(end.dcm_lvlh_from_target.T @ run.truth.dcm_frame_from_target(t)[0]).as_rotvec()
        sigma = np.sqrt(end.covariance[TARGET_ATTITUDE, TARGET_ATTITUDE][0, 0])
        squares.append((off[0] / sigma) ** 2)
        falls.append(first / end.port.sigma[6])
    assert min(falls) > 10.0
    assert 0.2 < np.mean(squares) < 2.6  # chi-square of 12 over 12: 0.19 to 2.7 hold 99.9 %


def test_what_is_refused(near):
    nav = VehicleNavigator(near, sensors={"roll": beacon(near)})
    with pytest.raises(ValueError, match="a PolarisedRoll, is expected; got a float"):
        nav.observe("roll", 0.1, 0.3)
    roll = PolarisedRoll(np.array([0.3, 1.9]), np.array([1e-4, 1e-4]))
    with pytest.raises(ValueError, match=r"covariance: \(2, 2\) rad\^2 with variances above zero"):
        nav.observe("roll", 0.1, roll, covariance=np.zeros((2, 2)))
    places = {"q_sensor_from_chaser": [0, 0, 0, 1], "position_m": LENS, "beacon_m": BEACON, "polarisation": FIELD}
    with pytest.raises(ValueError, match="beacon_m: three finite numbers are expected"):
        PolarisedBeacon(near, **places | {"beacon_m": [1.0, 2.0]})
    with pytest.raises(ValueError, match="the direction of a field is expected; got no length"):
        PolarisedBeacon(near, **places | {"polarisation": [0.0, 0.0, 0.0]})
    along = PolarisedBeacon(near, **places | {"polarisation": [1.0, 0.0, 0.0]})
    nav = VehicleNavigator(near, sensors={"roll": along})
    assert nav.observe("roll", 0.1, roll).name == "REJECTED", "a field along the line of sight has no angle"
