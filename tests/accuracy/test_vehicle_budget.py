"""A vehicle's budget: what the filter reports, shares against the covariance itself, what a better part buys."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy import vehicle_budget
from relnav.accuracy.vehicle_budget import QUANTITIES, budget, sources
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_numbers import Undisturbed
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.filters import VehicleFilters
from relnav.vehicle.forward import estimates_at
from relnav.vehicle.port import port_state
from relnav.vehicle.state import VehicleState

SHORT = Rendezvous(start_m=4.0, final_m=2.0, fast_m_s=0.1, slow_m_s=0.05)


class Noisy(Undisturbed):
    """Nothing that lasts is drawn."""

    def noise(self, name):
        return np.random.default_rng([ord(letter) for letter in name])


@pytest.fixture(scope="module")
def vehicle():
    """Camera, beacons and stars twice a second, a gyro of ten samples: a flight takes a tenth of the time."""
    whole = relnav.load_model("rendezvous_demo")
    sensor = {name: dataclasses.replace(whole.sensor[name], rate_hz=2.0) for name in ("camera", "psd", "star")}
    near = dataclasses.replace(whole.hand_over, port_distance_m=(SHORT.start_m, 0.0, 0.0))
    slow = dataclasses.replace(whole.gyro, rate_hz=10.0)
    return dataclasses.replace(whole, gyro=slow, sensor=sensor, hand_over=near)


@pytest.fixture(scope="module")
def found(vehicle):
    return budget(vehicle, SHORT)


def test_what_is_reported_is_what_the_filter_reports(vehicle, found):
    """Flown as planned, all noise drawn: the same sigmas within 2 %, since little depends on what is seen."""
    run = simulate_rendezvous(vehicle, SHORT, numbers=Noisy())
    nav = relnav.VehicleNavigator(vehicle, monitor=False)
    (end_s,) = run.truth.times_of((SHORT.final_m,)).tolist()
    for seen in sorted(run.observations, key=lambda seen: seen.t_s):
        if seen.t_s <= end_s:
            nav.observe(seen.sensor, seen.t_s, seen.value)
    sigma = nav.state(end_s).port.sigma
    reported = [np.sqrt(np.mean(sigma[part] ** 2)) for _, _, part in QUANTITIES.values()]
    assert found.ranges_m == (3.0, 2.0)
    np.testing.assert_allclose(found.sigma[-1], reported, rtol=0.02)


EXACT = {
    ("camera.lever", "along"): (0.98, 1.02),
    ("psd.mount", "attitude"): (0.85, 1.15),
    ("camera.mount", "attitude"): (0.85, 1.15),
    ("psd.lever", "across"): (1.0, 1.6),  # the filter leans on the better lens: halving it buys more than its part
}


@pytest.mark.parametrize(("name", "quantity"), EXACT)
def test_the_share_of_what_is_considered_stands_in_the_covariance(vehicle, found, name, quantity):
    """Of an error c that is never corrected the port's has the part P_pc P_cc^-1 P_cp, with these gains."""
    run = simulate_rendezvous(vehicle, dataclasses.replace(SHORT, as_believed=True), numbers=Undisturbed())
    filters = VehicleFilters(vehicle, 0.0, monitor=False)
    events = [filters.event(seen.sensor, seen.t_s, seen.value, None) for seen in run.others]
    (end,) = estimates_at(filters, run.samples, events, run.truth.times_of((SHORT.final_m,)).tolist())
    turns = end.dcm_lvlh_from_target, end.dcm_inertial_from_chaser
    state = VehicleState(end.t_s, end.values, *turns, end.covariance)
    port, J = port_state(vehicle, filters.frame, state, end.chaser_rate_rad_s)
    place = end.layout.by_name[name]
    by = (J @ end.covariance[:, place]) / np.sqrt(np.diagonal(end.covariance)[place])
    part = np.sum(by**2, axis=1)
    whole = np.diagonal(port.covariance)
    _, _, rows = QUANTITIES[quantity]
    expected = np.mean(part[rows]) / np.mean(whole[rows])
    assert expected > 0.03
    share = found.shares[name.replace(".", " ")][list(QUANTITIES).index(quantity)]
    low, high = EXACT[name, quantity]
    assert low * expected <= share <= high * expected


def test_every_source_once_and_none_of_size_zero(vehicle, found):
    perfect = dataclasses.replace(vehicle.sensor["psd"], lever_sigma_m=0.0, focal_sigma=0.0)
    names = [one.name for one in sources(dataclasses.replace(vehicle, sensor={**vehicle.sensor, "psd": perfect}))]
    assert len(names) == len(set(names)) == len(found.shares) - 2
    assert set(found.shares) - set(names) == {"psd lever", "psd focal"}
    assert np.isfinite(list(found.shares.values())).all()
    assert found.shares["camera focal"][0] > 0.2, "at the end the distance hangs on the lenses"


def test_a_change(vehicle, found):
    camera = dataclasses.replace(vehicle.sensor["camera"], focal_sigma=1e-4)
    better = budget(dataclasses.replace(vehicle, sensor={**vehicle.sensor, "camera": camera}), SHORT)
    (line,) = better.change_lines(found, "a better lens")
    assert line.startswith(f"a better lens, 1-sigma at 2 m: along {1e3 * found.sigma[-1][0]:.3g} -> ")
    assert better.sigma[-1][0] < 0.9 * found.sigma[-1][0]
    assert better.to_dict()["sources"][0]["name"] == "camera noise"


def test_the_suns_too(monkeypatch):
    """Every sensor of the shipped vehicle has noise and mount, told in its own unit; none of it is flown here."""
    whole = relnav.load_model("rendezvous_demo")
    monkeypatch.setattr(vehicle_budget, "_reported", lambda *_: (np.ones(5),))
    report = budget(whole, dataclasses.replace(SHORT, final_m=3.5))
    text = "\n".join(report.lines())
    for words in ("sun_aps noise             0.03 px a spot", "star noise                2.06 arcsec", "psd noise "):
        assert words in text
    assert all(share.tolist() == [0.0] * 5 for share in report.shares.values())
