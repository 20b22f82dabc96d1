"""Packages for linear filters: the closed form's position as measurement with one R for all epochs, no gate, no NIS.

They do less than the filter of `by_hand`: the closed form is computed beforehand and not timed.
"""

import numpy as np


def numpy_filter(phi, q, h, r, x, covariance, fixes):
    """Plain numpy, for the answers: filtered states (n, 6)."""
    states = []
    for z in fixes:
        x, covariance = phi @ x, phi @ covariance @ phi.T + q
        k = np.linalg.solve(h @ covariance @ h.T + r, h @ covariance).T
        x, covariance = x + k @ (z - h @ x), covariance - k @ h @ covariance
        states.append(x)
    return np.array(states)


def pykalman_filter(phi, q, h, r, x, covariance, fixes):
    """Pykalman."""
    from pykalman import KalmanFilter

    # its first epoch is not predicted: hand it the prediction
    prior = phi @ covariance @ phi.T + q
    return KalmanFilter(phi, h, q, r, initial_state_mean=phi @ x, initial_state_covariance=prior).filter(fixes)[0]


def simdkalman_filter(phi, q, h, r, x, covariance, fixes):
    """Simdkalman."""
    from simdkalman import KalmanFilter

    prior = phi @ covariance @ phi.T + q
    result = KalmanFilter(phi, q, h, r).compute(
        fixes[None], 0, initial_value=phi @ x, initial_covariance=prior, filtered=True, smoothed=False
    )
    return result.filtered.states.mean[0]


def kalman_py_filter(phi, q, h, r, x, covariance, fixes):
    """kalman-py, its numpy backend."""
    from kalman_py import KalmanFilter

    return KalmanFilter(phi, h, q, r, x, covariance).filter(fixes).means
