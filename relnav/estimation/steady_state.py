"""Where a filter settles, from the discrete Riccati equation: covariance, gain, and whether it settles at all.

`control.dlqe` returns the PRIOR covariance and the gain of the PREDICTOR, L = Phi K; both are converted here. It costs
2.6 s to import and is imported when used.
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import LARGEST, Matrix, Vector


@dataclass(frozen=True)
class SteadyState:
    """Long-run filter at one geometry and rate.

    Attributes
    ----------
    detectable : bool
        False if some uncertain direction is never seen, or the noise is so small beside the rest that it is lost in
        rounding; the matrices are then NaN.
    prior, posterior : (6, 6)
        Covariance before and after each measurement.
    gain : (6, m)
        Filter gain K.
    observability : (6,)
        Singular values of the observability matrix of six steps, rows scaled to unit noise: the smallest over the
        largest says how well the worst direction is seen.
    """

    detectable: bool
    prior: Matrix
    posterior: Matrix
    gain: Matrix
    observability: Vector


def steady_state(phi: Matrix, q: Matrix, h: Matrix, r: Matrix) -> SteadyState:
    """Steady state of x' = Phi x + w, z = H x + v with covariances Q and R.

    Parameters
    ----------
    phi, q : (6, 6)
        Transition and process noise covariance over one step.
    h, r : (m, 6), (m, m)
        Measurement rows and noise.

    Raises
    ------
    OverflowError
        If the process noise is beyond what floats hold.
    """
    import control

    if not np.abs(q).max() < LARGEST:
        raise OverflowError(f"process noise of a step is up to {np.abs(q).max():g}; {LARGEST:g} is the most")
    whitener = np.linalg.inv(np.linalg.cholesky(r))
    values = np.linalg.svd(control.obsv(phi, whitener @ h), compute_uv=False)
    nothing = np.full(phi.shape, np.nan)
    undetectable = SteadyState(False, nothing, nothing, np.full(h.T.shape, np.nan), values)
    if values[-1] <= 1e-12 * values[0]:  # a direction that is never seen, to rounding
        return undetectable
    try:
        predictor, prior, _ = control.dlqe(phi, np.eye(len(phi)), h, q, r)
    except (np.linalg.LinAlgError, ValueError):  # ValueError: too ill-conditioned to be ordered
        return undetectable
    gain: Matrix = np.linalg.solve(phi, predictor)
    rest = np.eye(len(phi)) - gain @ h
    posterior = rest @ prior @ rest.T + gain @ r @ gain.T
    if not (np.diagonal(prior).min() > 0.0 and np.diagonal(posterior).min() > 0.0):  # noise that is lost in rounding
        return undetectable
    return SteadyState(True, np.asarray(prior), posterior, gain, values)
