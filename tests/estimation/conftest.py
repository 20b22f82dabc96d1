"""One place that knows the scratch of the time update."""

from collections.abc import Callable

import numpy as np
import pytest

from relnav.estimation.factored import time_update_into


@pytest.fixture(scope="session")
def time_update() -> Callable[[np.ndarray, np.ndarray, np.ndarray], None]:
    """(ud, phi, factors of Q): replaces ud in place."""
    return lambda ud, phi, q_ud: time_update_into(ud, phi, q_ud, np.zeros((12, 6)), np.zeros((2, 6)))
