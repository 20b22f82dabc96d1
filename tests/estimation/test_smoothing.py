"""The backward smoother against the exact batch least squares solution of the same linear problem (50 digits)."""

import mpmath
import numpy as np
import pytest

from relnav.dynamics.clohessy_wiltshire import transition
from relnav.dynamics.process_noise import acceleration_noise
from relnav.estimation.factored import compose, factorize, scalar_update, time_update_into
from relnav.estimation.smoothing import rts_smooth

N_RAD_S = 1.1e-3
PRIOR = np.diag([4.0, 4.0, 4.0, 0.01, 0.01, 0.01])
SIGMA_M = 0.02
EPOCHS = 12


@pytest.fixture(params=[1, 2, 3])
def problem(request):
    """Irregular times, two long gaps, epochs with no, one, two or three measured axes, a known input."""
    rng = np.random.default_rng(request.param)
    dt = rng.uniform(0.5, 4.0, size=EPOCHS - 1)
    dt[3], dt[8] = 300.0, 1200.0
    phi = np.array([transition(N_RAD_S, step) for step in dt])
    q = np.array([acceleration_noise(N_RAD_S, step, 1e-7) for step in dt])
    effect = rng.normal(size=(EPOCHS - 1, 6)) * [0.1, 0.1, 0.1, 0.01, 0.01, 0.01]
    x = rng.multivariate_normal(np.zeros(6), PRIOR)
    rows = []
    for e in range(EPOCHS):
        if e > 0:
            x = phi[e - 1] @ x + effect[e - 1] + rng.multivariate_normal(np.zeros(6), q[e - 1])
        axes = np.flatnonzero(rng.uniform(size=3) < 0.6)
        rows.append([(axis, x[axis] + SIGMA_M * rng.normal()) for axis in axes])
    return phi, effect, q, rows


def batch(phi, effect, q, rows):
    """All states at once: information of prior, dynamics and measurements summed, one solve, one inverse."""
    n = len(rows)
    with mpmath.workdps(50):
        information, right = mpmath.zeros(6 * n), mpmath.zeros(6 * n, 1)

        def add(parts, weight, value):
            """|sum_e parts[e] x_e - value|^2 under the weight."""
            for e, left in parts.items():
                pull = left.T * weight
                for i in range(6):
                    right[6 * e + i] += (pull * value)[i]
                for other, middle in parts.items():
                    product = pull * middle
                    for i in range(6):
                        for j in range(6):
                            information[6 * e + i, 6 * other + j] += product[i, j]

        eye = mpmath.eye(6)
        add({0: eye}, mpmath.matrix(PRIOR.tolist()) ** -1, mpmath.zeros(6, 1))
        for e in range(n - 1):
            weight = mpmath.matrix(q[e].tolist()) ** -1
            add({e: -mpmath.matrix(phi[e].tolist()), e + 1: eye}, weight, mpmath.matrix(effect[e].tolist()))
        for e, measured in enumerate(rows):
            for axis, value in measured:
                h = mpmath.zeros(1, 6)
                h[int(axis)] = 1
                add({e: h}, mpmath.matrix([[1 / mpmath.mpf(SIGMA_M**2)]]), mpmath.matrix([float(value)]))
        covariance = information**-1
        states = np.array((covariance * right).tolist(), dtype=float).reshape(n, 6)
        blocks = np.array(covariance.tolist(), dtype=float)
    return states, np.array([blocks[6 * e : 6 * e + 6, 6 * e : 6 * e + 6] for e in range(n)])


def filter_forward(phi, effect, q, rows):
    x, ld = np.zeros(6), factorize(PRIOR)
    states, factors = [], []
    for e, measured in enumerate(rows):
        if e > 0:
            x = phi[e - 1] @ x + effect[e - 1]
            time_update_into(ld, phi[e - 1], factorize(q[e - 1]))
        for axis, value in measured:
            h = np.zeros(6)
            h[axis] = 1.0
            scalar_update(x, ld, h, SIGMA_M**2, value - x[axis])
        states.append(x.copy())
        factors.append(ld.copy())
    return np.array(states), np.array(factors)


def test_smoother_is_batch_least_squares(problem, outside):
    phi, effect, q, rows = problem
    states, factors = rts_smooth(*filter_forward(phi, effect, q, rows), phi, effect, q)
    expected, covariance = batch(phi, effect, q, rows)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    scale = sigma[:, :, None] * sigma[:, None, :]
    off = np.max(np.abs(states - expected) / sigma)
    outside("batch least squares in 50 digits (mpmath)", "smoothed states, 1-sigma", off, 1e-10)
    assert np.max(np.abs(compose(factors) - covariance) / scale) < 1e-10


