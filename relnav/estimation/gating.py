"""Chi-square limits: how large a squared innovation may be before it is not believed."""

from scipy.special import chdtri

from relnav.arrays import Vector


def chi_square_limit(probability: float, dof: int) -> float:
    """Value that a chi-square variable with dof degrees of freedom stays below with the given probability.

    Raises
    ------
    ValueError
        Unless 0 < probability < 1 and dof >= 1.
    """
    if not 0.0 < probability < 1.0 or dof < 1:
        raise ValueError(f"0 < probability < 1 and dof >= 1 are expected; got {probability!r}, {dof!r}")
    return float(chdtri(dof, 1.0 - probability))


def gate_limits(gate_probability: float, most_dof: int = 6) -> Vector:
    """Limits for 1 .. most_dof degrees of freedom, (most_dof,)."""
    import numpy as np

    return np.array([chi_square_limit(gate_probability, dof) for dof in range(1, most_dof + 1)])
