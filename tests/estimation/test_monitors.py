"""The monitors' kernels one by one: means against sums over written-out weights, limits on both sides of them.

Flights with faults are in `tests/navigation/test_monitors.py`; here every number and every branch is asked for alone.
"""

import math

import numpy as np
import pytest
from scipy.stats import chi2, norm

from relnav.estimation import monitors
from relnav.estimation.monitors import WATCH, watch_image, watch_start, watched_type, write_alarm

TINY = 2.0**-60
"""Noise that adds nothing to 1."""


def filled(dtype, **fields):
    """A record of zeros but for some fields."""
    one = np.zeros(1, dtype)[0]
    for name, value in fields.items():
        one[name] = value
    return one


def grouped(*several):
    """Groups, each from its fields."""
    groups = np.zeros(len(several), watched_type())
    for g, fields in enumerate(several):
        for name, value in fields.items():
            groups[g][name] = value
    return groups


def weights_of(lengths, first, time_constant):
    """Weight of every value in a mean to which each new one is given max(1 / n, dt / (dt + T)), n from `first` on."""
    weights = np.zeros(0)
    for n, dt in enumerate(lengths):
        new = max(1.0 / (n + first), dt / (dt + time_constant)) if n + first > 0 else 1.0
        weights = np.append((1.0 - new) * weights, new)
    return weights


@pytest.mark.parametrize("images", [1, 2, 3, 8, 30, 200])
def test_means_are_sums_over_all_images(images):
    rng = np.random.default_rng(images)
    lengths = rng.uniform(0.1, 0.9, images)
    value, noise, state, lasting = rng.normal(size=(images, 3)), *rng.uniform(0.2, 3.0, (3, images, 3))
    group = filled(watched_type(), rows=2)
    pinned, squares = [], []
    for n, dt in enumerate(lengths):
        for name, rows in (("value", value), ("noise", noise), ("state", state), ("lasting", lasting)):
            group[name] = rows[n]
        if n > 0:
            seen = weights_of(lengths[:n], 1, 1.0)
            variance = noise[n] * (1.0 + seen @ seen) + state[n] + seen @ state[:n]
            squares.append(np.mean(((value[n] - seen @ value[:n]) ** 2 / variance)[:2]))
        monitors._take(group, dt, True)
        pinned.append(float(group["weight"]))
    fast, middle, usual = (weights_of(lengths, 1, constant) for constant in (1.0, 5.0, 20.0))
    for name, weights, rows in (
        ("fast", fast, value),
        ("middle", middle, value),
        ("usual", usual, value),
        ("fast_state", fast, state),
        ("usual_state", usual, state),
        ("usual_spread", usual, np.sqrt(lasting)),
        ("usual_white", usual**2, state),
    ):
        np.testing.assert_allclose(group[name][:2], (weights @ rows)[:2], rtol=1e-9, atol=1e-13, err_msg=name)
        assert group[name][2] == 0.0
    for name, weights in (("fast_share", fast), ("middle_share", middle), ("usual_share", usual)):
        assert group[name] == pytest.approx(weights @ weights, rel=1e-12)
    assert pinned == pytest.approx([weights_of(lengths[: n + 1], 1, 20.0)[-1] for n in range(images)])
    scatter = weights_of(lengths[1:], 1, 3.0)
    assert group["scatter"] == pytest.approx(scatter @ np.array(squares) if images > 1 else 1.0)
    assert group["scatter_share"] == pytest.approx(scatter @ scatter if images > 1 else 1.0)
    assert (group["images"], group["learnt"]) == (images, images)


def test_what_is_usual_stays_while_nothing_is_learnt():
    group = filled(watched_type(), rows=3, usual=5.0, usual_share=0.3, weight=0.2, value=1.0, noise=1.0)
    monitors._take(group, 0.1, False)
    assert (group["learnt"], group["usual_share"], group["weight"]) == (0, 0.3, 0.2)
    assert list(group["usual"]) == [5.0] * 3
    assert list(group["fast"]) == [1.0] * 3


