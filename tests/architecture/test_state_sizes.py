"""The size of a filter's state stands in one place (`dynamics/error_state.py`, `estimation/state_layout.py`).

No loop, no shape and no slice of the filters says six or twelve by itself.
"""

import io
import re
import tokenize

import pytest

ROOMS = {"navigation", "estimation", "vehicle"}
BARE = re.compile(
    r"range\((6|12|21|78)\)|\(6, 6\)|\(12, 12\)|[(,] ?(6|12|21),?\)|\[6:9\]|\[:6\]|\[6:\]|\[9:\]|\[:12\]"
    r"|(zeros|empty|eye)\((6|12)\)|_F, (6|12)\)"
)


def code_lines(text):
    """Lines without strings and comments."""
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.STRING, tokenize.COMMENT):
            first, last = token.start[0] - 1, token.end[0] - 1
            if first == last:
                lines[first] = lines[first].replace(token.string, "")
            else:
                lines[first : last + 1] = [""] * (last + 1 - first)
    return lines


def bare_sizes(text):
    return [line.strip() for line in code_lines(text) if BARE.search(line)]


def test_no_bare_size(sources):
    """`reference/` says its own, as it shares nothing with the filters that it is held against."""
    found = {
        str(path): lines
        for path in sources
        if ROOMS & set(path.parts) and "reference" not in path.parts and (lines := bare_sizes(path.read_text()))
    }
    assert found == {}


BAD = ["for i in range(6):", "x = np.zeros((12, 12))", "@straight_line(state=(6,))", "e[6:9]", '("state", _F, 6),']


@pytest.mark.parametrize("line", BAD)
def test_what_a_bare_size_is(line):
    assert len(bare_sizes(line)) == 1


def test_what_is_none():
    assert bare_sizes('for i in range(3):  # range(6)\n    """(6, 6)"""\n    x = np.zeros((3, 3))\n') == []
