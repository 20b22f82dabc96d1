"""A simulated gyro whose scale and axes are off: drawn once a run where that is stated, and in all its samples."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.rendezvous import checkpoint
from relnav.accuracy.vehicle_budget import sources
from relnav.simulation.dispersed_vehicle import default_scenario, drawn_once, fly_vehicle_run
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_numbers import OfRun, number_names
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.navigator import VehicleNavigator

SHORT = Rendezvous(start_m=5.6, final_m=5.3)
PAIRS = ("xy", "xz", "yx", "yz", "zx", "zy")
NAMES = [f"gyro_scale_{axis}" for axis in "xyz"] + [f"gyro_misalignment_{pair}" for pair in PAIRS]
"""Scales on the diagonal of the matrix, and what stands beside it by row."""


@pytest.fixture(scope="module")
def right():
    return relnav.load_model("rendezvous_demo")


@pytest.fixture(scope="module")
def off():
    """As its file would state it."""
    changes = {"gyro.scale_sigma": 0.02, "gyro.misalignment_sigma_mrad": 30.0, "gyro.role": "considered"}
    return relnav.load_model("rendezvous_demo", changes=changes)


def test_keys_of_the_file(right, off):
    assert (right.gyro.scale_sigma, right.gyro.misalignment_sigma_rad, right.gyro.is_off) == (0.0, 0.0, False)
    assert (off.gyro.scale_sigma, off.gyro.misalignment_sigma_rad) == (0.02, pytest.approx(0.03))
    assert off.gyro.is_off
    assert off.gyro.role == "considered"
    with pytest.raises(ValueError, match=r"gyro\.scale_sigma"):
        relnav.load_model("rendezvous_demo", changes={"gyro.scale_sigma": -0.1})


def test_samples_differ_by_the_drawn_errors(right, off):
    """The same numbers for all else of the gyro: what is added is the matrix times the true rate."""
    a, b = simulate_rendezvous(right, SHORT, seed=5), simulate_rendezvous(off, SHORT, seed=5)
    matrix = np.diag(b.lasting["gyro.scale"])
    matrix[~np.eye(3, dtype=bool)] = b.lasting["gyro.misalignment"]
    body = a.truth.dcm_chaser_from_inertial(np.append(a.samples[:, 0], a.samples[-1, 0] + 1.0 / right.gyro.rate_hz))
    skew = 0.5 * (body[:-1] @ body[1:].transpose(0, 2, 1) - body[1:] @ body[:-1].transpose(0, 2, 1))
    rate = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1) * right.gyro.rate_hz
    np.testing.assert_allclose(b.samples[:, 1:] - a.samples[:, 1:], rate @ matrix.T, atol=1e-9)
    assert np.abs(rate @ matrix.T).max() > 1e-6
    assert "gyro.scale" not in a.lasting


def test_a_run_of_a_campaign_draws_them_last(right, off):
    """What is drawn of all else is what it was; each number has a name, and may be given."""
    scenario = dataclasses.replace(default_scenario(right), approach=SHORT)
    assert not {"gyro_scale", "gyro_misalignment"} & drawn_once(right, scenario).keys()
    asked = drawn_once(off, scenario)
    assert (asked["gyro_scale"], asked["gyro_misalignment"]) == (3, 6)
    assert [own for name in ("gyro_scale", "gyro_misalignment") for own in number_names(name, asked[name])] == NAMES
    (_, before), (run, drawn) = (fly_vehicle_run(vehicle, scenario, 3, 1) for vehicle in (right, off))
    assert {name: drawn[name] for name in before} == before
    assert sorted(drawn.keys() - before.keys()) == sorted(NAMES)
    np.testing.assert_allclose(run.lasting["gyro.scale"], 0.02 * np.array([drawn[name] for name in NAMES[:3]]))
    given, _ = fly_vehicle_run(off, scenario, 3, 1, {"gyro_misalignment_yx": 2.0})
    expected = run.lasting["gyro.misalignment"].copy()
    expected[2] = 0.06
    np.testing.assert_allclose(given.lasting["gyro.misalignment"], expected)
    assert OfRun(3, 1, ["camera"]).once("gyro_scale", 3).std() > 0.0


def test_a_scenario_states_them_for_the_truth_alone(right, tmp_path):
    """Then the filter has no such states, and its errors are those of the others."""
    path = tmp_path / "scenario.toml"
    path.write_text(
        "[approach]\nstart_m = 5.6\nfinal_m = 5.3\n[gyro]\nscale_sigma = 0.1\nmisalignment_sigma_mrad = 50\n"
    )
    scenario = relnav.load_scenario(path, model=right)
    assert scenario.gyro.misalignment_sigma_rad == pytest.approx(0.05)
    run, _ = fly_vehicle_run(right, scenario, 3, 1)
    assert np.abs(run.lasting["gyro.scale"]).max() > 0.01
    nav = VehicleNavigator(right, position_m=run.truth.motion(np.zeros(1))[0, :3], monitor=False)
    for seen in run.observations[:200]:
        nav.observe(seen.sensor, seen.t_s, seen.value)
    assert checkpoint(run, nav.state()).error.shape == nav.state().values.shape


def test_the_budget_has_a_source_where_they_are_stated(right, off):
    said = {source.name: source for source in sources(off)}
    assert "gyro scale and misalignment" not in {source.name for source in sources(right)}
    assert said["gyro scale and misalignment"].stated == "2e+04 ppm, 30 mrad"
    halved = said["gyro scale and misalignment"].halved.gyro
    assert (halved.scale_sigma, halved.misalignment_sigma_rad) == (0.01, pytest.approx(0.015))


def test_the_filter_s_error_counts_them(off):
    """NEES of the nine errors of a flight of which all is as the file states is that of nine numbers."""
    run = simulate_rendezvous(off, SHORT, seed=7)
    nav = VehicleNavigator(off, position_m=run.truth.motion(np.zeros(1))[0, :3], monitor=False)
    for seen in sorted(run.observations, key=lambda one: one.t_s):
        nav.observe(seen.sensor, seen.t_s, seen.value)
    found, place = checkpoint(run, nav.state()), nav.layout.by_name
    for name, sigma in (("gyro.scale", 0.02), ("gyro.misalignment", 0.03)):
        np.testing.assert_array_equal(found.error[place[name]], run.lasting[name])  # considered: never corrected
        np.testing.assert_allclose(np.diagonal(found.covariance)[place[name]], sigma**2)
