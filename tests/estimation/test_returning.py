"""A pair of rows that was refused for long: whether what comes back is good."""

import numpy as np
import pytest

from relnav.estimation.returning import LONG_S, RETURNING, SURPRISE, note_pair, returns_wrong

VARIANCE, GRADIENT = np.array([4.0, 1.0]), np.zeros((2, 6))
LD = np.eye(6)


def refused(off, images):
    """What is known of a pair whose residual was `off` in every image, a second apart, and refused."""
    known = np.zeros(1, dtype=RETURNING)[0]
    for _ in range(images):
        note_pair(known, LD, GRADIENT, VARIANCE, 0.0, np.array(off), True)
        assert not returns_wrong(known, False, True, 1.0)
    return known


@pytest.mark.parametrize(
    ("back", "wrong"),
    [
        ((0.0, 0.0), False),
        ((2.0, 1.0), False),  # chi-square 2
        ((-7.0, 0.0), True),  # 12.25
        ((0.0, 4.0), True),  # 16
        ((6.0, 0.0), True),  # 9, but where it was refused
    ],
)
def test_it_is_wrong_where_it_surprises_or_lies_where_it_lay(back, wrong):
    known = refused((20.0, 0.0), 5)
    note_pair(known, LD, GRADIENT, VARIANCE, 0.0, np.array(back), True)
    assert returns_wrong(known, True, False, 1.0) == wrong
    assert known["refused"] == 0.0


def test_nothing_is_said_of_one_that_was_refused_for_short():
    known = refused((20.0, 0.0), int(LONG_S))
    note_pair(known, LD, GRADIENT, VARIANCE, 0.0, np.array([19.0, 0.0]), True)
    assert not returns_wrong(known, True, False, 1.0)


def test_of_one_that_is_not_seen_nothing_is_noted():
    known = refused((20.0, 0.0), 5)
    before = known.copy()
    note_pair(known, LD, GRADIENT, VARIANCE, 0.0, np.array([0.0, 0.0]), False)
    assert known == before


def test_surprise_is_the_chi_square_of_the_pair():
    rng, n = np.random.default_rng(5), 6
    a = rng.normal(size=(n, n))
    covariance, h, residual = a @ a.T, rng.normal(size=(2, n)), np.array([-3.0, 1.0])
    h[:, 3:] = 0.0  # nothing is seen of a velocity
    lower = np.linalg.cholesky(covariance)
    ld = np.ascontiguousarray(lower / np.diag(lower))
    ld[np.diag_indices(n)] = np.diag(lower) ** 2
    known = refused((0.0, 0.0), 5)
    note_pair(known, ld, h, VARIANCE, 0.5, residual, True)
    innovation = h @ covariance @ h.T + np.array([[4.0, 0.5], [0.5, 1.0]])
    assert known["surprise"] == pytest.approx(residual @ np.linalg.solve(innovation, residual), rel=1e-9)
    assert pytest.approx(9.2103, abs=1e-4) == SURPRISE


@pytest.mark.parametrize(
    ("refused", "images"), [(0.0, [(2.0, -1.0)]), (0.5, [(2.0, -1.0)]), (0.5, [(2.0, -1.0), (5.0, 3.0)])]
)
def test_what_a_refused_pair_is_off_is_remembered(refused, images):
    """One that is not refused: the latest alone. Else each new one has a fifth."""
    known = np.zeros(1, dtype=RETURNING)[0]
    known["refused"], known["off"] = refused, (10.0, 20.0)
    expected = np.array([10.0, 20.0])
    for residual in images:
        note_pair(known, LD, GRADIENT, VARIANCE, 0.0, np.array(residual), True)
        expected = 0.8 * expected + 0.2 * np.array(residual) if refused else np.array(residual)
    assert tuple(known["off"]) == pytest.approx(tuple(expected), rel=1e-12)
    assert known["surprise"] == 0.0  # not refused for long


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("share", "surprising"), [(0.25, False), (0.25 + 1e-9, True), (-0.5, False)])
def test_a_quarter_of_what_it_was_off_may_be_noise(axis, share, surprising):
    known = np.zeros(1, dtype=RETURNING)[0]
    known["refused"], known["off"][axis] = 3.5, 2.0
    residual = np.zeros(2)
    residual[axis] = 2.0 * share
    note_pair(known, LD, GRADIENT, VARIANCE, 0.0, residual, True)
    assert np.isinf(known["surprise"]) == surprising


@pytest.mark.parametrize(
    ("refused", "surprise", "wrong"),
    [(3.0, 99.0, False), (3.01, 99.0, True), (3.01, 9.21, False), (3.01, 9.22, True), (99.0, SURPRISE, False)],
)
def test_what_returns_is_wrong_beyond_its_limits(refused, surprise, wrong):
    known = np.zeros(1, dtype=RETURNING)[0]
    known["refused"], known["surprise"] = refused, surprise
    assert not returns_wrong(known, False, False, 0.5)
    assert known["refused"] == refused
    assert not returns_wrong(known, False, True, 0.0)
    assert returns_wrong(known, True, True, 0.5) == wrong
    assert known["refused"] == 0.0
    returns_wrong(known, False, True, 0.5)
    assert known["refused"] == 0.5
