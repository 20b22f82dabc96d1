"""NIS where errors last: one run has no verdict, and over runs the interval is that of how much they differ."""

import numpy as np
import pytest
from scipy.stats import binom, chi2

import relnav
from relnav.estimation.consistency import consistency_of_runs, consistency_of_sum
from relnav.navigation.lasting_words import marker_words
from relnav.navigation.pose_innovations import MarkerInnovations
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach

RUNS, CAMPAIGNS, EPOCHS = 30, 400, 200


def sums(rng, lasting):
    """NIS (campaigns, runs) of scalar innovations with unit variance, of which a part is the same in all of a run."""
    shape = CAMPAIGNS, RUNS, 1
    own = rng.normal(size=(CAMPAIGNS, RUNS, EPOCHS)) * np.sqrt(1.0 - lasting)
    return ((own + rng.normal(size=shape) * np.sqrt(lasting)) ** 2).sum(axis=2)


@pytest.mark.parametrize("lasting", [0.0, 0.1])
def test_the_interval_of_runs_holds_whatever_is_the_same_within_a_run(lasting):
    """Honest campaigns lie outside one of twenty times; with the interval of independent epochs most of them do.

    The bound is binomial at 1e-4, for 8 % instead of 5 %: the mean of 30 squares is not normal, but leans to one side.
    """
    found = sums(np.random.default_rng(8), lasting)
    dof = np.full(RUNS, EPOCHS)
    outside = sum(not consistency_of_runs("NIS", row, dof).consistent for row in found)
    assert outside <= binom.ppf(1.0 - 1e-4, CAMPAIGNS, 0.08)
    if lasting:
        pooled = sum(not consistency_of_sum("NIS", row.sum(), EPOCHS * RUNS).consistent for row in found)
        assert pooled > CAMPAIGNS / 5


def test_a_wrong_covariance_is_told_by_runs():
    found = 1.3 * sums(np.random.default_rng(9), 0.1)
    dof = np.full(RUNS, EPOCHS)
    told = sum(consistency_of_runs("NIS", row, dof).overconfident for row in found)
    assert told > 0.95 * CAMPAIGNS


def test_a_few_runs():
    """Student's distribution: of two runs, t(0.975, 1) = 12.706; runs without an epoch count for nothing."""
    got = consistency_of_runs("NIS", np.array([90.0, np.nan, 220.0, 0.0]), np.array([100, 0, 200, 0]))
    half = 12.7062047362 * np.std([0.9, 1.1], ddof=1) / np.sqrt(2.0)
    assert (got.ratio, got.lower, got.upper) == pytest.approx((1.0, 1.0 - half, 1.0 + half), rel=1e-9)
    assert got.dof == 300
    one = consistency_of_runs("NIS", np.array([90.0]), np.array([100]))
    assert str(one) == "NIS per degree of freedom 0.900, no interval: one run does not tell how much runs differ"
    assert (one.consistent, one.overconfident) == (False, False)
    assert str(consistency_of_runs("NIS", np.array([np.nan]), np.array([0]))) == "NIS: no data"


def flown(model, seed, off_sigma):
    """Spots of a beacon approach, the camera's attitude off by so many sigma of what the model states."""
    log = simulate(model, Approach(duration_s=20.0, assumed_noise=True), seed=seed)
    turn = np.array([0.0, off_sigma * model.attitude.sigma_rad, 0.0])
    spots = log.spots_m + model.sensor.focal_length_m * np.array([turn[1], -turn[0]])
    return relnav.filter_epochs(model, log.t_s, spots, acceleration_m_s2=log.acceleration_m_s2, method="spots")


def test_one_log_with_lasting_errors_has_no_verdict():
    """Attitude errors within two sigma move NIS far beyond its interval of independent epochs, either way."""
    model = relnav.load_model("three_beacon_psd")
    solutions = [flown(model, seed, off) for seed, off in ((1, 0.0), (2, 2.0))]
    ratios = []
    for solution in solutions:
        told = solution.nis_consistency()
        limits = chi2.interval(0.95, told.dof)
        assert not limits[0] < told.ratio * told.dof < limits[1]
        assert str(told).endswith("no interval: lasting errors are included, the same in every epoch")
        assert (told.consistent, told.overconfident) == (False, False)
        ratios.append(told.ratio)
    assert ratios[0] < 1.0 < ratios[1]
    exact = relnav.load_model("three_beacon_psd", {"attitude.sigma_deg": 0.0})
    assert flown(exact, 1, 0.0).nis_consistency().consistent


@pytest.mark.parametrize("considered", [False, True])
def test_markers_have_none_with_tolerances_alone(considered):
    """The chaser's attitude turns target and chaser alike, and shows in no image: it leaves the verdict as it is."""
    mission = relnav.load_model("three_marker_vision", {"tolerances.considered": considered})
    flight = simulate_flight(mission, Approach(duration_s=10.0, rate_hz=4.0), seed=1)
    told = relnav.filter_marker_epochs(mission, flight.t_s, flight.spots_px).nis_consistency()
    assert bool(told.withheld) is considered
    assert marker_words(mission) == ({"considered": "focal length, mounting, markers"} if considered else {})
    assert np.isnan(told.lower) == considered


def test_markers_have_none_with_an_inertia_that_is_off():
    """Its error lasts as well, and shows in every image of a target that turns."""
    sigma = [[60.0, 0.0, 0.0], [0.0, 90.0, 0.0], [0.0, 0.0, 90.0]]
    mission = relnav.load_model("three_marker_vision", {"target.inertia_sigma_kg_m2": sigma})
    flight = simulate_flight(mission, Approach(duration_s=10.0, rate_hz=4.0), seed=1)
    solution = relnav.filter_marker_epochs(mission, flight.t_s, flight.spots_px)
    assert solution.nis_consistency().withheld
    assert marker_words(mission) == {"considered": "inertia of the target"}
    innovation, told = MarkerInnovations(mission).of(solution)
    assert np.isfinite(innovation).any()
    assert not np.isfinite(told).any()
