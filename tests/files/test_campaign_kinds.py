"""Campaigns of markers and of vehicles, and sensitivities: against the public filters, the design and closed forms."""

import dataclasses
import json
import math
from concurrent.futures import BrokenExecutor

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("pyarrow", reason="campaigns are Parquet files (extra parquet)")

import relnav
from relnav.accuracy.campaign_plan import Plan, fly_batch
from relnav.accuracy.rendezvous import true_port
from relnav.accuracy.run_figures import RunStatus
from relnav.accuracy.sensitivities import Sensitivities, sum_up
from relnav.accuracy.sensitivity_design import NOISE, Design
from relnav.files.campaign_page import read_campaign
from relnav.files.sensitivities import sensitivities
from relnav.simulation.dispersed_vehicle import fly_vehicle_run
from relnav.simulation.dispersions import Images, Results, Scenario, Spread
from relnav.simulation.trajectory import Approach
from relnav.simulation.vehicle_dispersions import VehicleScenario
from relnav.vehicle.navigator import VehicleNavigator

SHORT = Scenario(
    Approach(duration_s=30.0, rate_hz=2.0), Spread((0.2, 0.1, 0.1)), results=Results((9.0, 9.5, 10.0), 5.0)
)


@pytest.fixture(scope="module")
def markers():
    return relnav.load_model("three_marker_vision")


@pytest.fixture(scope="module")
def vehicle():
    """Two sensors, and a gyro of ten samples a second: a flight takes a tenth of the time."""
    whole = relnav.load_model("rendezvous_demo")
    sensor = {name: whole.sensor[name] for name in ("psd", "star")}
    slow = {name: dataclasses.replace(mounted, rate_hz=2.0) for name, mounted in sensor.items()}
    return dataclasses.replace(whole, gyro=dataclasses.replace(whole.gyro, rate_hz=10.0), sensor=slow)


@pytest.fixture(scope="module")
def closing(vehicle):
    changes = {"approach.start_m": 5.6, "approach.final_m": 5.2, "results.settling_s": 2.0}
    return relnav.load_scenario(None, changes, model=vehicle)


def row_of(model, scenario, method, run, runs=8):
    plan = Plan(model, scenario, method, 3, runs)
    batch = fly_batch(plan, range(run, run + 1))
    assert batch.reasons == ("",)
    return dict(zip(plan.columns, batch.figures[0], strict=True))


def test_a_run_of_markers(markers):
    """Against the public filter and the flight's truth; the range by hand, from where both ports are."""
    row, flight = row_of(markers, SHORT, "pose", 2), relnav.simulate(markers, SHORT, 3, 2)
    from relnav.navigation.pose_log import filter_marker_epochs

    track = filter_marker_epochs(markers, flight.t_s, flight.spots_px, acceleration_m_s2=flight.acceleration_m_s2)
    target, chaser = flight.dcm_lvlh_from_target[-1], flight.true_dcm_chaser_from_lvlh[-1]
    own, other = np.array(markers.chaser.port_position_m), np.array(markers.target.port_position_m)
    place = target.T @ (flight.motion[-1, :3] + chaser.T @ own) - other
    error = place - track.port_m[-1]
    for k, axis in enumerate("xyz"):
        assert row[f"final_error_port_{axis}_m"] == pytest.approx(error[k], abs=1e-12)
        sigma = math.sqrt(track.docking_covariance[-1, k, k])
        assert row[f"final_sigma_port_{axis}_m"] == pytest.approx(sigma, rel=1e-12)
        assert abs(error[k]) < 6.0 * sigma
    assert row["final_range_m"] == pytest.approx(np.linalg.norm(place), rel=1e-12)
    assert 0.0 < row["final_nees"] < 60.0
    assert row["drawn_start_x"] != 0.0


