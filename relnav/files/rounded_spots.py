"""Spots that a log, or its detector, rounds to steps that are larger than their stated noise."""

import numpy as np

from relnav.arrays import Stack

ROWS_TRIED = 200
FEWEST = 12
"""Different numbers that tell a step: fewer may be its multiples by chance, or a simulation without noise."""
NEARLY = 0.01
"""Of a step, by which a multiple of it may be off: what is left of the digits of a file."""


def step_of(spots: Stack) -> float:
    """The step by multiples of which all coordinates of the first images (n, spots, 2) differ; 0: there is none."""
    first = spots[:ROWS_TRIED]
    values = np.unique(first[np.isfinite(first)])
    if len(values) < FEWEST:
        return 0.0
    apart, whole = np.diff(values), float(np.ptp(values))
    shortest = float(apart[apart > 1e-12 * whole].min())
    step = whole / round(whole / shortest)
    times = (values - values[0]) / step
    return step if bool((np.abs(times - np.rint(times)) < NEARLY).all()) else 0.0


def rounded(spots: Stack, noise: float, unit: str, scale: float = 1.0) -> tuple[str, ...]:
    """A note where spots come in steps above their stated noise; noise in the unit of spots, scale makes it `unit`."""
    step = step_of(spots)
    if step <= noise:
        return ()
    return (
        f"spots come in steps of {step * scale:.3g} {unit}, more than their stated noise of "
        f"{noise * scale:.3g} {unit}: while a spot stays within a step its error stays the same, which the covariance "
        "does not include",
    )
