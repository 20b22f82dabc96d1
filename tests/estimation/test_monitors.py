"""The monitors' kernels one by one: means against sums over written-out weights, limits on both sides of them.

Flights with faults are in `tests/navigation/test_monitors.py`; here every number and every branch is asked for alone.
"""

import math

import numpy as np
import pytest
from scipy.stats import chi2, norm

from relnav.estimation import monitors, watched_means
from relnav.estimation.monitors import WATCH, watched_type

TINY = 2.0**-60
"""Noise that adds nothing to 1."""


def weights_of(lengths, first, time_constant):
    """Weight of every value in a mean to which each new one is given max(1 / n, dt / (dt + T)), n from `first` on."""
    weights = np.zeros(0)
    for n, dt in enumerate(lengths):
        new = max(1.0 / (n + first), dt / (dt + time_constant)) if n + first > 0 else 1.0
        weights = np.append((1.0 - new) * weights, new)
    return weights


@pytest.mark.parametrize("images", [1, 2, 3, 8, 30, 200])
def test_means_are_sums_over_all_images(filled, images):
    rng = np.random.default_rng(images)
    lengths = rng.uniform(0.1, 0.9, images)
    value, noise, state, lasting, moved = rng.normal(size=(images, 3)), *rng.uniform(0.2, 3.0, (4, images, 3))
    group = filled(watched_type(), rows=2)
    pinned, shares, squares = [], [], []
    for n, dt in enumerate(lengths):
        handed = {"value": value, "noise": noise, "state": state, "lasting": lasting, "moved": moved}
        for name, rows in handed.items():
            group[name] = rows[n]
        if n > 0:
            seen = weights_of(lengths[:n], 1, 1.0)
            variance = noise[n] + seen**2 @ noise[:n] + state[n] + seen @ state[:n] + moved[n]
            shares.append(moved[n, :2].sum() / variance[:2].sum())
            squares.append(np.mean(((value[n] - seen @ value[:n]) ** 2 / variance)[:2]))
        watched_means.take_value(group, dt, True, True)
        pinned.append((float(group["weight"]), float(group["fast_weight"])))
    fast, middle, usual = (weights_of(lengths, 1, constant) for constant in (1.0, 5.0, 20.0))
    for name, weights, rows in (
        ("fast", fast, value),
        ("middle", middle, value),
        ("usual", usual, value),
        ("fast_state", fast, state),
        ("usual_state", usual, state),
        ("usual_spread", usual, np.sqrt(lasting)),
        ("usual_white", usual**2, state),
        ("fast_white", fast**2, state),
        ("middle_white", middle**2, state),
        ("fast_noise", fast**2, noise),
        ("middle_noise", middle**2, noise),
        ("usual_noise", usual**2, noise),
    ):
        np.testing.assert_allclose(group[name][:2], (weights @ rows)[:2], rtol=1e-9, atol=1e-13, err_msg=name)
        assert group[name][2] == 0.0
    newest = [[weights_of(lengths[: n + 1], 1, constant)[-1] for constant in (20.0, 1.0)] for n in range(images)]
    np.testing.assert_allclose(pinned, newest, rtol=1e-12)
    scatter = weights_of(lengths[1:], 1, 3.0)
    assert group["scatter"] == pytest.approx(scatter @ np.array(squares) if images > 1 else 1.0)
    assert group["scatter_moved"] == pytest.approx(scatter @ np.array(shares) if images > 1 else 0.0)
    assert group["scatter_share"] == pytest.approx(scatter @ scatter if images > 1 else 1.0)
    assert (group["images"], group["learnt"]) == (images, images)


def test_what_is_usual_stays_while_nothing_is_learnt(filled):
    group = filled(watched_type(), rows=3, usual=5.0, usual_noise=0.3, weight=0.2, value=1.0, noise=1.0)
    watched_means.take_value(group, 0.1, True, False)
    assert (group["learnt"], group["weight"]) == (0, 0.2)
    assert list(group["usual_noise"]) == [0.3] * 3
    assert list(group["usual"]) == [5.0] * 3
    assert list(group["fast"]) == [1.0] * 3


