"""The ray model fitted to measured spots: a few dozen points find what the patent's 14641 tabulate."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack, Vector
from relnav.sensors.aps_sun.rays import project
from relnav.sensors.aps_sun.sensor import ApsSunModel

# name: (part of the model, field, element of the field or None, scale that moves spots by about a pixel, SI)
PARAMETERS: dict[str, tuple[str, str, int | None, float]] = {
    "hole_height_m": ("sensor", "hole_height_m", None, 1e-5),
    "glass_thickness_m": ("sensor", "glass_thickness_m", None, 1e-5),
    "glass_index": ("sensor", "glass_index", None, 1e-2),
    "glass_tilt_x_rad": ("sensor", "glass_tilt_rad", 0, 1e-2),
    "glass_tilt_y_rad": ("sensor", "glass_tilt_rad", 1, 1e-2),
    "detector_tilt_x_rad": ("sensor", "detector_tilt_rad", 0, 1e-3),
    "detector_tilt_y_rad": ("sensor", "detector_tilt_rad", 1, 1e-3),
    "detector_rotation_rad": ("sensor", "detector_rotation_rad", None, 1e-3),
    "misalignment_x_rad": ("sensor", "misalignment_rad", 0, 1e-3),
    "misalignment_y_rad": ("sensor", "misalignment_rad", 1, 1e-3),
    "misalignment_z_rad": ("sensor", "misalignment_rad", 2, 1e-3),
    "zero_spot_x_px": ("sensor", "zero_spot_px", 0, 1.0),
    "zero_spot_y_px": ("sensor", "zero_spot_px", 1, 1.0),
    "dome_centre_x_m": ("dome", "centre_m", 0, 1e-3),
    "dome_centre_y_m": ("dome", "centre_m", 1, 1e-3),
    "dome_centre_z_m": ("dome", "centre_m", 2, 1e-3),
}
"""What can be fitted. Rotation about z is told from the detector's only by tilts: leave one of the two."""

FREE = (
    "hole_height_m", "glass_thickness_m", "zero_spot_x_px", "zero_spot_y_px", "detector_tilt_x_rad",
    "detector_tilt_y_rad", "detector_rotation_rad", "misalignment_x_rad", "misalignment_y_rad",
)  # fmt: skip
COARSE = ("hole_height_m", "zero_spot_x_px", "zero_spot_y_px")
FREE_DOME = ("dome_centre_x_m", "dome_centre_y_m", "dome_centre_z_m")
MOST_CONDITION = 1e8
STEP = 1e-3


@dataclass(frozen=True)
class PhysicalFit:
    """A ray model fitted to spots.

    Attributes
    ----------
    model : ApsSunModel
        With the fitted values in place.
    free : tuple of str
        Names of the fitted parameters, SI units as their names say.
    values, covariance : (p,), (p, p)
        Their values and covariance, from the stated spot noise.
    rms_px : float
        Of one residual coordinate.
    chi2_per_dof : float
        1 if the model is right and the spot noise as stated.
    condition : float
        Ratio of the largest to the smallest singular value of the Jacobian with columns of unit length.
    """

    model: ApsSunModel
    free: tuple[str, ...]
    values: Vector
    covariance: Matrix
    rms_px: float
    chi2_per_dof: float
    condition: float


def default_free(model: ApsSunModel) -> tuple[str, ...]:
    """Parameters that a calibration of this sensor should fit: the dome's only if there is one, likewise the glass.

    From hole to detector without a glass is a central projection: a tilted detector is a level one that is moved, with
    every direction before it turned. Before it a dome's centre turns with the misalignment, both of them free. So the
    tilt stays.
    """
    dome, glass = model.dome.thickness_m > 0.0, model.sensor.glass_thickness_m > 0.0
    left_out = () if glass else ("glass_thickness_m", "detector_tilt_x_rad", "detector_tilt_y_rad")
    return tuple(name for name in FREE + (FREE_DOME if dome else ()) if name not in left_out)


def parameter_values(model: ApsSunModel, names: Sequence[str]) -> Vector:
    """Values (p,) of parameters of a model, SI."""
    out = np.empty(len(names))
    for k, name in enumerate(names):
        part, field, element, _ = PARAMETERS[name]
        value = getattr(getattr(model, part), field)
        out[k] = value if element is None else value[element]
    return out


def with_parameters(model: ApsSunModel, names: Sequence[str], values: ArrayLike) -> ApsSunModel:
    """The model with parameters replaced."""
    for name, value in zip(names, np.asarray(values, dtype=np.float64).tolist(), strict=True):
        part, field, element, _ = PARAMETERS[name]
        old = getattr(model, part)
        new = value
        if element is not None:
            whole = list(getattr(old, field))
            whole[element] = value
            new = tuple(whole)
        changed = replace(old, **{field: new})
        model = replace(model, sensor=changed) if part == "sensor" else replace(model, dome=changed)
    return model


