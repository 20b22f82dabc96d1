"""Rows of an image: the update group by group against the joint one in numpy, and whom the gate leaves out."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from relnav.estimation import rows
from relnav.estimation.rows import Observed, credible, gate_groups, group_type, log_determinant, sweep, track_type

N = 6
GATE = chi2.ppf(0.99, np.arange(1, 13))


def track_of(covariance, state=None):
    """A track, and room for another; the factors by Cholesky's."""
    track, work = np.zeros(2, track_type(N))
    lower = np.linalg.cholesky(covariance)
    track["ld"] = np.tril(lower / np.diag(lower), -1) + np.diag(np.diag(lower) ** 2)
    track["state"] = np.zeros(N) if state is None else state
    return track, work


def covariance_of(track):
    lower = np.tril(track["ld"], -1) + np.eye(N)
    return lower @ np.diag(np.diag(track["ld"])) @ lower.T


def image(rng, count, *, correlated, glints=0.0, wide=1.0):
    """Groups of two rows that see positions, their whole noise R, and the covariance of what is known before."""
    root = rng.normal(size=(N, N))
    covariance = wide * (root @ root.T + 0.1 * np.eye(N))
    groups = np.zeros(count, group_type(N))
    groups["rows"], groups["tested"] = 2, 1
    groups["gradient"][:, :2, :3] = rng.normal(size=(count, 2, 3))
    size = 2 * count
    mixed = rng.normal(size=(size, 3)) if correlated else np.zeros((size, 3))
    R = np.diag(rng.uniform(0.5, 1.5, size)) + 0.3 * mixed @ mixed.T
    H = groups["gradient"][:, :2].reshape(size, N)
    z = np.linalg.cholesky(H @ covariance @ H.T + R) @ rng.normal(size=size)
    z += np.repeat(rng.random(count) < glints, 2) * rng.normal(size=size) * 20.0
    groups["residual"][:, :2], groups["variance"][:, :2] = z.reshape(count, 2), np.diag(R).reshape(count, 2)
    scratch = np.zeros(count, group_type(N))
    for field in ("residual", "variance", "gradient", "rows", "tested"):
        scratch[field] = 7  # whatever is left of an earlier image
    empty = np.zeros((0, 0)), np.zeros((0, 0)), scratch[:0]
    return Observed(groups, *((R, np.full((size, size), 7.0), scratch) if correlated else empty)), R, covariance


def joint(seen, R, covariance, used):
    """Correction, covariance and NIS of an update with the rows that are used, at once, and log det S."""
    H, z = seen.groups["gradient"][:, :2].reshape(-1, N)[used], seen.groups["residual"][:, :2].reshape(-1)[used]
    S = H @ covariance @ H.T + R[np.ix_(used, used)]
    gain = np.linalg.solve(S, H @ covariance).T
    return gain @ z, covariance - gain @ S @ gain.T, z @ np.linalg.solve(S, z), np.linalg.slogdet(S)[1]


def used_rows(seen):
    return np.flatnonzero((np.repeat(seen.groups["tested"], 2) > 0) & (seen.groups["variance"][:, :2].reshape(-1) > 0))