def test_a_group_that_is_not_taken_stays_as_it_is(filled):
    group = filled(watched_type(), rows=3, images=4, usual=5.0, usual_noise=0.3, value=1.0, noise=1.0, fast=2.0)
    before = group.copy()
    watched_means.take_value(group, 0.1, False, True)
    assert group.tobytes() == before.tobytes()


@pytest.mark.parametrize("seed", range(12))
def test_a_shift_is_in_sigmas_of_the_difference(filled, seed):
    rng = np.random.default_rng(seed)
    names = ("state", "usual_state", "changed", "fast_white", "middle_white", "fast", "middle", "usual")
    rows = dict(zip(names, (*rng.uniform(0.5, 2.0, (5, 3)), *rng.normal(size=(3, 3))), strict=True))
    noises = dict(zip(("fast_noise", "middle_noise", "usual_noise"), rng.uniform(0.05, 0.5, (3, 3)), strict=True))
    used = 2 + seed % 2
    largest, short, long = monitors._shift(filled(watched_type(), rows=used, noise=9.0, **rows, **noises))
    apart = np.stack([rows["fast"], rows["middle"]]) - rows["usual"]
    white = np.stack([noises["fast_noise"], noises["middle_noise"]]) + noises["usual_noise"]
    state = np.maximum((rows["state"] + rows["usual_state"]) / 2, [rows["fast_white"], rows["middle_white"]])
    variance = white + state + rows["changed"]
    squares = (apart**2 / variance)[:, :used]
    assert (largest, short, long) == pytest.approx((squares.max(), *squares.sum(axis=1)), rel=1e-12)


@pytest.mark.parametrize("rows", [2, 3, 6, 12, 30])
@pytest.mark.parametrize("sigmas", [3.75, 4.75])
def test_limit_of_a_sum_is_chi_square_s(rows, sigmas):
    assert monitors._sum_limit(rows, sigmas) == pytest.approx(chi2.isf(norm.sf(sigmas), rows), rel=0.1)


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize(("state", "white"), [(2.0, 0.5), (0.5, 2.0)])
@pytest.mark.parametrize(("usual", "says"), [(12.0, False), (12.0 + 1e-9, True), (-12.0 - 1e-9, True)])
def test_what_lasts_contradicts_beyond_its_limit(filled, row, state, white, usual, says):
    """Variance 2 + 2 + 2^2 = 8, times 18 is 144."""
    group = filled(watched_type(), rows=2, usual_noise=2.0, state=state, usual_white=white, usual_spread=2.0)
    group["usual"][row] = usual
    assert monitors._contradicts(group, 18.0) is says
    group["usual"][:] = (0.0, 0.0, 1e9)  # no row
    assert not monitors._contradicts(group, 18.0)


@pytest.mark.parametrize(
    ("rows", "share", "scatter", "says"),
    [
        (2, 2.0**-6, 2.0, False),  # 8 sigma of sqrt(2 / 2 * 2^-6)
        (2, 2.0**-6, 2.0 + 1e-9, True),
        (2, 2.0**-8, 1.6, True),
        (2, 2.0**-8, 0.2, False),
        (3, 2.0**-6, 1.8, False),  # 0.816
        (3, 2.0**-6, 1.83, True),
        (1, 2.0**-7, 2.0, False),
        (1, 2.0**-7, 2.0 + 1e-9, True),
    ],
)
def test_scatter_is_noise_beyond_eight_sigma(filled, rows, share, scatter, says):
    group = filled(watched_type(), rows=rows, scatter_share=share, scatter=scatter)
    assert monitors._is_noisy(group) is says


@pytest.mark.parametrize(("scatter", "says"), [(7.0, False), (7.0 + 1e-9, True)])
def test_scatter_by_lasting_errors_is_one_error_s(filled, scatter, says):
    """8 sigma of sqrt(2 / 2 * 2^-4 + 2 * 0.5^2): 6 more than 1."""
    group = filled(watched_type(), rows=2, scatter_share=2.0**-4, scatter_moved=0.5, scatter=scatter)
    assert monitors._is_noisy(group) is says