def test_a_lost_marker_leaves_the_noise_of_the_others(markers):
    lost = dataclasses.replace(SHORT, images=Images(lost_beacon="b", lost_from_s=10.0))
    both = [relnav.simulate(markers, scenario, 3, 1).spots_px for scenario in (SHORT, lost)]
    assert np.isnan(both[1][25:, 1]).all()
    assert np.array_equal(both[0][:, [0, 2]], both[1][:, [0, 2]], equal_nan=True)


def test_an_approach_of_a_vehicle(vehicle, closing):
    """Against `VehicleNavigator` by hand, at the end."""
    row, flown = row_of(vehicle, closing, "fused", 1), fly_vehicle_run(vehicle, closing, 3, 1)[0]
    near = dataclasses.replace(vehicle.hand_over, port_distance_m=(5.6, 0.0, 0.0))
    nav = VehicleNavigator(dataclasses.replace(vehicle, hand_over=near))
    end = flown.truth.end_s - 0.05
    for seen in flown.observations:
        if seen.t_s <= end:
            nav.observe(seen.sensor, seen.t_s, seen.value)
    port, truth = nav.state(end).port, true_port(flown, end)[0]
    assert row["final_error_port_x_m"] == pytest.approx(truth[0] - port.position_m[0], abs=1e-9)
    assert row["final_sigma_rate_y_deg_s"] == pytest.approx(math.degrees(port.sigma[10]), rel=1e-6)
    assert 0.0 < row["final_nees"] < 60.0
    assert math.isnan(row["alarms"]), "nothing watches where nothing is at fault, unless asked to"


def test_a_start_that_does_not_know_the_targets_attitude(vehicle):
    """Ten images at 2 Hz have to agree: a run that ends before is ambiguous, another one starts then."""
    start = dataclasses.replace(vehicle.hand_over, target_attitude_sigma_rad=math.pi)
    seeking = dataclasses.replace(vehicle, hand_over=start)
    changes = {"approach.start_m": 5.6, "spread.start_sigma_m": 0.05, "spread.target_attitude_sigma_deg": 0.5}
    found = []
    for final_m in (5.5, 5.0):
        ends = relnav.load_scenario(None, changes | {"approach.final_m": final_m}, model=seeking)
        plan = Plan(seeking, ends, "fused", 3, 8)
        batch = fly_batch(plan, range(1, 2))
        found.append((batch.status[0], batch.figures[0, plan.columns.index("started_s")]))
    (early, never), (late, started_s) = found
    assert (early, late) == (RunStatus.AMBIGUOUS, RunStatus.OK)
    assert math.isnan(never)
    assert 4.5 < started_s < 7.0


def test_alarms_of_a_vehicle(vehicle):
    changes = {"approach.start_m": 5.6, "approach.final_m": 5.2, "results.monitor": True}
    watched = row_of(vehicle, relnav.load_scenario(None, changes, model=vehicle), "fused", 2)
    assert watched["alarms"] == 0.0
    changes |= {"fault.sensor": "psd", "fault.kind": "late", "fault.from_s": 0.0}
    late = row_of(vehicle, relnav.load_scenario(None, changes, model=vehicle), "fused", 2)
    assert late["alarms"] == 0.0
    assert late["epochs"] > watched["epochs"], "done again where something came late"
    assert late["final_error_port_x_m"] == watched["final_error_port_x_m"], "the same events in the end"


def test_a_vehicle_on_two_processes_and_on_one(vehicle, closing, tmp_path):
    folders = [tmp_path / name for name in ("one", "two")]
    for folder, workers in zip(folders, (1, 2), strict=True):
        relnav.campaign(vehicle, 5, 3, dispersions=closing, out=folder, workers=workers)
    names = sorted(path.relative_to(folders[0]) for path in folders[0].rglob("*") if path.is_file())
    assert len(names) == 6
    for name in names:
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name


def test_a_process_that_dies_is_told(vehicle, closing, monkeypatch):
    def broken(*_):
        raise BrokenExecutor

    monkeypatch.setattr("relnav.files.workers._pooled", broken)
    with pytest.raises(relnav.InputError, match="a process of the campaign died; call it again to go on"):
        relnav.campaign(vehicle, 8, 3, dispersions=closing, workers=2)