@pytest.mark.parametrize("seed", range(12))
def test_a_shift_is_in_sigmas_of_the_difference(seed):
    rng = np.random.default_rng(seed)
    names = ("noise", "state", "usual_state", "changed", "fast", "middle", "usual")
    rows = dict(zip(names, (*rng.uniform(0.5, 2.0, (4, 3)), *rng.normal(size=(3, 3))), strict=True))
    shares = {"fast_share": 0.4, "middle_share": 0.15, "usual_share": 0.07}
    used = 2 + seed % 2
    largest, short, long = monitors._shift(filled(watched_type(), rows=used, **rows, **shares))
    apart = np.stack([rows["fast"], rows["middle"]]) - rows["usual"]
    variance = np.array([[0.47], [0.22]]) * rows["noise"] + (rows["state"] + rows["usual_state"]) / 2 + rows["changed"]
    squares = (apart**2 / variance)[:, :used]
    assert (largest, short, long) == pytest.approx((squares.max(), *squares.sum(axis=1)), rel=1e-12)


@pytest.mark.parametrize("rows", [2, 3, 6, 12, 30])
@pytest.mark.parametrize("sigmas", [3.75, 4.75])
def test_limit_of_a_sum_is_chi_square_s(rows, sigmas):
    assert monitors._sum_limit(rows, sigmas) == pytest.approx(chi2.isf(norm.sf(sigmas), rows), rel=0.1)


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize(("state", "white"), [(2.0, 0.5), (0.5, 2.0)])
@pytest.mark.parametrize(("usual", "says"), [(12.0, False), (12.0 + 1e-9, True), (-12.0 - 1e-9, True)])
def test_what_lasts_contradicts_beyond_its_limit(row, state, white, usual, says):
    """Variance 4 * 0.5 + 2 + 2^2 = 8, times 18 is 144."""
    group = filled(watched_type(), rows=2, noise=4.0, usual_share=0.5, state=state, usual_white=white, usual_spread=2.0)
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
def test_scatter_is_noise_beyond_eight_sigma(rows, share, scatter, says):
    group = filled(watched_type(), rows=rows, scatter_share=share, scatter=scatter)
    assert monitors._is_noisy(group) is says


LATE = {
    "present": 1,
    "learnt": 1,
    "images": 1,
    "noise": (2.0, 0.5, 3.0),
    "fast_share": 0.3,
    "usual_share": 0.1,
    "state": (0.6, 1.4, 0.2),
    "usual_state": (0.8, 0.1, 0.3),
    "changed": (0.2, 0.7, 0.1),
}


def test_one_delay_is_sought_by_least_squares():
    rng = np.random.default_rng(2)
    one, other = ({"fast": rng.normal(size=3), "usual": rng.normal(size=3), "motion": rng.normal(size=3)} for _ in "ab")
    skipped = [LATE | other | {name: 0, "rows": 3} for name in ("present", "learnt", "images")]
    groups = grouped(LATE | one | {"rows": 3}, LATE | other | {"rows": 2}, *skipped)
    watch = filled(WATCH)
    assert not monitors._looks_late(watch, groups)
    variance = 0.4 * np.array(LATE["noise"]) + (np.array(LATE["state"]) + LATE["usual_state"]) / 2 + LATE["changed"]
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
def test_late_is_what_one_delay_explains(off, late):
    group = LATE | {"rows": 2, "noise": TINY, "state": 0.0, "usual_state": 0.0, "changed": 1.0}
    groups = grouped(group | {"fast": (*off, 0.0), "motion": (0.5, 0.0, 0.0)})
    watch = filled(WATCH)
    assert monitors._looks_late(watch, groups) is late
    assert watch["offset"] == pytest.approx(2.0 * off[0])


def test_without_motion_nothing_is_late():
    watch = filled(WATCH, offset=7.0)
    assert not monitors._looks_late(watch, grouped(LATE | {"rows": 3, "fast": 100.0}))
    assert watch["offset"] == 7.0


def test_a_mean_is_followed():
    group = filled(watched_type(), value=(0.0, 5.0, 0.0), offset=(9.0, 1.0, 9.0))
    assert monitors.follow(group, 1, 3.0) == 4.0  # three quarters of the way
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
def test_a_step_is_noted(before, dt, after):
    names = ("jumped", "hold", "noisy", "interval")
    watch = filled(WATCH, **dict(zip(names, before, strict=True)))
    monitors.note_step(watch, dt)
    assert [float(watch[name]) for name in names] == pytest.approx(after, rel=1e-12)


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
def test_groups_come_and_go(group, other, dt, says, after, first):
    groups = grouped(group, other) if first else grouped(other, group)
    assert monitors._come_and_go(groups, dt) == says
    one = groups[0 if first else 1]
    assert tuple(one[name] for name in ("present", "images", "away", "gone")) == after


