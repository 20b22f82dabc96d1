"""Packages for linear filters: the closed form's position as measurement with one R for all epochs, no gate, no NIS.

They do less than the filter of `by_hand`: the closed form is computed beforehand and not timed.
"""

import numpy as np

SERIES = 1000


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
    """Simdkalman, one series."""
    return simdkalman_series(phi, q, h, r, x, covariance, fixes, 1)


def simdkalman_series(phi, q, h, r, x, covariance, fixes, series=SERIES):
    """Simdkalman in its best case: many series of one length and one covariance at once; states of the last one."""
    from simdkalman import KalmanFilter

    prior = phi @ covariance @ phi.T + q
    result = KalmanFilter(phi, q, h, r).compute(
        np.repeat(fixes[None], series, axis=0),
        0,
        initial_value=phi @ x,
        initial_covariance=prior,
        filtered=True,
        smoothed=False,
    )
    return result.filtered.states.mean[-1]


def kalman_py_filter(phi, q, h, r, x, covariance, fixes):
    """kalman-py, its numpy backend."""
    from kalman_py import KalmanFilter

    return KalmanFilter(phi, h, q, r, x, covariance).filter(fixes).means


def stone_soup_filter(phi, q, h, r, x, covariance, fixes):
    """Stone Soup."""
    from datetime import datetime, timedelta

    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import KalmanUpdater

    motion = LinearGaussianTimeInvariantTransitionModel(transition_matrix=phi, covariance_matrix=q)
    seen = np.flatnonzero(h.any(axis=0))
    predictor = KalmanPredictor(motion)
    updater = KalmanUpdater(LinearGaussian(ndim_state=len(x), mapping=tuple(seen), noise_covar=r))
    t, states = datetime(2026, 1, 1), []
    state = GaussianState(x[:, None], covariance, timestamp=t)
    for z in fixes:
        t += timedelta(seconds=0.1)
        predicted = predictor.predict(state, timestamp=t)
        state = updater.update(SingleHypothesis(predicted, Detection(z[:, None], timestamp=t)))
        states.append(np.asarray(state.state_vector, dtype=float)[:, 0])
    return np.array(states)


def opencv_filter(phi, q, h, r, x, covariance, fixes):
    """OpenCV's KalmanFilter."""
    import cv2

    filter_ = cv2.KalmanFilter(6, 3, 0, cv2.CV_64F)
    filter_.transitionMatrix, filter_.processNoiseCov = phi, q
    filter_.measurementMatrix, filter_.measurementNoiseCov = h, r
    filter_.statePost, filter_.errorCovPost = x[:, None].copy(), covariance.copy()
    states = []
    for z in fixes:
        filter_.predict()
        states.append(filter_.correct(z[:, None])[:, 0].copy())
    return np.array(states)


def fast_kalman_filter(phi, q, h, r, x, covariance, fixes):
    """fast-kalman, a call per epoch."""
    filter_ = fast_kalman(phi, q, h, r, x, covariance)
    states = []
    for z in fixes:
        filter_.update(z)
        states.append(filter_.x)
    return np.array(states)


def fast_kalman_last(phi, q, h, r, x, covariance, fixes):
    """fast-kalman in its best case: its loop in C++, which gives the last state alone, (1, 6)."""
    return np.array([fast_kalman(phi, q, h, r, x, covariance).update_many(fixes)["x"]])


def fast_kalman(phi, q, h, r, x, covariance):
    """Its filter, started; it is imported as `kalman`."""
    from kalman import LinearKalmanFilter

    matrices = {"P": covariance, "F": phi, "Q": q, "H": h, "R": r}
    return LinearKalmanFilter(6, 3, x=x, **{name: matrix.ravel() for name, matrix in matrices.items()})
