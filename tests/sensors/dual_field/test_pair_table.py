"""Pair tables and the K-vector as properties: against all pairs by brute force, at every kind of range."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.sensors.dual_field.pair_table import CROWDED, build_pair_table, k_range

TABLE_ONE = (0.0, np.radians(14.0))
TABLE_TWO = (np.radians(76.0), np.radians(104.0))


def sphere(seed, n=300):
    v = np.random.default_rng(seed).normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def brute_force(v, low, high):
    cosine = np.einsum("ik,jk->ij", v, v)
    i, j = np.nonzero((cosine >= np.cos(high)) & (cosine <= np.cos(low)))
    return {(a, b) for a, b in zip(i.tolist(), j.tolist(), strict=True) if a < b}


def as_set(pairs):
    return {(min(a, b), max(a, b)) for a, b in pairs.tolist()}


@pytest.mark.parametrize("bounds", [TABLE_ONE, TABLE_TWO, (0.1, 0.9), (0.0, np.pi)])
def test_it_holds_all_pairs_of_its_range_once(bounds):
    v = sphere(1)
    table = build_pair_table(v, *bounds)
    assert as_set(table.stars) == brute_force(v, *bounds)
    assert len(as_set(table.stars)) == len(table)
    assert np.all(np.diff(table.cos) >= 0.0)


def test_crowded_stars_have_room_too():
    """Ten times as many pairs as were all stars spread evenly."""
    v = sphere(3) * (0.1, 0.1, 0.1) + (1.0, 0.0, 0.0)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    table = build_pair_table(v, *TABLE_ONE)
    assert len(table) > 10 * CROWDED * 0.25 * len(v) ** 2 * (1.0 - np.cos(TABLE_ONE[1]))
    assert as_set(table.stars) == brute_force(v, *TABLE_ONE)
    assert np.all(np.diff(table.cos) >= 0.0)


def test_stars_are_called_by_their_names():
    v, names = sphere(4, 40), np.random.default_rng(4).permutation(1000)[:40].astype(np.int32)
    rows, named = build_pair_table(v, *TABLE_TWO), build_pair_table(v, *TABLE_TWO, names)
    assert np.array_equal(named.stars, names[rows.stars])


@settings(derandomize=True, max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 50),
    two=st.booleans(),
    where=st.floats(-0.1, 1.1),
    width=st.sampled_from([0.0, 1e-9, 1e-5, 1e-3, 0.05, 2.0]),
)
def test_a_query_is_what_brute_force_finds(seed, two, where, width):
    low, high = TABLE_TWO if two else TABLE_ONE
    v = sphere(seed, 120)
    table = build_pair_table(v, low, high)
    middle = low + where * (high - low)
    a, b = max(0.0, middle - width), min(np.pi, middle + width)
    if a > b:
        a = b
    chosen = (table.cos >= np.cos(b)) & (table.cos <= np.cos(a))
    assert as_set(table.query(a, b)) == as_set(table.stars[chosen])


@settings(derandomize=True, max_examples=60, deadline=None)
@given(
    values=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=40), low=st.floats(-1.2, 1.2), high=st.floats(-1.2, 1.2)
)
def test_the_k_vector_bounds_hold_for_any_values(values, low, high):
    """Ties, clusters and single values included: the range found is that of a plain comparison."""
    y = np.sort(np.array(values))
    line = np.array([y[0], max(y[-1] - y[0], 1e-15) / len(y)])
    k = np.searchsorted(y, line[0] + line[1] * np.arange(len(y) + 1), side="right").astype(np.int32)
    first, last = k_range(y, k, line, low, high)
    inside = np.flatnonzero((y >= low) & (y <= high))
    assert list(range(first, last)) == inside.tolist()


def test_the_two_tables_have_the_sizes_of_theory(sensor):
    """N^2/4 (1 - cos F) and N^2/2 sin F pairs; table two is some ten times larger."""
    v = sensor.catalogue.directions(2026.0, stars=slice(0, 2000))
    one, two = build_pair_table(v, *TABLE_ONE), build_pair_table(v, *TABLE_TWO)
    n, width = 2000, np.radians(14.0)
    assert len(one) == pytest.approx(n**2 / 4 * (1 - np.cos(width)), rel=0.25)  # bright stars crowd
    assert len(two) == pytest.approx(n**2 / 2 * np.sin(width), rel=0.1)


def test_an_impossible_range_is_refused():
    with pytest.raises(ValueError, match="0 <= low < high <= pi"):
        build_pair_table(sphere(1, 5), 0.3, 0.2)


def test_no_pairs_is_a_table_too():
    table = build_pair_table(np.eye(3), 0.1, 0.2)
    assert len(table) == 0
    assert table.query(0.1, 0.2).shape == (0, 2)