@pytest.mark.parametrize("correlated", [True, False])
@pytest.mark.parametrize("left", [(), (1,), (0, 2)])
@pytest.mark.parametrize("unused", [(), ((2, 1),), ((1, 0), (2, 1))])
def test_a_sweep_is_the_joint_update(correlated, left, unused):
    rng = np.random.default_rng(len(left) + 3 * len(unused))
    seen, R, covariance = image(rng, 4, correlated=correlated)
    for g in left:
        seen.groups[g]["tested"] = 0
    for g, k in unused:
        seen.groups[g]["variance"][k] = 0.0
    state = rng.normal(size=N)
    track, work = track_of(covariance, state)
    before, used = seen.groups.copy(), used_rows(seen)
    nis, dof = sweep(track, track["state"], seen, work)
    correction, after, expected, volume = joint(seen, R, covariance, used)
    assert (nis, dof) == (pytest.approx(expected, rel=1e-9), len(used))
    np.testing.assert_allclose(work["state"], state + correction, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(covariance_of(work), after, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(track["state"], state)
    for field in ("residual", "variance", "gradient", "tested"):
        np.testing.assert_array_equal(seen.groups[field], before[field])
    spread = (seen.independent if correlated else seen.groups)["spread"][:, :2].reshape(-1)[used]
    assert np.log(spread).sum() == pytest.approx(volume, abs=1e-9)
    if correlated and not unused:
        assert log_determinant(seen) == pytest.approx(volume, abs=1e-9)


def test_groups_may_have_one_row_or_three():
    rng = np.random.default_rng(8)
    seen, _, covariance = image(rng, 2, correlated=False)
    groups = seen.groups
    groups["rows"] = 1, 3
    groups["gradient"][1, 2, :3], groups["variance"][1] = rng.normal(size=3), (1.0, 2.0, 3.0)
    groups["residual"][1, 2] = 2.0
    H = np.vstack([groups["gradient"][0, :1], groups["gradient"][1]])
    z = np.array([groups["residual"][0, 0], *groups["residual"][1]])
    variance = [groups["variance"][0, 0], 1.0, 2.0, 3.0]
    track, work = track_of(covariance)
    nis, dof = sweep(track, track["state"], seen, work)
    S = H @ covariance @ H.T + np.diag(variance)
    assert (nis, dof) == (pytest.approx(z @ np.linalg.solve(S, z), rel=1e-9), 4)
    np.testing.assert_allclose(work["state"], covariance @ H.T @ np.linalg.solve(S, z), atol=1e-9)


@pytest.mark.parametrize("correlated", [True, False])
def test_rows_are_linearised_where_they_are_told(correlated):
    """Residuals z - h(at): the update from the track is that of z - h(at) - H (x - at)."""
    rng = np.random.default_rng(9)
    seen, R, covariance = image(rng, 3, correlated=correlated)
    state, at = rng.normal(size=(2, N))
    track, work = track_of(covariance, state)
    sweep(track, at, seen, work)
    seen.groups["residual"][:, :2] -= (seen.groups["gradient"] @ (state - at))[:, :2]
    correction = joint(seen, R, covariance, np.arange(6))[0]
    np.testing.assert_allclose(work["state"], state + correction, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("off", [1.0, 1.0 + 1e-9])
def test_a_noise_that_is_no_covariance_takes_nothing_in(off):
    seen, R, covariance = image(np.random.default_rng(1), 2, correlated=True)
    R[:] = np.eye(4)
    R[3, 1] = R[1, 3] = off
    track, work = track_of(covariance, np.ones(N))
    assert sweep(track, track["state"], seen, work) == (math.inf, 1)
    np.testing.assert_array_equal(work["state"], track["state"])
    assert not credible(track, seen, np.full(12, 1e300), work)[0]
    seen.groups[0]["variance"][1] = 0.0
    assert sweep(track, track["state"], seen, work)[1] == 3


def test_one_number_at_its_limit_is_credible():
    seen, _, _ = image(np.random.default_rng(1), 1, correlated=False)
    group = seen.groups[0]
    group["gradient"], group["variance"], group["residual"] = np.zeros((3, N)), (3.0, 0.0, 0.0), (2.0, 9.0, 9.0)
    group["gradient"][0, 0] = 1.0
    track, work = track_of(np.eye(N))
    assert credible(track, seen, np.array([1.0]), work) == (True, 1.0)
    assert credible(track, seen, np.array([1.0 - 1e-9]), work) == (False, 1.0)
    group["variance"] = 0.0
    assert credible(track, seen, np.array([1.0]), work) == (False, 0.0)


@pytest.mark.parametrize("correlated", [True, False])
def test_a_group_alone_has_its_own_chi_square(correlated):
    seen, R, covariance = image(np.random.default_rng(4), 3, correlated=correlated)
    track, _ = track_of(covariance)
    for g in range(3):
        alone, numbers = rows._alone(track["ld"], seen, g)
        assert (alone, numbers) == (pytest.approx(joint(seen, R, covariance, [2 * g, 2 * g + 1])[2], rel=1e-9), 2)
    for k in range(2):
        seen.groups[1]["variance"][:2] = np.where(np.arange(2) == k, R[2 + k, 2 + k], 0.0)
        alone, numbers = rows._alone(track["ld"], seen, 1)
        assert (alone, numbers) == (pytest.approx(joint(seen, R, covariance, [2 + k])[2], rel=1e-9), 1)
    seen.groups[1]["variance"] = 0.0
    assert rows._alone(track["ld"], seen, 1) == (0.0, 0)


def believed(seen, R, covariance):
    """Whom to believe, from the words of the rule; all NIS of joint covariances. And by which way it was told."""

    def nis(several):
        return joint(seen, R, covariance, [row for g in several for row in (2 * g, 2 * g + 1)])[2]

    def good(several):
        return nis(several) <= GATE[2 * len(several) - 1]

    everyone = range(len(seen.groups))
    left = [g for g in everyone if good([g])]
    if not left or good(left):
        return left, "all" if len(left) == len(everyone) else "none" if not left else "alone"
    while len(left) > 2:
        smaller = [[g for g in left if g != out] for out in left]
        agreeing = sum(good(several) for several in smaller)
        left = min(smaller, key=nis)
        if agreeing == 1 or (agreeing > 1 and len(left) > 2):
            return left, f"{len(smaller[0])} of {len(smaller)}"
    return [], "contradictory"


@pytest.mark.parametrize("correlated", [True, False])
def test_the_gate_believes_whom_the_rule_names(correlated):
    ways = set()
    for seed in range(100):
        rng = np.random.default_rng(seed)
        count = int(rng.integers(2, 6))
        seen, R, covariance = image(rng, count, correlated=correlated, glints=0.5, wide=float(rng.choice([1.0, 300.0])))
        track, work = track_of(covariance)
        whom, way = believed(seen, R, covariance)
        nis, dof = sweep(track, track["state"], seen, work)
        before = seen.groups["variance"].copy()
        assert gate_groups(track, seen, GATE, work, nis, dof) == len(whom), (seed, way)
        np.testing.assert_array_equal(np.flatnonzero(seen.groups["tested"]), whom)
        told = correlated or np.isin(np.arange(count), whom)[:, None]
        np.testing.assert_array_equal(seen.groups["variance"], np.where(told, before, 0.0))
        if whom:
            used = [row for g in whom for row in (2 * g, 2 * g + 1)]
            correction, after, _, _ = joint(seen, R, covariance, used)
            np.testing.assert_allclose(work["state"], correction, rtol=0.0, atol=1e-7)
            np.testing.assert_allclose(covariance_of(work), after, rtol=0.0, atol=1e-7)
        ways.add(way)
    assert ways >= {"all", "none", "alone", "contradictory", "2 of 3", "3 of 4", "4 of 5"}


@pytest.mark.parametrize(("nis", "passing"), [(4.0, 1), (4.0 + 1e-9, 0)])
def test_a_group_that_is_all_there_is(nis, passing):
    seen, _, covariance = image(np.random.default_rng(1), 1, correlated=False)
    track, work = track_of(covariance)
    assert gate_groups(track, seen, np.array([1.0, 4.0, 9.0]), work, nis, 2) == passing
    assert seen.groups["tested"][0] == passing


@pytest.mark.parametrize(("residual", "limit", "passing"), [(2.0, 2.0, 2), (2.0 + 1e-9, 2.0, 1), (2.0, 1.0, 0)])
def test_groups_at_their_limit_are_credible(residual, limit, passing):
    """Squared innovations of one each, of two together; the third group has no numbers."""
    seen, _, _ = image(np.random.default_rng(1), 3, correlated=False)
    groups = seen.groups
    groups["gradient"], groups["variance"], groups["residual"] = 0.0, 3.0, 0.0
    groups["gradient"][0, 0, 0] = groups["gradient"][1, 0, 1] = 1.0
    groups["residual"][:2, 0], groups["variance"][2] = (2.0, residual), 0.0
    track, work = track_of(np.eye(N))
    nis, dof = sweep(track, track["state"], seen, work)
    assert dof == 4
    assert gate_groups(track, seen, np.array([9.0, 1.0, 9.0, limit]), work, nis, dof) == passing
    assert groups["tested"].sum() == passing


def test_the_noise_of_what_is_not_used_is_not_asked_for():
    """Rows of groups that are left out, and single ones, may have any covariance in R."""
    seen, R, covariance = image(np.random.default_rng(6), 3, correlated=True)
    seen.groups[1]["tested"], seen.groups[2]["variance"][0] = 0, 0.0
    used = [0, 1, 5]
    track, work = track_of(covariance)
    R[2:5] = R[:, 2:5] = np.nan
    nis, dof = sweep(track, track["state"], seen, work)
    assert (nis, dof) == (pytest.approx(joint(seen, R, covariance, used)[2], rel=1e-9), 3)


def test_rows_are_copied():
    source, target = np.arange(1.0, 7.0).reshape(2, 3), np.zeros((2, 3))
    rows.copy_rows(source, target)
    np.testing.assert_array_equal(target, source)


@pytest.mark.parametrize("correlated", [True, False])
def test_a_group_that_is_left_out_has_no_noise_that_could_be_used(correlated):
    """Of independent rows: what reads an image after the gate goes by the variances alone."""
    rng = np.random.default_rng(8)
    seen, _, covariance = image(rng, 3, correlated=correlated)
    seen.groups[1]["residual"][:2] += 200.0
    track, work = track_of(covariance)
    before = seen.groups["variance"].copy()
    nis, dof = sweep(track, track["state"], seen, work)
    assert gate_groups(track, seen, GATE, work, nis, dof) == 2
    assert seen.groups["tested"].tolist() == [1, 0, 1]
    if not correlated:
        before[1, :2] = 0.0
    np.testing.assert_array_equal(seen.groups["variance"], before)