def every(value=3):
    """All of a watch, each field the same."""
    return filled(WATCH, **dict.fromkeys(WATCH.names, value))


def now(watch, *names):
    return {name: float(watch[name]) for name in (names or WATCH.names)}


def test_a_first_start_forgets():
    watch, groups = every(), grouped(HERE | {"learnt": 5}, HERE | {"learnt": 5})
    watch_start(watch, groups, False, True)
    kept = dict.fromkeys(("quiet", "offset", "unsure", "shown", "along"), 3.0)
    assert now(watch) == dict.fromkeys(WATCH.names, 0.0) | kept | {"jumped": math.inf}
    assert list(groups["images"]) == list(groups["learnt"]) == [0, 0]


@pytest.mark.parametrize(
    ("fields", "comparable", "after"),
    [
        ({"age": 10.5}, True, {"alarm": 32, "learnt": 5}),
        ({"age": 10.0}, True, {"alarm": 32, "learnt": 0, "age": 0.0}),
        ({"age": 10.5}, False, {"alarm": 32, "learnt": 0, "age": 0.0}),
        ({"age": 10.5, "clock": 1}, True, {"alarm": 48, "clock": 1}),
        ({"age": 10.5, "jumped": 5.0}, True, {"alarm": 32, "clock": 0}),
        ({"age": 10.5, "jumped": 4.75}, True, {"alarm": 48, "clock": 1}),
        ({"age": 9.0, "jumped": 4.75}, True, {"alarm": 48, "clock": 1, "learnt": 0, "age": 0.0}),
        ({"age": 10.5, "restart": 1}, True, {"contradicted": 0.0, "noisy": 0.0, "unproven": 10.0}),
        ({"age": 10.5, "restart": 1, "contradicted": 0.0}, True, {"contradicted": 0.0, "unproven": 0.0, "noisy": 0.0}),
        ({"age": 10.5, "restart": 1, "contradicted": 0.5}, True, {"contradicted": 0.0, "unproven": 10.0, "noisy": 0.0}),
    ],
)
def test_a_start_after_another_keeps_what_can_be_compared(fields, comparable, after):
    before = {"jumped": 9.0, "contradicted": 2.0, "noisy": 2.0, "unproven": 2.0, "on": 1, "quiet": 2.0, "doubted": 2.0}
    before |= {"pulled": 1, "returned": 1, "offset": 4.0} | fields
    watch, groups = filled(WATCH, **before), grouped(HERE | {"learnt": 5}, HERE | {"learnt": 5})
    watch_start(watch, groups, True, comparable)
    made = now(watch) | {"learnt": float(groups["learnt"][1])}
    cleared = dict.fromkeys(("on", "quiet", "restart", "doubted", "pulled", "returned"), 0.0)
    assert made == filled_in(before | {"learnt": 5, "clock": 0}) | cleared | {"hold": 10.0, "alarm": 32} | after
    assert list(groups["images"]) == [0, 0]


def filled_in(fields):
    return dict.fromkeys(WATCH.names, 0.0) | fields


@pytest.mark.parametrize(
    ("field", "bits"),
    [
        ("on", 1),
        ("contradicted", 2),
        ("unproven", 2),
        ("noisy", 4),
        ("clock", 16),
        ("doubted", 16),
        ("hold", 32),
        ("restart", 0),
    ],
)
def test_an_alarm_is_written(field, bits):
    watch = filled(WATCH, alarm=127, **{field: 1 if WATCH[field].kind == "i" else 0.5})
    write_alarm(watch)
    assert watch["alarm"] == bits
    watch = every()
    write_alarm(watch)
    assert watch["alarm"] == 55


STEADY = HERE | {"rows": 1, "images": 10**9, "learnt": 10**9, "noise": TINY, "changed": 1.0, "scatter": 1.0}
"""Of a group that says the same for ever, with a variance of 1 between the means."""


def apart(*off, **more):
    """A group whose means are so far from what they were."""
    rows = (*off, 0.0, 0.0)[:3]
    return STEADY | {"rows": len(off), "value": rows, "fast": rows, "middle": rows} | more


def seen_once(watch, *several, dt=0.5):
    groups = grouped(*several)
    watch_image(watch, groups, dt)
    return groups


