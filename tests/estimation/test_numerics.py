"""Three hundred epochs that cost other forms every digit, against the same filter in 120-digit arithmetic.

Errors are relative to the oracle's own sigmas. Of every case the common forms must fail where ours holds: otherwise it
would prove nothing.
"""

from dataclasses import dataclass
from functools import cache

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.dynamics.clohessy_wiltshire import transition
from relnav.dynamics.process_noise import acceleration_noise
from relnav.estimation.factored import compose, decorrelate, factorize
from relnav.estimation.smoothing import carry_noise_back
from relnav.geometry.spherical import range_azimuth_elevation_jacobian

N, DT, EPOCHS, DIGITS = 1.1313666536110223e-3, 0.1, 300, 120
PHI = transition(N, DT)
# Range, azimuth and elevation at 6.5 m, 5 and -3 deg. (Rows farther off the axes carry the epoch that takes 1 km to
# 1 nm to 1e-5 only, in any float64 form: their own rounding does as much.)
H = np.zeros((3, 6))
P = 6.5 * np.array([0.99482, 0.08704, 0.05234])
assert range_azimuth_elevation_jacobian(P, H[:, :3])


@dataclass(frozen=True)
class Case:
    """Prior variance of everything, measurement covariance, process noise density."""

    prior: float
    r: tuple[tuple[float, ...], ...]
    density: float
    bound: float

    @property
    def noise(self) -> np.ndarray:
        return np.array(self.r)

    @property
    def q(self) -> np.ndarray:
        return acceleration_noise(N, DT, self.density)


def turned(*variances: float) -> tuple[tuple[float, ...], ...]:
    v = Rotation.from_euler("zyx", [40.0, 25.0, -35.0], degrees=True).as_matrix()
    r = v @ np.diag(variances) @ v.T
    return tuple(map(tuple, 0.5 * (r + r.T)))


CASES = {
    "prior 1 km, spots 1 um": Case(1e6, turned(1e-12, 1e-12, 1e-12), 1e-18, 1e-6),
    "prior 1 km, spots 1 nm": Case(1e6, turned(1e-18, 1e-18, 1e-18), 1e-18, 1e-6),
    "R of condition 1e16": Case(1.0, turned(1e-4, 1e-12, 1e-20), 1e-12, 0.1),
}


@cache
def oracle(name: str) -> tuple[list[mpmath.matrix], list[mpmath.matrix]]:
    """Covariance after every epoch's measurement, and predicted for it."""
    case, filtered, predicted = CASES[name], [], []
    with mpmath.workdps(DIGITS):
        p, r = mpmath.matrix((np.eye(6) * case.prior).tolist()), mpmath.matrix(case.noise.tolist())
        phi, q, h = (mpmath.matrix(m.tolist()) for m in (PHI, case.q, H))
        for _ in range(EPOCHS):
            p = phi * p * phi.T + q
            predicted.append(p)
            ph = p * h.T
            p = p - ph * mpmath.inverse(h * ph + r) * ph.T
            filtered.append(p)
    return filtered, predicted


def relative_error(p: np.ndarray, exact: mpmath.matrix) -> float:
    with mpmath.workdps(DIGITS):
        return max(
            float(abs(p[i, j] - exact[i, j]) / mpmath.sqrt(exact[i, i] * exact[j, j]))
            for i in range(6)
            for j in range(6)
        )


def positive_definite(p: np.ndarray) -> bool:
    d = np.diag(p)
    if not np.isfinite(p).all() or not (d > 0.0).all():
        return False
    scaled = 0.5 * (p + p.T) / np.sqrt(np.outer(d, d))
    return bool(np.linalg.eigvalsh(scaled).min() > 0.0)


def factored_filter(case: Case, time_update, update) -> list[np.ndarray]:
    """Factors after every epoch."""
    ld, q_ld, out = factorize(np.eye(6) * case.prior), factorize(case.q), []
    lower, variances = np.zeros((3, 3)), np.zeros(3)
    assert decorrelate(case.noise, lower, variances)
    rows = np.linalg.solve(lower, H)
    for _ in range(EPOCHS):
        time_update(ld, PHI, q_ld)
        for h, r in zip(rows, variances, strict=True):
            update(np.zeros(6), ld, h, r, 0.0)
        out.append(ld.copy())
    return out


