"""Whether a step that was too long is a jump of the clock: the doubt and the odds against sums written in numpy."""

import numpy as np
import pytest

from relnav.estimation.clock_monitor import LATELY_S, doubt_clock, is_doubtful, learn_step, weigh_jump
from relnav.estimation.monitors import WATCH, watched_type


def watch_of(**fields):
    watch = np.zeros(1, WATCH)[0]
    for name, value in fields.items():
        watch[name] = value
    return watch


@pytest.mark.parametrize(
    ("interval", "dt", "says"), [(0.5, 5.0, False), (0.5, 5.01, True), (0.0, 9.0, False), (2.0, 9.0, False)]
)
def test_a_step_is_doubtful_beyond_ten_usual_ones(interval, dt, says):
    assert is_doubtful(watch_of(interval=interval), dt) is says


@pytest.mark.parametrize(("third", "dt", "says"), [(3.0, 7.5, False), (3.0, 7.51, True), (1.9, 5.0, False)])
def test_nor_up_to_two_and_a_half_of_the_third_longest(third, dt, says):
    assert is_doubtful(watch_of(interval=0.5, longest=90.0, second=30.0, third=third), dt) is says


@pytest.mark.parametrize(
    ("dt", "after"),
    [(1.0, (8.0, 4.0, 2.0)), (3.0, (8.0, 4.0, 3.0)), (5.0, (8.0, 5.0, 4.0)), (9.0, (9.0, 8.0, 4.0))],
)
def test_the_three_longest_steps_are_kept_and_fade(dt, after):
    """Each by 1 + dt / T in a step of dt."""
    faded = 1.0 + dt / LATELY_S
    watch = watch_of(longest=8.0 * faded, second=4.0 * faded, third=2.0 * faded)
    learn_step(watch, dt)
    assert [float(watch[name]) for name in ("longest", "second", "third")] == pytest.approx(after, rel=1e-12)


@pytest.mark.parametrize(("doubted", "left"), [(4.99, 0.0), (5.01, 5.01), (0.0, 0.0)])
def test_a_step_that_has_come_three_times_is_not_doubted_any_more(doubted, left):
    watch = watch_of(doubted=doubted, longest=9.0, second=2.0, third=2.0 * (1.0 + 1.0 / LATELY_S))
    learn_step(watch, 1.0)
    assert watch["doubted"] == pytest.approx(left, abs=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("sigmas", "doubted"), [(4.99, 0.0), (5.01, 8.0), (7.0, 8.0), (-7.0, 8.0)])
def test_a_jump_is_doubted_if_it_moves_the_position_by_five_sigma(axis, sigmas, doubted):
    root = np.random.default_rng(3).normal(size=(6, 6))
    covariance = root @ root.T
    lower = np.linalg.cholesky(covariance)
    ld = np.tril(lower / np.diag(lower), -1) + np.diag(np.diag(lower) ** 2)
    state = np.array([90.0, 90.0, 90.0, 0.0, 0.0, 0.0])
    variances = covariance.diagonal()
    sigma = np.sqrt(variances[:3] + 8.0**2 * variances[3:])  # of where it is 8 s later
    state[3 + axis] = sigmas * sigma[axis] / 8.0
    state[3 + (axis + 1) % 3] = sigma[(axis + 1) % 3] / 8.0  # one sigma
    watch = watch_of(interval=0.5, doubted=1.0, shown=2.0, along=3.0, unsure=4.0)
    doubt_clock(watch, 8.0, state, ld)
    assert (watch["doubted"], watch["shown"], watch["along"]) == (doubted, 0.0, 0.0)
    assert watch["unsure"] == pytest.approx(1.0 / sigmas**2 if doubted else 1.0 / 25.0, rel=1e-9)


def test_the_axis_that_tells_most_counts():
    watch = watch_of(interval=0.5)
    doubt_clock(watch, 8.0, np.array([0.0, 0.0, 0.0, 8.0, 16.0, 12.0]), np.eye(6))
    assert watch["unsure"] == pytest.approx((1.0 + 8.0**2) / 128.0**2)


def test_a_usual_step_leaves_the_doubt_as_it_is():
    watch = watch_of(interval=0.5, doubted=1.0, shown=2.0, along=3.0, unsure=4.0)
    doubt_clock(watch, 5.0, np.full(6, 100.0), np.eye(6))
    assert tuple(watch[name] for name in ("doubted", "shown", "along", "unsure")) == (1.0, 2.0, 3.0, 4.0)


def images(count=3):
    """Groups with three rows, two and none that is seen."""
    rng = np.random.default_rng(7)
    groups = np.zeros(count, watched_type())
    groups["rows"], groups["seen"], groups["learnt"] = (3, 2, 3), (1, 1, 0), (1, 0, 1)
    for name in ("value", "taken", "usual", "motion"):
        groups[name] = rng.normal(size=(count, 3))
    groups["noise"] = rng.uniform(0.5, 2.0, (count, 3))
    return groups


def test_the_odds_are_sums_over_what_is_seen():
    watch, groups = watch_of(doubted=2.0, along=0.25, shown=0.5, unsure=0.125, jumped=1.0), images()
    used = np.array([[1, 1, 1], [1, 1, 0], [0, 0, 0]], dtype=bool)
    usual = groups["usual"] * np.array([1, 0, 1])[:, None]
    moved = 2.0 * groups["motion"]
    along = ((groups["value"] + groups["taken"] - usual) * moved / groups["noise"])[used].sum()
    weigh_jump(watch, groups)
    assert watch["along"] == pytest.approx(0.25 + along, rel=1e-12)
    assert watch["shown"] == pytest.approx(0.5 + (moved**2 / groups["noise"])[used].sum(), rel=1e-12)
    assert watch["doubted"] == 2.0


@pytest.mark.parametrize("fields", [{"doubted": 0.0}, {"hold": 0.5}, {"pause": 0.5}])
def test_nothing_is_weighed_without_a_doubt_or_in_a_pause(fields):
    watch = watch_of(**{"doubted": 2.0, "along": 99.0} | fields)
    before = watch.copy()
    weigh_jump(watch, images())
    assert watch == before


@pytest.mark.parametrize(
    ("along", "shown", "unsure", "jumped", "jump", "doubted"),
    [
        (18.0, 4.0, 0.25, 60.0, False, 2.0),  # (18 - 2) / 2 = 8
        (18.0 + 1e-9, 4.0, 0.25, 60.0, True, 0.0),
        (-14.0, 4.0, 0.25, 60.0, False, 2.0),
        (-14.0 - 1e-9, 4.0, 0.25, 60.0, False, 0.0),
        (0.0, 4.0, 0.25, 60.5, False, 0.0),
    ],
)
def test_it_is_decided_at_e_to_the_eight_or_after_a_minute(along, shown, unsure, jumped, jump, doubted):
    watch = watch_of(doubted=2.0, along=along, shown=shown, unsure=unsure, jumped=jumped, quiet=3.0)
    weigh_jump(watch, np.zeros(1, watched_type()))
    assert tuple(watch[name] for name in ("on", "clock", "restart")) == (jump,) * 3
    assert (watch["quiet"], watch["doubted"]) == (0.0 if jump else 3.0, doubted)
