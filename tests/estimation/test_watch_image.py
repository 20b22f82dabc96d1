"""Starts, images and alarms of the monitors: each branch of what an image changes, asked for alone."""

import math

import pytest

from relnav.estimation.monitors import WATCH, watch_image, watch_start, write_alarm

TINY = 2.0**-60
"""Noise that adds nothing to 1."""

HERE = {"seen": 1, "present": 1, "images": 7}


EVERY = dict.fromkeys(WATCH.names, 3)


def now(watch, *names):
    return {name: float(watch[name]) for name in (names or WATCH.names)}


def test_a_first_start_forgets(filled, grouped):
    watch, groups = filled(WATCH, **EVERY), grouped(HERE | {"learnt": 5}, HERE | {"learnt": 5})
    watch_start(watch, groups, False, True)
    kept = dict.fromkeys(("quiet", "offset", "unsure", "shown", "along"), 3.0)
    kept |= dict.fromkeys(("judged", "over", "over_noise", "refusing"), 3.0)  # of what is refused: `refusals.py`
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
def test_a_start_after_another_keeps_what_can_be_compared(filled, grouped, fields, comparable, after):
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
def test_an_alarm_is_written(filled, field, bits):
    watch = filled(WATCH, alarm=127, **{field: 1 if WATCH[field].kind == "i" else 0.5})
    write_alarm(watch)
    assert watch["alarm"] == bits
    watch = filled(WATCH, **EVERY)
    write_alarm(watch)
    assert watch["alarm"] == 55


STEADY = HERE | {"rows": 1, "images": 10**9, "learnt": 10**9, "noise": TINY, "changed": 1.0, "scatter": 1.0}
"""Of a group that says the same for ever, with a variance of 1 between the means."""


def apart(*off, **more):
    """A group whose means are so far from what they were."""
    rows = (*off, 0.0, 0.0)[:3]
    return STEADY | {"rows": len(off), "value": rows, "fast": rows, "middle": rows} | more


@pytest.fixture
def seen_once(grouped):
    """What becomes of groups in one image."""

    def look(watch, *several, dt=0.5):
        groups = grouped(*several)
        watch_image(watch, groups, dt)
        return groups

    return look


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
def test_a_shift_is_said_beyond_its_limit(filled, seen_once, fields, off, shifted):
    watch = filled(WATCH, **{"age": 10.5, "jumped": 9.0, "quiet": 2.0} | fields)
    seen_once(watch, apart(*off))
    was = fields.get("on", 0)
    assert watch["quiet"] == (0.0 if shifted else 2.5 if was else 2.0)
    assert (watch["on"], watch["restart"]) == (max(was, shifted), 0)
    assert watch["alarm"] == (1 if watch["on"] else 0) + (32 if "hold" in fields else 0)


@pytest.mark.parametrize(("mean", "value"), [("fast", 0.0), ("middle", 0.0)])
def test_each_mean_counts(filled, seen_once, mean, value):
    """The other one lies where it lay; five rows of two groups, 25 of 26.5, or 31."""
    for size, shifted in ((2.24, 2.5), (2.5, 0.0)):
        watch = filled(WATCH, age=10.5, jumped=9.0, on=1, quiet=2.0)
        rest = {"fast": value, "middle": value, "value": value} | {mean: size}
        one, other = apart(0.0, 0.0, 0.0) | rest, apart(0.0, 0.0) | rest
        seen_once(watch, one, other, dt=1e-9)
        assert watch["quiet"] == pytest.approx(shifted and 2.0)


@pytest.mark.parametrize(("learnt", "shifted"), [(0, False), (1, True)])
def test_one_image_is_enough_to_be_compared_with(filled, seen_once, learnt, shifted):
    watch = filled(WATCH, age=10.5, jumped=9.0, hold=1.0)
    seen_once(watch, apart(5.5, learnt=learnt))
    assert watch["on"] == shifted


def test_nothing_seen_is_nothing_said(filled, seen_once):
    watch = filled(WATCH, age=10.5, jumped=9.0)
    groups = seen_once(watch, apart(9.0, seen=0))
    assert now(watch) == filled_in({"age": 10.5, "jumped": 9.0})
    assert tuple(groups[0][name] for name in ("images", "away", "weight")) == (10**9, 0.5, 0.0)


@pytest.mark.parametrize(
    ("fields", "age"),
    [({}, 3.5), ({"on": 1}, 3.0), ({"hold": 0.5}, 3.0), ({"doubted": 0.5}, 3.0), ({"unproven": 2.0}, 3.5)],
)
def test_it_learns_where_nothing_is_wrong(filled, seen_once, fields, age):
    watch = filled(WATCH, **{"age": 3.0} | fields)
    groups = seen_once(watch, apart(0.0, away=0.5, weight=0.75))
    assert (watch["age"], groups["images"][0], groups["away"][0]) == (age, 10**9 + 1, 0.0)
    assert groups["learnt"][0] == 10**9 + (age > 3.0)
    assert groups["weight"][0] == pytest.approx(1.0 / 21.0 if age > 3.0 else 0.0)
    assert watch["unproven"] == max(0.0, fields.get("unproven", 0.0) - 0.5)


@pytest.mark.parametrize(
    ("fields", "forgets"), [({}, True), ({"on": 1}, False), ({"hold": 0.5}, False), ({"on": 1, "hold": 0.5}, False)]
)
def test_a_group_that_comes_is_learnt_anew_unless_there_is_an_alarm(filled, seen_once, fields, forgets):
    watch = filled(WATCH, age=3.0, **fields)
    groups = seen_once(watch, apart(0.0), apart(0.0, present=0))
    assert watch["age"] == (0.5 if forgets else 3.0)
    assert list(groups["learnt"]) == [1 if forgets else 10**9] * 2


def test_a_pause_takes_nothing_in(filled, seen_once):
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
def test_it_contradicts_from_ten_images_on(filled, seen_once, fields, usual, learnt, left):
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
def test_after_a_contradiction_it_asks_for_a_start(filled, seen_once, fields, left, restart):
    watch = filled(WATCH, **fields)
    seen_once(watch, apart(0.0))
    assert (watch["contradicted"], watch["restart"]) == (left, restart)


@pytest.mark.parametrize(("images", "scatter", "noisy"), [(9, 2.0, 3.0), (8, 2.0, 0.0), (9, 1.0, 0.0), (40, 2.0, 3.0)])
def test_scatter_is_judged_from_ten_images_on(filled, seen_once, images, scatter, noisy):
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
def test_a_late_image_is_the_clock_s(filled, seen_once, fields, more, clock):
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
def test_an_alarm_ends_after_five_quiet_seconds(filled, seen_once, fields, after):
    watch = filled(WATCH, **{"age": 10.5, "jumped": 9.0, "on": 1} | fields)
    seen_once(watch, apart(1.0))
    assert now(watch, *after) == after
