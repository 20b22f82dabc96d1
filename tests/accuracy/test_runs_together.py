"""Runs that are flown, filtered and scored together: each to the bit as it is alone, whatever happens in one."""

import dataclasses
import math

import numpy as np
import pytest

import relnav
from relnav.accuracy import campaign_plan, run_score
from relnav.accuracy.campaign_plan import Plan, fly_batch, prepare
from relnav.accuracy.run_score import BEACONS, RunScorer, RunStatus
from relnav.codegen.kernel import is_compiled
from relnav.codegen.together import RUNS, new_lanes
from relnav.navigation.log import LogFilter
from relnav.navigation.logs_together import LogsTogether
from relnav.navigation.status import PARTIAL, REJECTED
from relnav.sensors.three_beacon.calibration import Calibration
from relnav.simulation.dispersed import fly_run, fly_runs
from relnav.simulation.dispersions import AsBuilt, Images, Results, Scenario, Spread, Thrust
from relnav.simulation.trajectory import Approach

pytestmark = pytest.mark.skipif(not is_compiled(), reason="runs are flown together in compiled code alone")

APPROACH = Approach(duration_s=40.0, assumed_noise=True, assumed_start=True)
SPREAD = Spread((0.5, 0.1, 0.1), (0.005, 0.005, 0.005), 0.05)
BUILT = AsBuilt(focal_length_relative_sigma=1e-3)
FAULTS = Images(dropout=0.02, outliers=0.01)
SCENARIOS = {
    "plain": Scenario(Approach(duration_s=40.0)),
    "faults": Scenario(APPROACH, SPREAD, Thrust(0.01, 0.01), FAULTS),
    "lost": Scenario(APPROACH, SPREAD, images=Images(lost_beacon="b", lost_probability=0.5, lost_from_s=9.0)),
    "near the edge": Scenario(dataclasses.replace(APPROACH, start_m=(5.0, 1.2, -0.9), final_range_m=3.5)),
    "oblate": Scenario(dataclasses.replace(APPROACH, j2=True, air_density_kg_m3=1e-11), SPREAD),
    "as built": Scenario(APPROACH, SPREAD, images=Images(dropout=0.02), as_built=BUILT),
    "by power": Scenario(APPROACH, SPREAD, images=Images(dropout=0.02, by_received_power=True)),
}


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


def alone(model, method, log):
    """Epochs of a log that is filtered alone, and the filter."""
    one = LogFilter(model, method)
    epochs, control = one.room(len(log.t_s), smooth=False), np.zeros((len(log.t_s), 6))
    control[:, :3] = log.acceleration_m_s2
    one.forward(log.t_s, log.spots_m, control, np.empty((0, 4)), epochs, log.sigma_m)
    return epochs, one


def filtered(model, method, logs):
    together = LogsTogether(model, method, len(logs[0].t_s))
    together.take(*side_by_side(logs))
    together.run()
    return together


def side_by_side(logs):
    """Logs as they are taken together."""
    told = [np.stack([getattr(log, of) for log in logs], -1) for of in ("spots_m", "acceleration_m_s2")]
    sigma = None if logs[0].sigma_m is None else np.stack([log.sigma_m for log in logs], -1)
    lanes = [None if of is None else new_lanes(*of.shape[:-1]) for of in (*told, sigma)]
    for made, of in zip(lanes, (*told, sigma), strict=True):
        if of is not None:
            made[:] = of
    return logs[0].t_s, *lanes


def assert_same(together, model, method, logs):
    for lane, log in enumerate(logs):
        epochs, one = alone(model, method, log)
        for part in dataclasses.fields(epochs):
            expected, got = getattr(epochs, part.name), getattr(together.epochs, part.name)[..., lane]
            np.testing.assert_array_equal(got, expected, err_msg=f"{part.name} of run {lane}")
        assert together.restarts[lane] == one.restarts


@pytest.mark.parametrize("method", ["spots", "fix"])
@pytest.mark.parametrize("name", SCENARIOS)
def test_logs_are_filtered_to_the_bits_of_each_alone(model, name, method):
    logs = [fly_run(model, SCENARIOS[name], 5, run).log for run in range(RUNS)]
    together = filtered(model, method, logs)
    assert_same(together, model, method, logs)
    steps = RUNS * len(logs[0].t_s)
    assert together.alone < (0.02 if name == "plain" else 0.7) * steps
    if name == "faults":
        status = together.epochs.codes[:, 1]
        assert np.sum(status == PARTIAL if method == "spots" else status == REJECTED) > 5
        assert together.alone > 0.01 * steps


def test_with_what_a_calibration_leaves(model):
    left = Calibration(0, (0.0, 0.0), (3e-3, 3e-3), (0.0,), (0.0,), 3e-6, 0.0, 225, 1e-5)
    told = dataclasses.replace(model, calibration=left)
    logs = [fly_run(told, SCENARIOS["faults"], 6, run).log for run in range(RUNS)]
    assert_same(filtered(told, "spots", logs), told, "spots", logs)


def test_a_sigma_that_is_left_out_stays_what_it_was(model):
    """Of a run that is stepped alone as well: its beacons' last sigmas go with it."""
    rng, logs = np.random.default_rng(1), []
    for run in range(RUNS):
        log = fly_run(model, SCENARIOS["by power"], 5, run).log
        gone = rng.random(len(log.t_s)) < 0.5
        told = np.where(gone[:, None, None], np.nan, log.sigma_m * rng.uniform(0.5, 2.0, log.sigma_m.shape))
        logs.append(dataclasses.replace(log, sigma_m=told))
    for method in ("spots", "fix"):
        assert_same(filtered(model, method, logs), model, method, logs)


