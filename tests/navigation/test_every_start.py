"""Every epoch of a faulted log as the first: the filter starts, is never locked out, and ends consistent."""

import numpy as np
import pytest
from scipy.stats import chi2

import relnav
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach

LENGTH = 250
STARTS = 400
# Final NEES of 400 overlapping runs; the same value is passed by one honest run in a million.
LIMIT = chi2.isf(1e-6, 6)


@pytest.mark.parametrize("axis", ["vbar", "rbar"])
@pytest.mark.parametrize("outliers", [0.05, 0.15])
@pytest.mark.parametrize("method", ["spots", "fix"])
def test_no_start_epoch_locks_the_filter_out(request, nees, axis, outliers, method):
    model = request.getfixturevalue(axis)
    approach = Approach(duration_s=70.0, start_m=(8.0, 0.2, -0.1), thrust_scale_error=0.02)
    log = simulate(model, approach, Faults(dropout=0.1, outliers=outliers), seed=5)
    for first in range(STARTS):
        cut = slice(first, first + LENGTH)
        solution = relnav.filter_epochs(
            model, log.t_s[cut], log.spots_m[cut], acceleration_m_s2=log.acceleration_m_s2[cut], method=method
        )
        started = np.flatnonzero(solution.status == relnav.EpochStatus.STARTED)
        assert started.size, f"start epoch {first}: never started"
        assert started[0] < 60, f"start epoch {first}: started only at {started[0]}"
        error = solution.state - log.truth[cut]
        values = nees(error[started[0] : started[0] + 1], solution.covariance[started[0] : started[0] + 1])
        assert values[0] < LIMIT, f"start epoch {first}: NEES {values[0]:.1f} at the start"
        last = nees(error[-1:], solution.covariance[-1:])[0]
        assert last < LIMIT, f"start epoch {first}: NEES {last:.1f} at the end"
        late = solution.status[-50:]
        assert np.mean(np.isin(late, (1, 2, 4))) > 0.5, f"start epoch {first}: locked out at the end"


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_an_outlier_in_the_very_first_image_does_not_start_the_filter(vbar, drift, look, nees, method):
    """The gate trap: one image that is wholly but plausibly wrong opens a trial, which nothing then confirms."""
    t = 0.1 * np.arange(300)
    truth = drift(vbar, t, [8.0, 0.1, -0.1, 0.0, 0.0, 0.0])
    spots = look(vbar, truth, seed=3)
    elsewhere = drift(vbar, t[:1], [5.5, 0.1, 0.2, 0.0, 0.0, 0.0])
    spots[0] = look(vbar, elsewhere, seed=4)[0]
    solution = relnav.filter_epochs(vbar, t, spots, method=method)
    assert solution.status[:3].tolist() == [0, 0, 5]  # WAITING, WAITING (a new trial), STARTED
    assert solution.restarts == 0
    assert nees(solution.state[2:] - truth[2:], solution.covariance[2:]).max() < LIMIT


def test_the_start_uses_its_image_up(vbar, drift, look):
    """The second image confirms the trial and is then in the state; the first is not fused twice."""
    t = np.array([0.0, 0.1])
    truth = drift(vbar, t, [8.0, 0.1, -0.1, 0.0, 0.0, 0.0])
    solution = relnav.filter_epochs(vbar, t, look(vbar, truth, seed=3), method="spots")
    single = relnav.three_beacon.measure(look(vbar, truth, seed=3)[1], vbar)
    assert solution.status[1] == relnav.EpochStatus.STARTED
    # Two images of equal worth: between 1 / sqrt(2) of one (no motion between) and one.
    ratio = solution.docking_sigma[1, 0] / np.sqrt(single.covariance[0, 0])
    assert 0.68 < ratio < 1.0
