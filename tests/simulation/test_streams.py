"""Random numbers by seed, run, stream and place: numpy's own words, exact quantiles, nothing shared between runs."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtri

from relnav.simulation.streams import Draws, Stream, _root, _sizes

WORD = st.integers(min_value=0, max_value=2**64 - 1)


def numpys(seed, run, stream, count):
    """The same words by numpy's Philox, as numbers between 0 and 1."""
    key = np.array([seed, run], dtype=np.uint64)
    words = np.random.Philox(key=key, counter=[0, 0, 0, stream]).random_raw(count)
    return ((words >> np.uint64(12)).astype(np.float64) + 0.5) / 2.0**52


@settings(derandomize=True, max_examples=25, deadline=None)
@given(WORD, WORD, st.sampled_from(Stream), st.integers(min_value=1, max_value=9))
def test_words_are_those_of_numpy(seed, run, stream, count):
    drawn = Draws(seed, run).uniforms(stream, (count,))
    assert np.array_equal(drawn, numpys(seed, run, stream, count))


def test_normal_numbers_are_exact_quantiles():
    """SciPy's ndtri, another algorithm, to 4e-15; all of the middle and both tails are there."""
    draws = Draws(3, 1)
    u, z = (draw(Stream.MOTION, (2000,)) for draw in (draws.uniforms, draws.normals))
    assert u.min() < 5e-3
    assert u.max() > 1.0 - 5e-3
    np.testing.assert_allclose(z, ndtri(u), rtol=4e-15, atol=1e-16)


def test_far_tails_are_exact_quantiles():
    """Down to the smallest number that is drawn, 2^-53, and beyond."""
    shares = np.geomspace(1e-16, 0.07, 60)
    below, above = (np.array([_root(p) for p in places]) for places in (shares, 1.0 - shares))
    near = below[below < 5.0]
    for sizes in (below, above, near):
        _sizes(sizes)
    np.testing.assert_allclose(below, -ndtri(shares), rtol=4e-15)
    np.testing.assert_array_equal(near, below[-len(near) :])
    for p, size in zip(shares, above, strict=True):
        assert size == pytest.approx(-ndtri(1.0 - (1.0 - p)), rel=1e-9 if p < 1e-7 else 1e-12)


def test_a_number_depends_on_its_place_alone():
    """The beginning of a longer stream is the shorter one, and what else was drawn does not matter."""
    alone = Draws(5, 6).normals(Stream.SPOT_NOISE, (6,))
    draws = Draws(5, 6)
    draws.uniforms(Stream.GLINT, (7,))
    assert np.array_equal(draws.normals(Stream.SPOT_NOISE, (3, 4)).ravel()[:6], alone)


def test_numbers_are_had_by_their_places():
    draws = Draws(5, 6)
    whole, places = draws.uniforms(Stream.GLINT_PLACE, (40,)), np.array([39, 0, 1, 2, 3, 4, 17, 17])
    assert np.array_equal(draws.uniforms_at(Stream.GLINT_PLACE, places), whole[places])
    assert len(draws.uniforms_at(Stream.GLINT_PLACE, places[:0])) == 0


@settings(derandomize=True, max_examples=40, deadline=None)
@given(
    st.integers(min_value=0, max_value=23), st.integers(min_value=0, max_value=23), st.sampled_from([0.0, 0.3, 0.999])
)
def test_what_is_below_a_probability(count, number, probability):
    """Also where it is the number itself, which is not below itself, or the next one."""
    draws = Draws(11, 12)
    numbers = draws.uniforms(Stream.DROPOUT, (24,))
    for limit in (probability, numbers[number], np.nextafter(numbers[number], 1.0)):
        expected = np.flatnonzero(numbers[:count] < limit)
        assert np.array_equal(draws.below(Stream.DROPOUT, count, float(limit)), expected)


def test_runs_that_an_affine_rule_would_repeat():
    """By seed * 1000003 + run, run 1000003 of seed 7 would be run 0 of seed 8."""
    one, two = Draws(7, 1_000_003), Draws(8, 0)
    assert not np.array_equal(one.uniforms(Stream.START, (9,)), two.uniforms(Stream.START, (9,)))


def test_neighbours_are_independent():
    """Correlations of neighbours in seed, run and stream, times the root of the length, are standard normal.

    60 pairs of 256 numbers: mean within 4 / sqrt(60), deviation within 4 / sqrt(120) of 1.
    """
    n, found = 256, []
    for seed, run, stream in itertools.product((1, 2), (0, 1, 2, 3, 4), (Stream.MOTION, Stream.SPOT_NOISE)):
        z = Draws(seed, run).normals(stream, (n,))
        neighbours = (Draws(seed, run + 1), stream), (Draws(seed + 1, run), stream), (Draws(seed, run), stream + 1)
        found += [float(z @ draws.normals(other, (n,))) / np.sqrt(n) for draws, other in neighbours]
    assert len(found) == 60
    assert abs(np.mean(found)) < 4.0 / np.sqrt(60)
    assert abs(np.std(found) - 1.0) < 4.0 / np.sqrt(120)


@pytest.mark.parametrize(("seed", "run"), [(-1, 0), (0, -1), (2**64, 0)])
def test_what_is_no_word_is_refused(seed, run):
    with pytest.raises(ValueError, match="is 0 or more and below 2\\^64"):
        Draws(seed, run)