def joseph_filter(case: Case) -> list[np.ndarray]:
    p, out = np.eye(6) * case.prior, []
    for _ in range(EPOCHS):
        p = PHI @ p @ PHI.T + case.q
        k = np.linalg.solve(H @ p @ H.T + case.noise, H @ p).T
        rest = np.eye(6) - k @ H
        p = rest @ p @ rest.T + k @ case.noise @ k.T
        out.append(p)
    return out


def filterpy_filter(case: Case) -> list[np.ndarray]:
    from filterpy.kalman import KalmanFilter

    theirs = KalmanFilter(dim_x=6, dim_z=3)
    theirs.P, theirs.F, theirs.Q, theirs.H, theirs.R = np.eye(6) * case.prior, PHI, case.q, H, case.noise
    out = []
    for _ in range(EPOCHS):
        theirs.predict()
        theirs.update(np.zeros(3))
        out.append(theirs.P.copy())
    return out


@pytest.mark.parametrize("name", CASES)
def test_the_factored_filter_keeps_its_digits(name, compiled_time_update, compiled_update) -> None:
    case, (exact, _) = CASES[name], oracle(name)
    factors = factored_filter(case, compiled_time_update, compiled_update)
    assert all((np.diag(ld) > 0.0).all() for ld in factors)  # D > 0: positive definite, whatever the condition
    errors = [relative_error(compose(ld), p) for ld, p in zip(factors, exact, strict=True)]
    assert max(errors) <= case.bound
    assert errors[-1] <= max(1e-9, 1e-1 * case.bound)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("form", [joseph_filter, filterpy_filter])
def test_the_common_forms_lose_them(name, form) -> None:
    covariances = form(CASES[name])
    worst = max(relative_error(p, exact) for p, exact in zip(covariances, oracle(name)[0], strict=True))
    assert not worst < 0.1 or not all(positive_definite(p) for p in covariances)


@pytest.mark.parametrize("name", CASES)
def test_the_smoother_keeps_its_digits(
    name, compiled_time_update, compiled_update, compiled_model, compiled_smooth
) -> None:
    """Backward over the same epochs, against Rauch, Tung and Striebel's difference in 120 digits."""
    case, (filtered, predicted) = CASES[name], oracle(name)
    factors, q_ld = factored_filter(case, compiled_time_update, compiled_update), factorize(case.q)
    state, inverse, nothing = np.zeros(6), transition(N, -DT), np.zeros(6)
    carried, c, s_ld = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    carry_noise_back(q_ld, inverse, carried)
    later = factors[-1].copy()
    errors = []
    with mpmath.workdps(DIGITS):
        phi, smoothed = mpmath.matrix(PHI.tolist()), filtered[-1]
        for e in range(EPOCHS - 2, -1, -1):
            gain = filtered[e] * phi.T * mpmath.inverse(predicted[e + 1])
            smoothed = filtered[e] + gain * (smoothed - predicted[e + 1]) * gain.T
            compiled_model(factors[e], inverse, carried, c, s_ld)
            compiled_smooth(state, later, nothing, nothing, c, s_ld)
            assert (np.diag(later) > 0.0).all()
            errors.append(relative_error(compose(later), smoothed))
    assert max(errors) <= case.bound


def test_a_filter_without_process_noise_stays_definite(compiled_time_update, compiled_update) -> None:
    """100,000 epochs, q = 0: the covariance only shrinks (1e8 by `benchmarks/speed.py --long`)."""
    ld, nothing = factorize(np.eye(6) * 1e2), np.zeros((6, 6))
    for _ in range(100_000):
        compiled_time_update(ld, PHI, nothing)
        for h in H:
            compiled_update(np.zeros(6), ld, h, 1e-4, 0.0)
    assert (np.diag(ld) > 0.0).all()
    assert positive_definite(compose(ld))
