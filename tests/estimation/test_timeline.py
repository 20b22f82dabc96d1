"""Events by their times: late ones inserted, others found by their very time, old ones forgotten."""

from relnav.estimation.timeline import Timeline


def add(state, event):
    """A state is the text of all events so far."""
    return state + event, f"<{state}{event}>"


def filled():
    line = Timeline("", 0.0)
    results = [line.insert(t, event, add) for t, event in ((1.0, "a"), (3.0, "c"), (2.0, "b"), (3.0, "d"))]
    return line, results


def test_a_late_one_stands_where_it_belongs():
    line, results = filled()
    assert results == ["<a>", "<ac>", "<ab>", "<abcd>"]
    assert [one.state for one in line.passed] == ["a", "ab", "abc", "abcd"]
    assert line.last_s == 3.0
    assert Timeline("", 0.5).last_s == 0.5


def test_one_that_is_done_already_stands_last():
    line, _ = filled()
    line.append(3.0, "e", "abcde", "<abcde>")
    assert line.insert(2.5, "x", add) == "<abx>"
    assert line.passed[-1] == ("e", "abxcde", "<abxcde>")


def test_found_by_its_very_time():
    line, _ = filled()
    assert [line.number(t) for t in (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)] == [None, 0, None, 1, 2, None]
    assert [line.following(t) for t in (0.5, 1.0, 2.5, 3.0)] == ["a", "b", "c", None]


def test_replaced_what_follows_is_done_again():
    line, _ = filled()
    assert line.replace(1, "B", add) == "<aB>"
    assert [one.state for one in line.passed] == ["a", "aB", "aBc", "aBcd"]


def test_what_is_forgotten_is_the_new_start():
    line, _ = filled()
    assert line.forget(1.0) == []
    assert (line.start, line.start_s) == ("", 0.0)
    assert [one.event for one in line.forget(3.0)] == ["a", "b"]
    assert (line.start, line.start_s, line.times) == ("ab", 2.0, [3.0, 3.0])
    assert line.insert(2.5, "x", add) == "<abx>"


def test_states_that_are_not_kept_are_made_again():
    line, done = Timeline("", 0.0), []

    def again(state, event):
        done.append(event)
        return add(state, event)

    for k, event in enumerate("abcdef"):
        line.insert(0.5 * k, event, add)
    line.thin(2.0, 1.0)
    assert [one.state for one in line.passed] == ["a", None, "abc", None, "abcde", "abcdef"]
    assert line.state_before(4, again) == "abcd"
    assert line.state_before(6, again) == "abcdef"
    assert done == ["d"]
    line.thin(2.0, 1.0)
    assert line.insert(0.5, "x", add, at=2) == "<abx>"
    assert [one.state for one in line.passed] == ["a", "ab", "abx", "abxc", "abxcd", "abxcde", "abxcdef"]
    line.redo(5, lambda state, event: add(state, event.upper()))
    assert line.passed[-1].state == "abxcdEF"


def test_the_start_is_a_state_that_is_kept():
    line = Timeline("", 0.0)
    for k, event in enumerate("abcd"):
        line.insert(0.5 * k, event, add)
    line.thin(1.5, 1.0)
    assert [one.event for one in line.forget(0.9)] == ["a"]  # "ab" is not kept
    assert (line.start, line.start_s, line.times) == ("a", 0.0, [0.5, 1.0, 1.5])
    assert line.state_before(3, add) == "abcd"