def test_a_sensor_at_fault_leaves_the_rest(vehicle, closing):
    changes = {"approach.start_m": 5.6, "approach.final_m": 5.2, "fault.sensor": "star", "fault.from_s": 3.0}
    faulty = relnav.load_scenario(None, changes, model=vehicle)
    both = [fly_vehicle_run(vehicle, scenario, 3, 1)[0].observations for scenario in (closing, faulty)]
    assert max(seen.t_s for seen in both[1] if seen.sensor == "star") < 3.0
    rest = [[(seen.t_s, seen.value) for seen in some if seen.sensor != "star"] for some in both]
    assert len(rest[0]) == len(rest[1])
    for (t, value), (own_t, own) in zip(*rest, strict=True):
        assert t == own_t
        assert np.array_equal(value, own, equal_nan=True)


@pytest.mark.parametrize(("told", "lasts_s"), [({}, 60.0), ({"fault.for_s": 20.0}, 20.0)])
def test_a_ramp_grows_to_its_full_size(vehicle, told, lasts_s):
    """Within a minute if the scenario does not say how fast; five sigmas of noise and mounting, from quaternions."""
    flight = {"approach.start_m": 5.6, "approach.final_m": 3.4}
    ramp = {"fault.sensor": "star", "fault.kind": "ramp", "fault.from_s": 3.0} | told
    seen = []
    for changes in (flight, flight | ramp):
        scenario = relnav.load_scenario(None, changes, model=vehicle)
        seen.append([one for one in fly_vehicle_run(vehicle, scenario, 3, 1)[0].observations if one.sensor == "star"])
    usual, faulty = (Rotation.from_quat([one.value for one in some]) for some in seen)
    off = (usual.inv() * faulty).magnitude()
    t_s = np.array([one.t_s for one in seen[0]])
    assert t_s[-1] > 65.0
    star = vehicle.sensor["star"]
    full = 5.0 * math.hypot(max(star.noise_rad), star.mount_sigma_rad)
    np.testing.assert_allclose(off, full * np.clip((t_s - 3.0) / lasts_s, 0.0, 1.0), atol=1e-7 * full + 1e-12)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fault.sensor": "radar"}, "fault.sensor is one of none, gyro, psd, star; got 'radar'"),
        ({"fault.sensor": "star", "fault.kind": "glint"}, "fault.kind glint is for a sensor that sees lights; star"),
    ],
)
def test_what_a_vehicle_has_not_got(vehicle, changes, said):
    with pytest.raises(ValueError, match=said):
        relnav.campaign(vehicle, 4, dispersions=relnav.load_scenario(None, changes, model=vehicle))


def test_kinds_are_not_mixed_up(markers, vehicle):
    psd = relnav.load_model("three_beacon_psd")
    turning = Scenario(spread=Spread(target_rate_sigma_rad_s=0.1))
    for model, scenario, said in (
        (vehicle, SHORT, "a vehicle's scenario is expected"),
        (markers, VehicleScenario(), "a scenario is expected"),
        (psd, VehicleScenario(), "a scenario is expected"),
        (psd, turning, "beacons do not see the target turn"),
        (markers, Scenario(images=Images(by_received_power=True)), "by_received_power is for beacons"),
    ):
        with pytest.raises(ValueError, match=said):
            relnav.campaign(model, 4, dispersions=scenario)


