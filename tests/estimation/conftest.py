"""One place that knows the scratch of the time update."""

from collections.abc import Callable

import numpy as np
import pytest

from relnav.estimation.factored import time_update_into


@pytest.fixture(scope="session")
def time_update() -> Callable[[np.ndarray, np.ndarray, np.ndarray], None]:
    """(ud, phi, factors of Q): replaces ud in place."""
    return time_update_into
