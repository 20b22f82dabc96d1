"""The covariance of an innovation, found again from the track, against the filter's own NIS."""

from pathlib import Path

import numpy as np
import pytest

import relnav
from relnav.accuracy.campaign import noise_alone
from relnav.navigation.innovation_gates import innovation_covariances
from relnav.navigation.status import REJECTED

EXAMPLE = Path(__file__).parents[2] / "examples" / "basilisk_approach" / "vbar_log.csv"


@pytest.fixture(scope="module")
def log():
    table = np.genfromtxt(EXAMPLE, delimiter=",", skip_header=1, max_rows=400)
    return table[:, 0], table[:, 1:7].reshape(-1, 3, 2) * 1e-6, table[:, 7:10]


def filtered(log, method, **keywords):
    t, spots, control = log
    model = noise_alone(relnav.load_model("three_beacon_psd"), method)
    return model, relnav.filter_epochs(model, t, spots, acceleration_m_s2=control, method=method, **keywords)


@pytest.mark.parametrize("method", ["fix", "spots"])
def test_nis_of_the_innovations_is_the_filters(log, method):
    model, solution = filtered(log, method)
    numbers = 3 if method == "fix" else 6
    found = innovation_covariances(model, solution, np.arange(2, 400))
    ratios = []
    for e, s in zip(range(2, 400), found, strict=True):
        if len(s):
            innovation = solution.innovation[e, :numbers]
            ratios.append(innovation @ np.linalg.solve(s, innovation) / solution.nis[e])
    assert len(ratios) > 300
    assert np.abs(np.array(ratios) - 1.0).max() < 0.02  # the filter's gradient is at the prediction


def test_of_a_rejected_image(log):
    t, spots, control = log
    spots = spots.copy()
    spots[300] += 1e-3
    model, solution = filtered((t, spots, control), "spots")
    assert solution.status[300] == REJECTED
    (s,) = innovation_covariances(model, solution, np.array([300]))
    innovation = solution.innovation[300]
    assert innovation @ np.linalg.solve(s, innovation) == pytest.approx(solution.nis[300], rel=0.02)


def test_a_smoothed_track_does_not_tell(log):
    model, solution = filtered(log, "fix", smooth=True)
    assert [len(s) for s in innovation_covariances(model, solution, np.array([10, 20]))] == [0, 0]
