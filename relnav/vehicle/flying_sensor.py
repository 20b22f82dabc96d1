"""What a sensor of one's own is to the vehicle's filter: errors that last, and rows about the whole state."""

from typing import Any, Protocol

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.estimation.state_layout import StateLayout
from relnav.vehicle.layout import LastingError
from relnav.vehicle.rows import Rows, empty_rows
from relnav.vehicle.state import Estimates, VehicleState


class FlyingSensor(Protocol):
    """A sensor that `VehicleNavigator(vehicle, sensors={name: sensor})` flies beside those of the vehicle file.

    Attributes
    ----------
    lasting : sequence of LastingError
        Its own errors that last a run; each becomes a block of the state, "NAME.KIND". Those of kind "mount" and
        "focal", or else the first, are watched for a drift (`relnav.vehicle.drifts`).
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

        The Jacobian is by the errors of `layout` with the attitude error of `relnav.geometry.rotation_vector`.
        """


class Flown:
    """A sensor of one's own as the filters ask it: about all their estimates at once."""

    def __init__(self, sensor: FlyingSensor, name: str, layout: StateLayout) -> None:
        self._sensor, self.most_rows = sensor, sensor.most_rows
        sensor.placed(name, layout)

    def taken(self, value: Any, covariance: Any) -> tuple[Vector, Matrix]:
        """As the sensor does."""
        numbers, noise = self._sensor.taken(value, covariance)
        return numbers.copy(), noise

    def rows(self, at: Estimates, value: Vector, noise: Matrix) -> Rows:
        """Rows of each filter, side by side; one that has fewer than another has nothing in the rest."""
        each = [self._sensor.rows(at.of(f), value, noise) for f in range(len(at.values))]
        count = max(len(rows.residual) for rows in each)
        together = empty_rows(len(each), count, at.values.shape[1], each[0].group)
        together.residual[:] = np.nan
        for f, rows in enumerate(each):
            m = len(rows.residual)
            together.residual[f, :m], together.jacobian[f, :m] = rows.residual, rows.jacobian
            together.noise[f, :m, :m] = rows.noise
        return together
