"""What a sensor of one's own is to the vehicle's filter: errors that last, and rows about the whole state.

What such a class states and returns is checked here: compiled code that reads it trusts its sizes.
"""

import math
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Any, Protocol, get_args

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.estimation.state_layout import Role, StateLayout
from relnav.vehicle.layout import LIGHTS, LastingError
from relnav.vehicle.rows import Rows, empty_rows
from relnav.vehicle.state import Estimates, VehicleState

SAME = 1e-6
"""Share of two sigmas by which a covariance may differ from its transpose, and a correlation exceed one.

Arithmetic in single precision leaves 1e-7 of both.
"""
MEMBERS = ("lasting", "most_rows", "placed", "taken", "rows")


class FlyingSensor(Protocol):
    """A sensor that `VehicleNavigator(vehicle, sensors={name: sensor})` flies beside those of the vehicle file.

    Attributes
    ----------
    lasting : sequence of LastingError
        Its own errors that last a run; each becomes a block of the state, "NAME.KIND". Those of kind "mount" and
        "focal", or else the first, are watched for a drift (`relnav.vehicle.drifts`). "points" are places of lights in
        the target, three errors each.
    most_rows : int
        The largest number of rows that it gives at once.
    """

    lasting: tuple[LastingError, ...]
    most_rows: int

    def placed(self, name: str, layout: StateLayout) -> None:
        """Told once under what name it flies, and where its errors stand: `layout.by_name["NAME.KIND"]`."""

    def taken(self, value: Any, covariance: Any) -> tuple[Vector, Matrix]:
        """What a caller observed as numbers (k,), NaN = nothing, and the covariance of their noise.

        ValueError, with what is expected, for what cannot be. The arrays are kept for when a late event is inserted
        before them: they may not be changed later.
        """

    def rows(self, state: VehicleState, value: Vector, noise: Matrix) -> Rows:
        """Rows of an observation at an estimate: the same arguments, the same rows.

        The Jacobian is by the errors of `layout` with the attitude error of `relnav.geometry.rotation_vector`. Where a
        residual is NaN its row of the Jacobian and of the noise may be anything.
        """


class Flown:
    """A sensor of one's own as the filters ask it: about all their estimates at once."""

    def __init__(self, sensor: FlyingSensor, name: str, layout: StateLayout) -> None:
        self._sensor, self._name, self.most_rows = sensor, name, int(sensor.most_rows)
        sensor.placed(name, layout)

    def taken(self, value: Any, covariance: Any) -> tuple[Vector, Matrix]:
        """As the sensor does.

        Raises
        ------
        ValueError
            For what is no pair of arrays.
        """
        taken = self._sensor.taken(value, covariance)
        pair = isinstance(taken, tuple) and len(taken) == 2 and all(isinstance(one, np.ndarray) for one in taken)
        if not pair or taken[0].ndim != 1:
            raise ValueError(
                f"sensors: taken() of '{self._name}' returns two arrays, numbers (k,) and the covariance of their "
                f"noise; got {taken!r}"
            )
        return taken[0].copy(), taken[1]

    def rows(self, at: Estimates, value: Vector, noise: Matrix) -> Rows:
        """Rows of each filter, side by side; one that has fewer than another has nothing in the rest.

        Raises
        ------
        ValueError
            For what are no rows of the filter's errors.
        """
        each, errors = [self._sensor.rows(at.of(f), value, noise) for f in range(len(at.values))], at.values.shape[1]
        for rows in each:
            odd = _odd_rows(rows, self.most_rows, errors)
            if odd:
                raise ValueError(f"sensors: rows() of '{self._name}' returns {odd}; the observation is not used")
        groups = {rows.group for rows in each}
        if len(groups) > 1:
            raise ValueError(
                f"sensors: rows() of '{self._name}' returns groups of the same size at every estimate; got "
                f"{' and '.join(map(str, sorted(groups)))}"
            )
        count = max(len(rows.residual) for rows in each)
        together = empty_rows(len(each), count, errors, each[0].group)
        together.residual[:] = np.nan
        for f, rows in enumerate(each):
            m = len(rows.residual)
            together.residual[f, :m], together.jacobian[f, :m] = rows.residual, rows.jacobian
            together.noise[f, :m, :m] = rows.noise
        return together


