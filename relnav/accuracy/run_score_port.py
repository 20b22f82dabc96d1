"""Errors at the docking port, twelve components, by range and at the end: of markers and of vehicles."""

import math

import numpy as np

from relnav.accuracy.run_figures import Quantity
from relnav.arrays import Codes, Flags, Matrix, Stack, Vector
from relnav.estimation.consistency import nees

TWELVE = (
    *(f"port_{axis}_m" for axis in "xyz"),
    *(f"port_v{axis}_m_s" for axis in "xyz"),
    *(f"turn_{axis}_deg" for axis in "xyz"),
    *(f"rate_{axis}_deg_s" for axis in "xyz"),
)
"""Position, velocity, attitude and rate of the chaser's port from the target's, target axes."""
UNITS = np.array([1.0] * 6 + [180.0 / math.pi] * 6)
OF_TWELVE = {
    Quantity("range", "m"): slice(0, 1),
    Quantity("across", "m"): slice(1, 3),
    Quantity("closing rate", "m/s"): slice(3, 4),
    Quantity("attitude", "deg"): slice(6, 9),
    Quantity("rate", "deg/s"): slice(9, 12),
}
"""What is told by range, root mean square over its axes, and which of the twelve it is; the port's axis is x."""
SAMPLES = 150
"""Epochs of a run, evenly spread, that are looked at; of a run of fewer all."""


def score_port(error: Matrix, covariance: Stack, range_m: Vector, settled: Flags, edges_m: Vector) -> dict[str, float]:
    """Figures by range and at the end.

    error, covariance : (m, 12), (m, 12, 12)
        At the epochs that are looked at, SI and radians; NaN where there is no state.
    range_m, settled : (m,)
        True port distance, and whether the epoch counts in bins and NEES.
    """
    known = np.asarray(np.isfinite(error).all(axis=1))
    ratio, figures = np.full(len(error), math.nan), {"final_range_m": float(range_m[-1])}
    ratio[known] = nees(error[known], covariance[known])
    own, variance = error * UNITS, np.einsum("kii->ki", covariance) * UNITS**2
    late = known & settled
    figures["nees_mean"] = float(ratio[late].mean()) if late.any() else math.nan
    figures["final_nees"] = float(ratio[-1])
    for k, name in enumerate(TWELVE):
        figures[f"final_error_{name}"] = float(own[-1, k])
        figures[f"final_sigma_{name}"] = math.sqrt(variance[-1, k]) if known[-1] else math.nan
    bins = np.searchsorted(edges_m, range_m, "right") - 1
    for k in range(len(edges_m) - 1):
        inside = np.flatnonzero(late & (bins == k))
        figures[f"bin{k}_epochs"] = float(len(inside))
        if not len(inside):
            continue
        figures[f"bin{k}_nees"] = float(ratio[inside[0]])
        for quantity, part in OF_TWELVE.items():
            figures[f"bin{k}_rms_{quantity.column}"] = math.sqrt(np.mean(own[inside, part] ** 2))
            figures[f"bin{k}_sigma_{quantity.column}"] = math.sqrt(np.mean(variance[inside, part]))
    return figures


def looked_at(count: int) -> Codes:
    """Numbers of the epochs of so many that are looked at; the last is one of them."""
    return np.unique(np.append(np.arange(0, count, max(1, count // SAMPLES)), count - 1))
