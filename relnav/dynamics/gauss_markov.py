"""Independent random states that are remembered for a while: first-order Gauss-Markov, and its limit, a random walk.

    x' = -x / tau + w:   phi = exp(-dt / tau),   q = sigma^2 (1 - exp(-2 dt / tau))

(Gelb 1974, Applied Optimal Estimation, section 3.8.) sigma is that of x once it is settled. With tau infinite x walks:
phi = 1, q = sigma^2 dt, and sigma is what it gains in one second, in units of x per root second.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel


@kernel
def propagate_into(sigma: Vector, correlation_time: Vector, dt: float, phi: Matrix, q: Matrix) -> None:
    """Write phi and q (k, k), diagonal, of k states over dt >= 0 s into phi and q.

    sigma (k,), correlation_time (k,) s, > 0; infinite for a random walk. `expm1` keeps all digits of q where dt is far
    below the correlation time.
    """
    for i in range(sigma.shape[0]):
        for j in range(sigma.shape[0]):
            phi[i, j] = 0.0
            q[i, j] = 0.0
        variance = sigma[i] * sigma[i]
        if math.isinf(correlation_time[i]):
            phi[i, i] = 1.0
            q[i, i] = variance * dt
        else:
            phi[i, i] = math.exp(-dt / correlation_time[i])
            q[i, i] = -variance * math.expm1(-2.0 * dt / correlation_time[i])


def propagate(sigma: Vector, correlation_time_s: Vector, dt_s: float) -> tuple[Matrix, Matrix]:
    """Transition and process noise (k, k) of k states; arguments as for `propagate_into`.

    Raises
    ------
    ValueError
        For vectors of different lengths, a sigma below zero, a time that is not positive, or a negative step.
    """
    sigma, time = np.array(sigma, dtype=np.float64), np.array(correlation_time_s, dtype=np.float64)
    if sigma.ndim != 1 or sigma.shape != time.shape:
        raise ValueError(f"sigma and correlation_time_s have one value a state; got shapes {sigma.shape}, {time.shape}")
    if not (np.isfinite(sigma).all() and (sigma >= 0.0).all()):
        raise ValueError(f"sigma must be >= 0 and finite; got {sigma.tolist()}")
    if not (time > 0.0).all():
        raise ValueError(f"correlation_time_s must be positive (infinite: a random walk); got {time.tolist()}")
    if not (math.isfinite(dt_s) and dt_s >= 0.0):
        raise ValueError(f"dt_s must be >= 0 and finite; got {dt_s!r}")
    phi, q = np.empty((len(sigma), len(sigma))), np.empty((len(sigma), len(sigma)))
    propagate_into(sigma, time, dt_s, phi, q)
    return phi, q
