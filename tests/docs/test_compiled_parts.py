"""What the installation is said to compile is what it compiles."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    "page", ["README.md", "docs/start.md", "docs/troubleshooting.md", "docs/live.md", "CHANGELOG.md"]
)
def test_the_parts_are_named(page):
    line = next(line for line in (ROOT / "hatch_build.py").read_text("utf-8").splitlines() if "FLIGHTS = " in line)
    said = re.findall(r"filters of (\w+) and of (\w+)", " ".join((ROOT / page).read_text("utf-8").split()))
    assert said
    assert all(set(pair) == set(re.findall(r'"(\w+)"', line)) for pair in said)