@pytest.mark.parametrize(
    ("fields", "off", "shifted"),
    [
        ({"hold": 1.0}, (5.0,), False),
        ({"hold": 1.0}, (5.0 + 1e-9,), True),
        ({"hold": 1.0, "age": 10.0}, (9.0,), False),
        ({"on": 1}, (4.0,), False),
        ({"on": 1}, (-4.0 - 1e-9,), True),
        ({"on": 1}, (2.5, 2.5, 2.5), False),  # 18.75 of 21.8
        ({"on": 1}, (2.8, 2.8, 2.8), True),
        ({"hold": 1.0}, (3.2, 3.2, 3.2), False),  # 30.7 of 32.5
        ({"hold": 1.0}, (3.4, 3.4, 3.4), True),
    ],
)
def test_a_shift_is_said_beyond_its_limit(fields, off, shifted):
    watch = filled(WATCH, **{"age": 10.5, "jumped": 9.0, "quiet": 2.0} | fields)
    seen_once(watch, apart(*off))
    was = fields.get("on", 0)
    assert watch["quiet"] == (0.0 if shifted else 2.5 if was else 2.0)
    assert (watch["on"], watch["restart"]) == (max(was, shifted), 0)
    assert watch["alarm"] == (1 if watch["on"] else 0) + (32 if "hold" in fields else 0)


@pytest.mark.parametrize(("mean", "value"), [("fast", 0.0), ("middle", 0.0)])
def test_each_mean_counts(mean, value):
    """The other one lies where it lay; five rows of two groups, 25 of 26.5, or 31."""
    for size, shifted in ((2.24, 2.5), (2.5, 0.0)):
        watch = filled(WATCH, age=10.5, jumped=9.0, on=1, quiet=2.0)
        rest = {"fast": value, "middle": value, "value": value} | {mean: size}
        one, other = apart(0.0, 0.0, 0.0) | rest, apart(0.0, 0.0) | rest
        seen_once(watch, one, other, dt=1e-9)
        assert watch["quiet"] == pytest.approx(shifted and 2.0)


@pytest.mark.parametrize(("learnt", "shifted"), [(0, False), (1, True)])
def test_one_image_is_enough_to_be_compared_with(learnt, shifted):
    watch = filled(WATCH, age=10.5, jumped=9.0, hold=1.0)
    seen_once(watch, apart(5.5, learnt=learnt))
    assert watch["on"] == shifted


def test_nothing_seen_is_nothing_said():
    watch = filled(WATCH, age=10.5, jumped=9.0)
    groups = seen_once(watch, apart(9.0, seen=0))
    assert now(watch) == filled_in({"age": 10.5, "jumped": 9.0})
    assert tuple(groups[0][name] for name in ("images", "away", "weight")) == (10**9, 0.5, 0.0)


@pytest.mark.parametrize(
    ("fields", "age"),
    [({}, 3.5), ({"on": 1}, 3.0), ({"hold": 0.5}, 3.0), ({"doubted": 0.5}, 3.0), ({"unproven": 2.0}, 3.5)],
)
def test_it_learns_where_nothing_is_wrong(fields, age):
    watch = filled(WATCH, **{"age": 3.0} | fields)
    groups = seen_once(watch, apart(0.0, away=0.5, weight=0.75))
    assert (watch["age"], groups["images"][0], groups["away"][0]) == (age, 10**9 + 1, 0.0)
    assert groups["learnt"][0] == 10**9 + (age > 3.0)
    assert groups["weight"][0] == pytest.approx(1.0 / 21.0 if age > 3.0 else 0.0)
    assert watch["unproven"] == max(0.0, fields.get("unproven", 0.0) - 0.5)


@pytest.mark.parametrize(
    ("fields", "forgets"), [({}, True), ({"on": 1}, False), ({"hold": 0.5}, False), ({"on": 1, "hold": 0.5}, False)]
)
def test_a_group_that_comes_is_learnt_anew_unless_there_is_an_alarm(fields, forgets):
    watch = filled(WATCH, age=3.0, **fields)
    groups = seen_once(watch, apart(0.0), apart(0.0, present=0))
    assert watch["age"] == (0.5 if forgets else 3.0)
    assert list(groups["learnt"]) == [1 if forgets else 10**9] * 2


def test_a_pause_takes_nothing_in():
    watch = filled(WATCH, age=3.0, pause=0.75)
    for left, age, images in ((0.25, 0.0, 0), (-0.25, 0.0, 0), (-0.25, 0.5, 10**9 + 1)):
        groups = seen_once(watch, apart(0.0))
        assert (watch["pause"], watch["age"], groups["images"][0]) == (left, age, images)