LATE = {
    "present": 1,
    "learnt": 1,
    "images": 1,
    "fast_noise": (0.6, 0.15, 0.9),
    "usual_noise": (0.2, 0.05, 0.3),
    "state": (0.6, 1.4, 0.2),
    "usual_state": (0.8, 0.1, 0.3),
    "changed": (0.2, 0.7, 0.1),
    "fast_white": (0.6, 0.9, 0.1),
}


def test_one_delay_is_sought_by_least_squares(filled, grouped):
    rng = np.random.default_rng(2)
    one, other = ({"fast": rng.normal(size=3), "usual": rng.normal(size=3), "motion": rng.normal(size=3)} for _ in "ab")
    skipped = [LATE | other | {name: 0, "rows": 3} for name in ("present", "learnt", "images")]
    groups = grouped(LATE | one | {"rows": 3}, LATE | other | {"rows": 2}, *skipped)
    watch = filled(WATCH)
    assert not monitors._looks_late(watch, groups)
    noise = np.array(LATE["fast_noise"]) + LATE["usual_noise"]
    state = np.maximum((np.array(LATE["state"]) + LATE["usual_state"]) / 2, LATE["fast_white"])
    variance = noise + state + LATE["changed"]
    sigma = np.sqrt(np.concatenate([variance, variance[:2]]))
    motion = np.concatenate([one["motion"], other["motion"][:2]]) / sigma
    off = np.concatenate([one["fast"] - one["usual"], (other["fast"] - other["usual"])[:2]]) / sigma
    assert watch["offset"] == pytest.approx(np.linalg.lstsq(motion[:, None], off, rcond=None)[0][0], rel=1e-12)


@pytest.mark.parametrize(
    ("off", "late"),
    [
        ((4.0, 0.0), False),  # four sigma
        ((4.0 + 1e-9, 0.0), True),
        ((8.0, math.sqrt(192.0) + 1e-9), False),  # a quarter of all
        ((8.0, math.sqrt(192.0) - 1e-9), True),
        ((3.0, 0.0), False),
    ],
)
def test_late_is_what_one_delay_explains(filled, grouped, off, late):
    group = LATE | {
        "rows": 2,
        "fast_noise": TINY,
        "usual_noise": TINY,
        "state": 0.0,
        "usual_state": 0.0,
        "changed": 1.0,
        "fast_white": 0.0,
    }
    groups = grouped(group | {"fast": (*off, 0.0), "motion": (0.5, 0.0, 0.0)})
    watch = filled(WATCH)
    assert monitors._looks_late(watch, groups) is late
    assert watch["offset"] == pytest.approx(2.0 * off[0])


@pytest.mark.parametrize(("off", "late"), [(8.0, False), (8.0 + 1e-9, True)])
def test_the_state_s_error_after_a_gap_is_in_all_rows(filled, grouped, off, late):
    """Four rows of the variance 1, all of it the state's: the sum over them is off by four of its sigmas, not by two.

    Each row off by as much: along is 4 * off, its variance 4^2 by what is shared, and four of that are 16.
    """
    group = LATE | {"rows": 2, "fast_noise": 0.0, "usual_noise": 0.0, "changed": 0.0, "fast_white": 1.0}
    group |= {"state": 0.0, "usual_state": 0.0, "motion": 1.0, "fast": off / 2.0}
    groups = grouped(group, group)
    assert monitors._looks_late(filled(WATCH), groups) is late
    alone = group | {"fast_white": 0.0, "changed": 1.0}
    assert monitors._looks_late(filled(WATCH), grouped(alone, alone))  # as of noise, eight sigmas


def test_without_motion_nothing_is_late(filled, grouped):
    watch = filled(WATCH, offset=7.0)
    assert not monitors._looks_late(watch, grouped(LATE | {"rows": 3, "fast": 100.0}))
    assert watch["offset"] == 7.0


