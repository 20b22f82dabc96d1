"""Readings that repeat: counted from the second on, and told after ten repeats."""

import numpy as np
import pytest

from relnav.estimation.monitors import watched_type
from relnav.estimation.repeated_reading import repeats


def test_ten_repeats_are_told_and_timed():
    group = np.zeros(1, watched_type())[0]
    told = [repeats(group, 1.5, -2.5, 0.25) for _ in range(13)]
    assert told == [False] * 10 + [True] * 3
    assert (group["repeated"], group["since"], tuple(group["reading"])) == (12, 3.0, (1.5, -2.5))


@pytest.mark.parametrize("other", [(1.5, -2.0), (1.0, -2.5)])
def test_any_change_begins_anew(other):
    group = np.zeros(1, watched_type())[0]
    for _ in range(12):
        repeats(group, 1.5, -2.5, 0.25)
    assert not repeats(group, *other, 0.25)
    assert (group["repeated"], group["since"], tuple(group["reading"])) == (0, 0.0, other)
