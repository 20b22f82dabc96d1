"""A smoothed log: better than filtered, honest, and cut where the track is cut."""

import numpy as np
import pytest

import relnav
from relnav.navigation.status import EpochStatus
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


def both(model, log, method):
    return [
        relnav.filter_epochs(
            model, log.t_s, log.spots_m, acceleration_m_s2=log.acceleration_m_s2, method=method, smooth=smooth
        )
        for smooth in (False, True)
    ]


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_smoothed_is_no_worse_anywhere(model, method):
    """Over 20 faulted flights, component by component, in pieces of 25 s; and the last epoch is the filter's own."""
    square = np.zeros((2, 12, 6))
    for seed in range(20):
        log = simulate(model, Approach(assumed_noise=True), Faults(dropout=0.05, outliers=0.02), seed=seed)
        for row, solution in enumerate(both(model, log, method)):
            error = np.nan_to_num(solution.state - log.truth) ** 2
            square[row] += error.reshape(12, 250, 6).sum(axis=1)
            if row == 0:
                last = solution.state[-1]
        assert np.array_equal(solution.state[-1], last)
    assert np.all(square[1] <= square[0])
    assert square[1].sum(axis=0)[0] < 0.4 * square[0].sum(axis=0)[0]


def test_smoothed_sigma_never_exceeds_filtered(model):
    log = simulate(model, Approach(), Faults(dropout=0.1), seed=1)
    filtered, smoothed = both(model, log, "spots")
    known = filtered.status != EpochStatus.WAITING
    assert np.all(smoothed.sigma[known] <= filtered.sigma[known] * (1.0 + 1e-9))
    assert np.array_equal(np.isnan(smoothed.state), np.isnan(filtered.state))
    assert smoothed.smoothed
    assert not filtered.smoothed


def test_pieces_do_not_mix(model):
    """The scene jumps; the piece before the restart is smoothed as if the log ended there."""
    first = simulate(model, Approach(duration_s=20.0), seed=3)
    second = simulate(model, Approach(duration_s=20.0, start_m=(9.0, -0.2, 0.2)), seed=4)
    spots = np.concatenate([first.spots_m, second.spots_m])
    t = np.arange(400) * 0.1
    whole = relnav.filter_epochs(model, t, spots, smooth=True)
    restart = int(np.flatnonzero(whole.status == EpochStatus.STARTED)[1])
    before = relnav.filter_epochs(model, t[:restart], spots[:restart], smooth=True)
    assert np.array_equal(whole.state[:restart], before.state, equal_nan=True)
    after = relnav.filter_epochs(model, t[restart - 1 :], spots[restart - 1 :], smooth=True)
    assert np.allclose(whole.state[restart:], after.state[1:], rtol=0.0, atol=1e-12)
