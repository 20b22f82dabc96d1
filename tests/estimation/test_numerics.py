"""Three hundred epochs that cost the textbook form every digit: prior 1 km and 1 km/s, spots 1 um, hardly any noise.

The oracle is the same filter in 60-digit arithmetic. Errors are relative to the oracle's own sigmas.
"""

import mpmath
import numpy as np
import pytest

from relnav.dynamics.clohessy_wiltshire import transition
from relnav.dynamics.process_noise import acceleration_noise
from relnav.estimation.factored import compose, factorize, scalar_update

N, DT, EPOCHS = 1.1313666536110223e-3, 0.1, 300
PRIOR, SIGMA, DENSITY = 1e6, 1e-6, 1e-18
PHI, Q = transition(N, DT), acceleration_noise(N, DT, DENSITY)
# Three oblique position measurements an epoch: no gradient is along an axis.
H = np.zeros((3, 6))
H[:, :3] = [[1.0, 0.3, -0.2], [0.1, 1.0, 0.4], [-0.3, 0.2, 1.0]]


@pytest.fixture(scope="module")
def oracle() -> list[mpmath.matrix]:
    """Covariance after every epoch."""
    out = []
    with mpmath.workdps(60):
        p, r = mpmath.matrix((np.eye(6) * PRIOR).tolist()), mpmath.mpf(SIGMA) ** 2
        phi, q = mpmath.matrix(PHI.tolist()), mpmath.matrix(Q.tolist())
        rows = [mpmath.matrix([row.tolist()]) for row in H]
        for _ in range(EPOCHS):
            p = phi * p * phi.T + q
            for h in rows:
                ph = p * h.T
                p = p - ph * ph.T / ((h * ph)[0] + r)
            out.append(p)
    return out


def relative_error(p: np.ndarray, exact: mpmath.matrix) -> float:
    with mpmath.workdps(60):
        return max(
            float(abs(p[i, j] - exact[i, j]) / mpmath.sqrt(exact[i, i] * exact[j, j]))
            for i in range(6)
            for j in range(6)
        )


def positive_definite(p: np.ndarray) -> bool:
    d = np.diag(p)
    if not (d > 0.0).all():
        return False
    return bool(np.linalg.eigvalsh(p / np.sqrt(np.outer(d, d))).min() > 0.0)


def factored_filter(time_update) -> list[np.ndarray]:
    ud, q_ud, out = factorize(np.eye(6) * PRIOR), factorize(Q), []
    for _ in range(EPOCHS):
        time_update(ud, PHI, q_ud)
        for h in H:
            scalar_update(np.zeros(6), ud, h, SIGMA**2, 0.0)
        assert (np.diag(ud) > 0.0).all()
        out.append(compose(ud))
    return out


def textbook_filter() -> list[np.ndarray]:
    """P = (I - K H) P, all three measurements at once."""
    p, out = np.eye(6) * PRIOR, []
    for _ in range(EPOCHS):
        p = PHI @ p @ PHI.T + Q
        k = p @ H.T @ np.linalg.inv(H @ p @ H.T + SIGMA**2 * np.eye(3))
        p = (np.eye(6) - k @ H) @ p
        out.append(p)
    return out


def test_the_factored_filter_keeps_its_digits(oracle, time_update) -> None:
    covariances = factored_filter(time_update)
    assert all(positive_definite(p) for p in covariances)
    errors = [relative_error(p, exact) for p, exact in zip(covariances, oracle, strict=True)]
    assert errors[0] < 1e-6  # the epoch that takes 1 km to 1 um, by three oblique measurements: 1e-8 is reached
    assert max(errors[1:]) < 1e-12


def test_the_textbook_filter_loses_them(oracle) -> None:
    """Were this to pass, the case above would prove nothing."""
    covariances = textbook_filter()
    worst = max(relative_error(p, exact) for p, exact in zip(covariances, oracle, strict=True))
    assert worst > 0.1
    assert not all(positive_definite(0.5 * (p + p.T)) for p in covariances)
