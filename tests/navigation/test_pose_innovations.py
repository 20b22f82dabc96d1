"""Innovations of markers, found again from the track: against the second filter's rows and the filter's own NIS."""

import numpy as np
import pytest

import relnav
from relnav.navigation.pose_innovations import MarkerInnovations
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.reference.bank import carried
from relnav.navigation.reference.marker_rows import MarkerOptics, PoseTrack
from relnav.navigation.status import REJECTED, UPDATED
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

GLINT, HIDDEN = 60, 80
"""Images: one spot of the first is elsewhere, the second shows two markers."""


def flown(changes):
    mission = relnav.load_model("three_marker_vision", changes)
    flight = simulate_flight(mission, Approach(duration_s=12.0), seed=4)
    spots = flight.spots_px.copy()
    spots[GLINT, 1] += 30.0
    spots[HIDDEN, 2] = np.nan
    return mission, filter_marker_epochs(mission, flight.t_s, spots, acceleration_m_s2=flight.acceleration_m_s2)


@pytest.fixture(scope="module")
def run():
    return flown({"chaser.attitude_sigma_deg": 0.05})


def second_opinion(mission, solution, k):
    """Residuals and S of an image by the reference's equations, from the epoch before."""
    before, epoch = solution.epochs[k - 1], solution.epochs[k]
    felt = before["by_chaser"].copy()
    track = PoseTrack(before["motion"], before["dcm"], before["rate"], solution.covariance[k - 1] - felt.T @ felt, felt)
    dt = float(epoch["t"] - before["t"])
    there = carried(mission, track, float(before["t"]), dt, epoch["acceleration"], epoch["delta_v"])
    noise = mission.chaser.attitude_noise_rad
    image = MarkerOptics(mission).observe(there, epoch["chaser"], solution.spots_px[k], np.zeros((0, 2, 2)), noise)
    return image, image.rows @ there.covariance @ image.rows.T + image.noise


def test_residuals_sigmas_and_nis(run):
    mission, solution = run
    innovation, sigma = MarkerInnovations(mission).of(solution)
    assert np.isfinite(innovation).any(axis=(1, 2)).sum() > 100
    for k in [3, 20, GLINT, HIDDEN, 110]:
        image, s = second_opinion(mission, solution, k)
        np.testing.assert_allclose(innovation[k, image.which].ravel(), image.residual, atol=1e-4)
        np.testing.assert_allclose(sigma[k, image.which].ravel(), np.sqrt(np.diagonal(s)), rtol=1e-3)
        assert image.residual @ np.linalg.solve(s, image.residual) == pytest.approx(solution.nis[k], rel=1e-6)
    assert np.abs(innovation[GLINT, 1]).min() > 25.0
    assert np.isnan(innovation[HIDDEN, 2]).all()


def test_by_parts_and_where_nothing_can_be_told(run):
    mission, solution = run
    assert np.isin(solution.status[10:], (UPDATED, REJECTED)).mean() > 0.9
    whole, parts = MarkerInnovations(mission), MarkerInnovations(mission)
    together = np.concatenate([np.stack(parts.of(solution.part(a, a + 40))) for a in (0, 40, 80)], axis=1)
    np.testing.assert_array_equal(np.stack(whole.of(solution)), together)
    waiting = solution.hypotheses == 0
    assert np.isnan(together[:, waiting]).all()
    unseen = PoseSolution(mission, solution.epochs)
    assert np.isnan(MarkerInnovations(mission).of(unseen)[0]).all()


def test_considered_tolerances_have_no_sigma():
    mission, solution = flown({"tolerances.considered": True})
    found = MarkerInnovations(mission)
    innovation, sigma = found.of(solution)
    assert not found.tells_sigma
    assert np.isfinite(innovation).any()
    assert np.isnan(sigma).all()
