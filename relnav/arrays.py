"""Names for arrays: float64 throughout, the shape said in words because the type system cannot hold it."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Vector: TypeAlias = NDArray[np.float64]
"""One axis: a position (3,), a state (6,), values over epochs (n,)."""

Matrix: TypeAlias = NDArray[np.float64]
"""Two axes: a rotation (3, 3), a covariance (6, 6), spots (3, 2)."""

Stack: TypeAlias = NDArray[np.float64]
"""Three axes: one matrix an epoch, (n, 6, 6)."""

Flags: TypeAlias = NDArray[np.bool_]
"""One truth value an epoch, (n,)."""

Codes: TypeAlias = NDArray[np.int64]
"""One small integer an epoch, (n,)."""

Record: TypeAlias = Any
"""One record of a structured type, or an array of them: fields by name (`record["state"]`)."""
