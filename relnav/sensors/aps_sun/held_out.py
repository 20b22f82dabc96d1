"""The error of a calibration at directions that it has not seen: every point predicted by a fit to others.

What a fit leaves at its own points is less than its error: a spline nearly passes through few points. Here each point
in turn, or each fiftieth part of many, is held out. The ray model is fitted to the others by one step of Gauss and
Newton, their spline is as stiff as the whole one, and the spot of a held-out point is compared with both.
"""

import numpy as np

from relnav.arrays import Matrix
from relnav.geometry.projection_angles import tangents_from_direction
from relnav.sensors.aps_sun.physical import PhysicalFit, parameter_jacobian
from relnav.sensors.aps_sun.rays import project, project_jacobian
from relnav.sensors.aps_sun.residual import ResidualChoice, SplineData

MOST_GROUPS = 50
"""Half a second of a calibration; from 50 points on, one at a time gives the same within a tenth."""


def held_out_error(
    xy: Matrix, s: Matrix, fit: PhysicalFit, choice: ResidualChoice | None, rng: np.random.Generator
) -> tuple[Matrix, Matrix]:
    """Calibrated minus stated (alpha, beta) (N, 2) rad of fitted spots (N, 2), each held out, and the same in px.

    Raises
    ------
    ValueError
        If the calibration hinges on one group: without it the others do not determine the ray model.
    """
    left, columns = xy - project(fit.model, s), parameter_jacobian(fit.model, fit.free, s)
    columns = columns / np.linalg.norm(columns, axis=(0, 1))
    group = rng.permutation(len(xy)) % min(len(xy), MOST_GROUPS)
    data = None if choice is None or choice.spline is None else SplineData.under(choice.spline, xy)
    miss = np.empty_like(left)
    for k in range(group.max() + 1):
        out = group == k
        step, _, rank, _ = np.linalg.lstsq(columns[~out].reshape(-1, len(fit.free)), left[~out].ravel())
        if rank < len(fit.free):
            raise ValueError(
                "without one of these points the others do not determine the ray model, so that its error is unknown; "
                "measure more points, or fit fewer parameters"
            )
        shifts = left - columns @ step
        miss[out] = shifts[out]
        if choice is not None and data is not None:
            miss[out] -= data.without(out, shifts, choice.stiffness).shift_px(xy[out])
    tangents = tangents_from_direction(s)
    moved = np.linalg.solve(project_jacobian(fit.model, tangents), miss[..., None])[..., 0]
    return moved / (1.0 + tangents**2), miss