@pytest.mark.parametrize(
    ("fields", "usual", "learnt", "left"),
    [
        ({}, 4.49, 10, 0.0),
        ({}, 4.51, 10, 99.5),
        ({}, 4.51, 9, 0.0),
        ({"unproven": 1.0}, 2.49, 10, 0.0),
        ({"unproven": 1.0}, 2.51, 10, 99.5),
        ({"contradicted": 1.0}, 2.49, 10, 0.5),
        ({"contradicted": 1.0}, 2.51, 10, 99.5),
        ({"contradicted": 0.75}, 2.51, 10, 99.5),
    ],
)
def test_it_contradicts_from_ten_images_on(fields, usual, learnt, left):
    """Variance 1; on: nothing is learnt meanwhile."""
    watch = filled(WATCH, on=1, **fields)
    seen_once(watch, apart(usual, usual=(usual, 0.0, 0.0), usual_spread=1.0, learnt=learnt))
    assert watch["contradicted"] == left
    assert watch["alarm"] == 1 + (2 if left or "unproven" in fields else 0)


@pytest.mark.parametrize(
    ("fields", "left", "restart"),
    [
        ({"contradicted": 0.75}, 0.25, 0),
        ({"contradicted": 0.5}, 0.5, 1),
        ({"contradicted": 0.25}, 0.25, 1),
        ({"contradicted": 0.0}, 0.0, 0),
        ({"contradicted": 0.75, "pause": 1.0}, 0.75, 0),
        ({"contradicted": 0.25, "pause": 1.0}, 0.25, 0),
    ],
)
def test_after_a_contradiction_it_asks_for_a_start(fields, left, restart):
    watch = filled(WATCH, **fields)
    seen_once(watch, apart(0.0))
    assert (watch["contradicted"], watch["restart"]) == (left, restart)


@pytest.mark.parametrize(("images", "scatter", "noisy"), [(9, 2.0, 3.0), (8, 2.0, 0.0), (9, 1.0, 0.0), (40, 2.0, 3.0)])
def test_scatter_is_judged_from_ten_images_on(images, scatter, noisy):
    watch = filled(WATCH, on=1)
    seen_once(watch, apart(0.0, images=images, scatter=10.0 * scatter if scatter > 1.0 else 1.0), dt=0.01)
    assert (watch["noisy"], watch["alarm"]) == (noisy, 5 if noisy else 1)


@pytest.mark.parametrize(
    ("fields", "more", "clock"),
    [
        ({}, {}, 1),
        ({"jumped": 5.0}, {}, 0),
        ({"jumped": 4.75}, {}, 1),
        ({"hold": 0.5}, {}, 0),
        ({"age": 10.0}, {}, 0),
        ({}, {"motion": 0.0}, 0),
    ],
)
def test_a_late_image_is_the_clock_s(fields, more, clock):
    """4.5 sigma: late beyond four, no shift below five."""
    watch = filled(WATCH, **{"age": 10.5, "jumped": 1.0, "quiet": 4.0} | fields)
    seen_once(watch, apart(4.5, motion=1.0, usual_spread=1.0) | more, dt=1e-6)
    assert (watch["clock"], watch["on"], watch["restart"]) == (clock, clock, clock)
    assert watch["quiet"] == (0.0 if clock else 4.0)
    assert watch["alarm"] == 17 * clock + (32 if "hold" in fields else 0)


@pytest.mark.parametrize(
    ("fields", "after"),
    [
        ({"quiet": 4.5}, {"quiet": 5.0, "restart": 0}),
        ({"quiet": 4.75}, {"quiet": 5.25, "restart": 1}),
        ({"quiet": 4.75, "pause": 1.0}, {"quiet": 4.75, "restart": 0}),
        ({"quiet": 4.75, "on": 0}, {"quiet": 4.75, "restart": 0}),
        ({"clock": 1}, {"clock": 1}),
        ({"clock": 1, "on": 0}, {"clock": 0}),
        ({"clock": 1, "on": 0, "hold": 0.5}, {"clock": 1}),
    ],
)
def test_an_alarm_ends_after_five_quiet_seconds(fields, after):
    watch = filled(WATCH, **{"age": 10.5, "jumped": 9.0, "on": 1} | fields)
    seen_once(watch, apart(1.0))
    assert now(watch, *after) == after