def parameter_jacobian(model: ApsSunModel, names: Sequence[str], s: Matrix) -> Stack:
    """d(spot px)/d(parameter), (N, 2, p), for directions s (N, 3): central differences of the trace."""
    values, columns = parameter_values(model, names), []
    for k, name in enumerate(names):
        step = STEP * PARAMETERS[name][3]
        ends = []
        for sign in (1.0, -1.0):
            moved = values.copy()
            moved[k] += sign * step
            ends.append(project(with_parameters(model, names, moved), s))
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.stack(columns, axis=-1)


def fit_physical(
    spots_px: ArrayLike, s: ArrayLike, start: ApsSunModel, *, free: Sequence[str] | None = None
) -> PhysicalFit:
    """Fit the ray model to spots by least squares.

    Parameters
    ----------
    spots_px, s : (N, 2), (N, 3)
        Spots and the unit directions that made them.
    start : ApsSunModel
        Start values and everything that is not fitted; its spot noise weighs.
    free : sequence of str, optional
        What to fit, names of `PARAMETERS`; `default_free` if left out.

    Raises
    ------
    ValueError
        With too few points, unknown names, or data that cannot tell two parameters apart (they are named).
    """
    from scipy.optimize import least_squares

    names = default_free(start) if free is None else tuple(free)
    unknown = [name for name in names if name not in PARAMETERS]
    if unknown:
        raise ValueError(f"unknown parameter {unknown[0]!r}; known are {', '.join(PARAMETERS)}")
    xy, s = np.asarray(spots_px, dtype=np.float64), np.asarray(s, dtype=np.float64)
    if xy.shape != (len(s), 2) or 2 * len(s) <= len(names):
        raise ValueError(
            f"{len(names)} parameters need more than {len(names) // 2} spots (N, 2) with a direction (N, 3) each; got "
            f"{xy.shape} and {s.shape}"
        )
    coarse = tuple(name for name in names if name in COARSE)
    if coarse and coarse != names:  # from far off, all at once may lead out of what can be built
        start = fit_physical(xy, s, start, free=coarse).model
    scale = np.array([PARAMETERS[name][3] for name in names])
    first = parameter_values(start, names)

    def model_at(x: Vector) -> ApsSunModel:
        return with_parameters(start, names, first + scale * x)

    def jacobian(x: Vector) -> Matrix:
        scaled: Matrix = parameter_jacobian(model_at(x), names, s) * scale
        return scaled.reshape(-1, len(names))

    noise = start.sensor.spot_noise_px
    found = least_squares(_residuals(model_at, s, xy), np.zeros(len(names)), jac=jacobian, method="lm", xtol=1e-12)
    model, J = model_at(found.x), jacobian(found.x)
    condition = _check_condition(J, names)
    covariance = noise**2 * scale[:, None] * np.linalg.inv(J.T @ J) * scale
    square = float(np.sum(found.fun**2))
    dof = found.fun.size - len(names)
    return PhysicalFit(
        model=model,
        free=names,
        values=parameter_values(model, names),
        covariance=covariance,
        rms_px=float(np.sqrt(square / found.fun.size)),
        chi2_per_dof=square / dof / noise**2,
        condition=condition,
    )


def _residuals(model_at: Callable[[Vector], ApsSunModel], s: Matrix, xy: Matrix) -> Callable[[Vector], Vector]:
    def residuals(x: Vector) -> Vector:
        try:
            spots = project(model_at(x), s)
        except ValueError:  # a trial step into an impossible geometry: so far off that the fit turns back
            return np.full(xy.size, 1e6)
        return np.where(np.isfinite(spots), spots - xy, 1e6).ravel()

    return residuals


def _check_condition(J: Matrix, names: Sequence[str]) -> float:
    length = np.linalg.norm(J, axis=0)
    if not length.all():
        raise ValueError(f"no spot depends on {names[int(np.argmin(length))]}; fit fewer parameters")
    unit = J / length
    _, sizes, axes = np.linalg.svd(unit, full_matrices=False)
    condition = float(sizes[0] / sizes[-1]) if sizes[-1] > 0.0 else np.inf
    if not condition < MOST_CONDITION:
        weak = np.argsort(np.abs(axes[-1]))[-2:]
        raise ValueError(
            f"these points cannot tell {names[weak[1]]} from {names[weak[0]]} (condition {condition:.1g}); measure "
            "over the whole field, or fit fewer parameters"
        )
    return condition
