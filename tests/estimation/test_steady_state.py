"""Where the Riccati equation says that a filter settles, against the filter itself run long."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.accuracy.campaign import noise_alone
from relnav.dynamics.clohessy_wiltshire import transition
from relnav.dynamics.process_noise import acceleration_noise
from relnav.estimation.steady_state import steady_state
from relnav.mission import ProcessNoise
from relnav.navigation.steady_state_filter import settled_filter
from relnav.simulation.detector import Faults, image


@pytest.fixture(scope="module")
def quiet_model():
    """The shipped mission without errors of control or attitude: there is no control here."""
    model = noise_alone(relnav.load_model("three_beacon_psd"), "spots")
    return replace(model, process_noise=ProcessNoise(model.process_noise.acceleration_noise_density_m2_s3))


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_long_run_filter_approaches_it(quiet_model, method, outside):
    held = np.zeros((12_000, 6))
    held[:, 0] = 4.0
    spots = image(quiet_model, held, Faults(), np.random.default_rng(5))
    solution = relnav.filter_epochs(quiet_model, np.arange(12_000) * 0.1, spots, method=method)
    settled = settled_filter(quiet_model, np.array([4.0, 0.0, 0.0]), 10.0, method)
    assert settled.detectable
    reached = solution.part(11_999, 12_000).covariance[0]
    scale = np.sqrt(np.outer(np.diag(settled.posterior), np.diag(settled.posterior)))
    off = np.max(np.abs(reached - settled.posterior) / scale)
    outside("control dlqe (Riccati equation)", f"`{method}` filter after 20 minutes, covariance, relative", off, 2e-3)


def test_prior_posterior_and_gain_are_one_cycle_of_the_filter():
    """Not the prior and the predictor's gain that the Riccati solver hands out."""
    phi, q = transition(1.1e-3, 1.0), acceleration_noise(1.1e-3, 1.0, 1e-6)
    h, r = np.eye(3, 6), np.diag([1e-4, 4e-4, 1e-4])
    settled = steady_state(phi, q, h, r)
    s = h @ settled.prior @ h.T + r
    scale = np.sqrt(np.outer(np.diag(settled.prior), np.diag(settled.prior)))
    assert np.allclose(settled.gain, settled.prior @ h.T @ np.linalg.inv(s), rtol=1e-8, atol=1e-12)
    assert np.max(np.abs(settled.prior - settled.gain @ s @ settled.gain.T - settled.posterior) / scale) < 1e-9
    assert np.max(np.abs(phi @ settled.posterior @ phi.T + q - settled.prior) / scale) < 1e-9


def test_c_alone_on_the_axis_is_undetectable(quiet_model):
    settled = settled_filter(quiet_model, np.array([2.0, 0.0, 0.0]), 10.0, beacons="c", method="spots")
    assert not settled.detectable
    assert np.isnan(settled.posterior).all()
    assert settled.observability[-1] <= 1e-12 * settled.observability[0]


def test_no_measurement_is_an_error(quiet_model):
    with pytest.raises(ValueError, match=r"no measurement at \[0.3, 0.0, 0.0\] m"):
        settled_filter(quiet_model, np.array([0.3, 0.0, 0.0]), 10.0, "fix")


def test_noise_beyond_all_numbers_is_refused():
    with pytest.raises(OverflowError, match=r"process noise of a step is up to 1e\+200; 1e\+30 is the most"):
        steady_state(np.eye(6), 1e200 * np.eye(6), np.eye(2, 6), np.eye(2))