def test_a_mean_is_followed(filled):
    group = filled(watched_type(), value=(0.0, 5.0, 0.0), offset=(9.0, 1.0, 9.0))
    assert watched_means.follow(group, 1, watched_means.newest_share(3.0), True) == 4.0  # three quarters of the way
    assert list(group["offset"]) == [9.0, 4.0, 9.0]
    assert watched_means.follow(group, 2, 0.75, False) == 9.0  # not seen: nothing new of it
    assert list(group["offset"]) == [9.0, 4.0, 9.0]


@pytest.mark.parametrize(
    ("before", "dt", "after"),
    [
        ((1.0, 4.0, 3.0, 0.0), 0.5, (1.5, 3.5, 2.5, 0.5)),
        ((1.0, 0.25, 0.25, 0.5), 1.0, (2.0, 0.0, 0.0, 0.55)),
        ((1.0, 0.0, 0.0, 0.5), 1.25, (2.25, 0.0, 0.0, 0.575)),  # two and a half are usual yet
        ((1.0, 0.0, 0.0, 0.5), 1.26, (0.0, 0.0, 0.0, 0.5)),
        ((1.0, 0.0, 0.0, 2.0), 5.5, (0.0, 0.0, 0.0, 2.0)),
    ],
)
def test_a_step_is_noted(filled, before, dt, after):
    names = ("jumped", "hold", "noisy", "interval")
    watch = filled(WATCH, **dict(zip(names, before, strict=True)))
    monitors.note_step(watch, dt)
    monitors.note_image(watch, True)
    assert [float(watch[name]) for name in names] == pytest.approx(after, rel=1e-12)
    assert watch["since"] == 0.0


def test_what_is_usual_is_the_time_between_images(filled):
    """Epochs without one, as short as may be, count for nothing but the time that they take."""
    watch = filled(WATCH, interval=0.5)
    for _ in range(40):
        for dt, seen in ((0.001, False), (0.2, False), (0.299, True)):
            monitors.note_step(watch, dt)
            monitors.note_image(watch, seen)
    assert watch["interval"] == pytest.approx(0.5, rel=1e-12)
    monitors.note_image(watch, True)  # at the time of the last
    assert watch["interval"] == pytest.approx(0.5, rel=1e-12)


HERE = {"seen": 1, "present": 1, "images": 7}


@pytest.mark.parametrize(
    ("group", "other", "dt", "says", "after"),
    [
        (HERE | {"away": 1.0, "gone": 2.0}, HERE, 0.25, (False, True), (1, 7, 1.25, 0.0)),
        ({"seen": 1, "away": 9.0, "images": 7}, HERE, 0.25, (True, True), (1, 7, 0.25, 0.0)),
        (HERE | {"seen": 0, "gone": 0.25}, HERE, 0.25, (False, True), (1, 7, 0.25, 0.5)),
        (HERE | {"seen": 0, "gone": 0.5}, HERE, 0.25, (False, False), (1, 7, 0.25, 0.75)),
        (HERE | {"seen": 0, "gone": 2.75}, HERE, 0.25, (False, False), (1, 7, 0.25, 3.0)),
        (HERE | {"seen": 0, "gone": 3.0}, HERE, 0.25, (True, False), (0, 0, 0.25, 3.25)),
        (HERE | {"seen": 0, "gone": 3.0}, HERE | {"seen": 0}, 0.25, (False, False), (1, 7, 0.25, 3.0)),
        ({"gone": 3.0, "images": 7}, HERE, 0.25, (False, True), (0, 7, 0.25, 3.0)),
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_groups_come_and_go(grouped, group, other, dt, says, after, first):
    groups = grouped(group, other) if first else grouped(other, group)
    assert monitors._come_and_go(groups, dt) == says
    one = groups[0 if first else 1]
    assert tuple(one[name] for name in ("present", "images", "away", "gone")) == after