def test_the_indices_of_a_sum():
    """Y = 3 a + 4 b + noise x 0: first and total indices are 9/25 and 16/25; moved alone 3 and 4; c has none."""
    design = Design({"a": ("a",), "b": ("b",), "c": ("c",)}, 5, 1024)
    values = [design.of(run) for run in range(design.runs)]
    y = np.array([3.0 * given["a"] + 4.0 * given["b"] for _, given in values])
    found = sum_up(design, ("y",), lambda _: {"final_error_y": y}, 5)
    told = {share.cause: share for share in found.shares}
    for cause, index in (("a", 9 / 25), ("b", 16 / 25), ("c", 0.0), (NOISE, 0.0)):
        assert told[cause].first == pytest.approx(index, abs=0.12)
        assert told[cause].total == pytest.approx(index, abs=0.06)
        assert told[cause].first_low <= told[cause].first <= told[cause].first_high
    assert {shift.number: shift.shift for shift in found.shifts} == pytest.approx({"a": 3.0, "b": 4.0, "c": 0.0})
    y[1024 * 2 + 5] = math.nan  # a flight of A with a taken from B
    found = sum_up(design, ("y",), lambda _: {"final_error_y": y}, 5)
    without = {share.cause: share for share in found.shares}
    assert {cause: share.used for cause, share in without.items()} == {"a": 512, "b": 1024, "c": 1024, NOISE: 1024}
    assert found.lines()[0].startswith("512 to 1024 of 1024 base runs used")
    assert without["a"].first == pytest.approx(9 / 25, abs=0.15)
    assert without["b"].first == pytest.approx(told["b"].first, abs=1e-12)
    y[design.mixed : design.mixed + 2 * design.repeats] = math.nan  # a moved alone
    rows = sum_up(design, ("y",), lambda _: {"final_error_y": y}, 5).lines()
    assert next(row for row in rows if row.startswith("  a    ")).endswith("]   -")
    y[17] = math.nan  # a flight of A: no cause has it
    assert {share.used for share in sum_up(design, ("y",), lambda _: {"final_error_y": y}, 5).shares} == {512}


def test_the_noise_is_a_cause_of_its_own():
    """Runs that differ in the noise alone get the numbers of A and the number of B's run."""
    design = Design({"a": ("a_x", "a_y")}, 5, 8)
    run, given = design.of(3)
    other, same = design.of(8 * (2 + design.causes.index(NOISE)) + 3)
    assert (run, other) == (6, 7)
    assert given == same
    mixed = design.of(8 * 2 + 3)
    assert mixed == (6, design.of(8 + 3)[1])
    with pytest.raises(ValueError, match="a power of two"):
        sensitivities("three_beacon_psd", 12, out="nowhere")


def test_sensitivities_of_beacons(tmp_path):
    """A focal length 1 % off moves the range by 1 % and nothing else does; taken up again it flies nothing."""
    changes = {"approach.duration_s": 20.0, "approach.rate_hz": 2.0, "as_built.focal_length_relative_sigma": 0.01}
    scenario, told = relnav.load_scenario(None, changes), []
    for _ in range(2):
        found = sensitivities(
            "three_beacon_psd", 8, 2, out=tmp_path, dispersions=scenario, method="spots", progress=told.append
        )
    assert sum(told) == 8 * (2 + 17) + 2 * 4 * 16
    assert found.of("x_m")[0].cause == "focal_length"
    moved = next(one for one in found.shifts if (one.component, one.number) == ("x_m", "focal_length"))
    assert abs(moved.shift) == pytest.approx(0.01 * 9.4, rel=0.1)
    assert json.loads((tmp_path / "sensitivities.json").read_text())["used"] == 8
    assert (tmp_path / "sensitivities.png").stat().st_size > 10_000
    assert any("focal_length" in line for line in found.lines())
    with pytest.raises(relnav.InputError, match="holds sensitivities, whose table and picture are there; no campaign"):
        read_campaign(tmp_path)


def test_too_few_base_runs_give_no_indices_and_say_what_to_do():
    """Flights that end without a state, as markers seen from far often do."""
    lines = Sensitivities(64, 4, {"port_x_m": math.nan}, (), ()).lines()
    assert lines[0].startswith("4 of 64 base runs used")
    assert "the three flights that tell of it end with a state" in lines[1]
    assert "no indices from fewer than 8" in lines[3]
    assert len(lines) == 4