def _odd_rows(rows: Rows, most_rows: int, errors: int) -> str:
    """What is expected of rows about so many errors, and what came; empty if they are as expected."""
    if not isinstance(rows, Rows):
        return f"a relnav.vehicle.rows.Rows; got a {type(rows).__name__}"
    residual, H, R, size = rows.residual, rows.jacobian, rows.noise, rows.group
    if np.ndim(residual) != 1 or len(residual) > most_rows:
        return f"residuals (m,) with m up to its most_rows, {most_rows}: state as many; got shape {np.shape(residual)}"
    m = len(residual)
    if np.shape(H) != (m, errors):
        return f"a jacobian ({m}, {errors}): its residuals by all errors of the layout; got shape {np.shape(H)}"
    if np.shape(R) != (m, m):
        return f"a noise ({m}, {m}): the whole covariance of its residuals; got shape {np.shape(R)}"
    if not isinstance(size, Integral) or not 1 <= size <= most_rows or m % size:
        return f"rows in groups of 1 to {most_rows} that divide their number, {m}; got a group of {size!r}"
    return _odd_numbers(np.asarray(residual), np.asarray(H), np.asarray(R))


def _odd_numbers(residual: Vector, H: Matrix, R: Matrix) -> str:
    """The same of the numbers of rows whose sizes are as expected: finite, and a covariance."""
    seen = ~np.isnan(residual)
    if not seen.all():
        residual, H, R = residual[seen], H[seen], R[np.ix_(seen, seen)]
    if not (np.isfinite(residual).all() and np.isfinite(H).all() and np.isfinite(R).all()):
        return "finite numbers, or a residual of NaN where there is nothing to be used; got infinite ones or NaN"
    variance = R.diagonal()
    if not (variance > 0.0).all():
        return f"a noise with variances above zero; got {variance.tolist()}"
    sigma = np.sqrt(variance)
    shared = R / np.outer(sigma, sigma)
    if (np.abs(shared - shared.T) > SAME).any() or (np.abs(shared) > 1.0 + SAME).any():
        return f"a noise that is symmetric, with correlations up to one; got {R.tolist()}"
    return ""


def check_sensors(sensors: Mapping[str, FlyingSensor]) -> None:
    """Refuse sensors of one's own, by name, that state what cannot be.

    Raises
    ------
    ValueError
        Saying of which sensor, what is expected and what came.
    """
    if not isinstance(sensors, Mapping):
        raise ValueError(f"sensors: a mapping of names to sensors is expected; got a {type(sensors).__name__}")
    for name, sensor in sensors.items():
        odd = _odd_sensor(name, sensor)
        if odd:
            raise ValueError(f"sensors: '{name}' has to have {odd}")


def _odd_sensor(name: str, sensor: FlyingSensor) -> str:
    """What a sensor has to have, and what came; empty if it is as expected."""
    if not isinstance(name, str) or not name or "." in name:
        return "a name that is text without a dot"
    lacking = [member for member in MEMBERS if not hasattr(sensor, member)]
    if lacking or isinstance(sensor, type):
        got = f"a class, {sensor.__name__}: call it" if isinstance(sensor, type) else f"none of {', '.join(lacking)}"
        return f"an object with {', '.join(MEMBERS)} (relnav.vehicle.flying_sensor); got {got}"
    if not isinstance(sensor.most_rows, Integral) or sensor.most_rows < 1:
        return f"most_rows, a whole number above zero; got {sensor.most_rows!r}"
    if not isinstance(sensor.lasting, tuple | list):
        return f"in lasting a sequence of LastingError; got a {type(sensor.lasting).__name__}"
    kinds = set[str]()
    for error in sensor.lasting:
        odd = _odd_error(error)
        if odd:
            return odd
        if error.kind in kinds:
            return f"lasting errors of different kinds; got two '{error.kind}': join them, or call one something else"
        kinds.add(error.kind)
    return ""


def _odd_error(error: LastingError) -> str:
    """The same of one error that lasts."""
    if not isinstance(error, LastingError):
        return f"in lasting relnav.vehicle.layout.LastingError alone; got a {type(error).__name__}"
    kind, size, sigma, role = error.kind, error.size, error.sigma, error.role
    if not isinstance(kind, str) or not kind or "." in kind:
        return f"in lasting a kind that is text without a dot; got {kind!r}"
    if not isinstance(size, Integral) or size < 1 or (kind == LIGHTS and size % 3):
        return f"in lasting '{kind}' a size above zero, of '{LIGHTS}' three a light; got {size!r}"
    if not isinstance(sigma, Real) or not 0.0 <= sigma < math.inf:
        return f"in lasting '{kind}' a sigma that is one number, zero or more; got {sigma!r}"
    if role not in get_args(Role):
        return f"in lasting '{kind}' the role {' or '.join(map(repr, get_args(Role)))}; got {role!r}"
    return ""