def test_smoothing_never_adds_uncertainty(problem):
    phi, effect, q, rows = problem
    filtered = filter_forward(phi, effect, q, rows)
    _, factors = rts_smooth(*filtered, phi, effect, q)
    gained = compose(filtered[1]) - compose(factors)
    scale = np.trace(compose(filtered[1]), axis1=1, axis2=2)
    assert np.all(np.linalg.eigvalsh(gained).min(axis=1) > -1e-12 * scale)


def test_stays_positive_definite_where_the_textbook_form_does_not():
    """A prior 1e12 wider than the measurements: Pf + C (Ps - Pp) C^T loses definiteness, the sum form keeps it."""
    phi = np.array([transition(N_RAD_S, 1.0)] * 40)
    q = np.array([acceleration_noise(N_RAD_S, 1.0, 1e-18)] * 40)
    x, ld = np.zeros(6), factorize(1e6 * np.eye(6))
    states, factors, plain, predicted = [], [], [], []
    for e in range(41):
        if e > 0:
            time_update_into(ld, phi[e - 1], factorize(q[e - 1]))
        predicted.append(compose(ld))
        for axis in range(3):
            scalar_update(x, ld, np.eye(6)[axis], 1e-12, 0.0)
        states.append(x.copy())
        factors.append(ld.copy())
        plain.append(compose(ld))
    _, smooth = rts_smooth(np.array(states), np.array(factors), phi, np.zeros((40, 6)), q)
    assert np.all(smooth.diagonal(axis1=1, axis2=2) > 0.0)
    textbook = plain[-1]
    lost = 0
    for e in range(39, -1, -1):
        c = plain[e] @ phi[e].T @ np.linalg.pinv(predicted[e + 1], hermitian=True)
        textbook = plain[e] + c @ (textbook - predicted[e + 1]) @ c.T
        lost += np.linalg.eigvalsh(0.5 * (textbook + textbook.T)).min() <= 0.0
    assert lost > 0


def test_without_process_noise_the_last_state_is_carried_back():
    """Q = 0: nothing is known of an epoch that the last one does not know."""
    steps = [0.5, 300.0, 2.0]
    phi = np.array([transition(N_RAD_S, dt) for dt in steps])
    rng, last = np.random.default_rng(4), factorize(PRIOR)
    wide = np.array([factorize(PRIOR + np.eye(6))] * 3)
    states = rng.normal(size=(4, 6))
    smoothed, factors = rts_smooth(states, np.array([*wide, last]), phi, np.zeros((3, 6)), np.zeros((3, 6, 6)))
    back = np.eye(6)
    for e in (2, 1, 0):
        back = transition(N_RAD_S, -steps[e]) @ back
        np.testing.assert_allclose(smoothed[e], back @ states[3], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(compose(factors[e]), back @ PRIOR @ back.T, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("known", [[0], [3, 4, 5], [0, 1, 2, 3, 4, 5]])
@pytest.mark.parametrize("quiet", [[0], [0, 1, 2], [0, 1, 2, 3, 4, 5]])
def test_directions_without_uncertainty(known, quiet):
    """Components known exactly stay so, whatever comes later; and where a step has no noise either, all is finite."""
    phi, prior, q = transition(N_RAD_S, 2.0), PRIOR.copy(), 1e-4 * np.eye(6)
    prior[known] = prior[:, known] = 0.0
    q[quiet] = q[:, quiet] = 0.0
    later = factorize(prior)
    time_update_into(later, phi, factorize(q))
    later[np.diag_indices(6)] *= 0.25
    filtered = np.zeros((2, 6)), np.array([factorize(prior), later])
    smoothed, factors = rts_smooth(*filtered, phi[None], np.zeros((1, 6)), q[None])
    with mpmath.workdps(60):  # the pseudo-inverse as the limit of a vanishing noise
        pf, f = mpmath.matrix(prior.tolist()), mpmath.matrix(phi.tolist())
        pp = f * pf * f.T + mpmath.matrix(q.tolist())
        c = pf * f.T * (pp + mpmath.mpf(10) ** -30 * mpmath.eye(6)) ** -1
        expected = pf + c * (-0.75 * pp) * c.T
    assert np.all(smoothed[0] == 0.0)
    np.testing.assert_allclose(compose(factors[0]), np.array(expected.tolist(), dtype=float), rtol=1e-9, atol=1e-12)
    assert np.all(np.abs(compose(factors[0])[known]) < 1e-12)