def test_memory_is_used_again_and_nothing_is_left_in_it(model):
    logs = [[fly_run(model, SCENARIOS["faults"], 5, run + first).log for run in range(RUNS)] for first in (0, RUNS)]
    together = filtered(model, "spots", logs[0])
    together.take(*side_by_side(logs[1]))
    together.run()
    assert_same(together, model, "spots", logs[1])


@pytest.mark.parametrize("name", SCENARIOS)
def test_flights_are_flown_to_the_bits_of_each_alone(model, name):
    flights = fly_runs(model, SCENARIOS[name], 5, range(RUNS), [None] * RUNS)
    for run in range(RUNS):
        expected = fly_run(model, SCENARIOS[name], 5, run)
        np.testing.assert_array_equal(flights.t_s, expected.log.t_s)
        for field in ("truth", "acceleration_m_s2", "spots_m", "sigma_m"):
            got, alone = getattr(flights, field), getattr(expected.log, field)
            assert (got is None) == (alone is None)
            if got is not None:
                np.testing.assert_array_equal(got[..., run], alone, err_msg=field)
        assert flights.drawn[run] == expected.drawn


@pytest.mark.parametrize("design", [0, 5])
@pytest.mark.parametrize("method", ["spots", "fix"])
def test_a_batch_has_the_same_figures_either_way(model, method, design):
    """Twelve runs: eight together, and four that are left over."""
    plan = Plan(
        model, dataclasses.replace(SCENARIOS["faults"], results=Results(settling_s=5.0)), method, 3, 100, design
    )
    together, apart = (fly_batch(plan, range(4, 16), together=way) for way in (True, False))
    np.testing.assert_array_equal(together.figures, apart.figures)
    np.testing.assert_array_equal(together.status, apart.status)
    assert together.reasons == apart.reasons


def test_a_run_that_fails_is_named_and_the_others_are_as_alone(model, monkeypatch):
    def failing(self, number, given=None, flown=RunScorer.run):
        if number == 3:
            raise RuntimeError("no such run")
        return flown(self, number, given)

    plan = Plan(model, SCENARIOS["plain"], "fix", 3, 8)
    expected = fly_batch(plan, range(8), together=False)
    monkeypatch.setattr(RunScorer, "run", failing)
    monkeypatch.setattr(RunScorer, "runs", lambda *_: 1 / 0)
    batch = fly_batch(plan, range(8), together=True)
    assert batch.reasons == ("", "", "", "RuntimeError: no such run", "", "", "", "")
    assert batch.status[3] == RunStatus.FAILED
    assert np.isnan(batch.figures[3]).all()
    others = np.arange(8) != 3
    np.testing.assert_array_equal(batch.figures[others], expected.figures[others])


def test_a_flight_that_leaves_all_numbers_is_named(model):
    fast = Scenario(dataclasses.replace(APPROACH, air_density_kg_m3=1e300, duration_s=5.0))
    batch = fly_batch(Plan(model, fast, "fix", 3, 8), range(8), together=True)
    assert set(batch.status) == {RunStatus.FAILED}
    assert all("flew out of all numbers" in reason for reason in batch.reasons)


def test_what_has_to_be_compiled_first_is_compiled_where_it_is_worth_it(model, monkeypatch):
    """Nearly a minute of one core is saved by a campaign of 5e7 epochs; a short one is flown one by one."""

    def plan(runs):
        return Plan(model, SCENARIOS["plain"], "fix", 3, runs)

    epochs = 400
    for at_hand, runs, expected in (
        (False, int(campaign_plan.WORTH_COMPILING / epochs) - 1, False),
        (False, math.ceil(campaign_plan.WORTH_COMPILING / epochs), True),
        (True, 8, True),
    ):
        kind = dataclasses.replace(BEACONS, together_at_hand=lambda at_hand=at_hand: at_hand)
        monkeypatch.setattr(campaign_plan, "kind_of", lambda _model, kind=kind: kind)
        assert plan(runs).together is expected
    hours = Scenario(dataclasses.replace(APPROACH, duration_s=campaign_plan.LONGEST_TOGETHER / 10.0 + 1.0))
    assert not Plan(model, hours, "fix", 3, 8).together
    monkeypatch.setattr(campaign_plan, "is_compiled", lambda: False)
    assert plan(8).together is False


def test_a_driver_compiles_what_its_workers_will_fly(model, monkeypatch):
    flown = []
    monkeypatch.setattr(campaign_plan, "fly_batch", lambda _plan, runs: flown.append(len(runs)))
    for at_hand, expected in ((True, RUNS), (False, 1)):
        kind = dataclasses.replace(BEACONS, together_at_hand=lambda at_hand=at_hand: at_hand)
        monkeypatch.setattr(campaign_plan, "kind_of", lambda _model, kind=kind: kind)
        prepare(Plan(model, SCENARIOS["plain"], "fix", 3, 8))
        assert flown.pop() == expected


def test_figures_that_are_not_of_one_mind_are_no_figures(model, monkeypatch):
    monkeypatch.setattr(run_score, "_score_together", lambda *_: False)
    scorer = RunScorer(model, SCENARIOS["plain"], "fix", 3)
    with pytest.raises(ArithmeticError, match="figures of runs were decided by their numbers"):
        scorer.runs(range(RUNS), [None] * RUNS)
