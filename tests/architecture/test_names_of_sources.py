"""Sources are called by authors, year and title, not by numbers of our own."""

import re

NUMBER = re.compile(r"\bseed(?:'?s)?[ _-]?00\d", re.IGNORECASE)
FOLDERS = ("relnav", "models", "docs", "tests", "benchmarks", "tools", "examples")
ENDINGS = (".py", ".pyi", ".toml", ".md", ".cff", ".csv", ".typed")


def test_no_paper_has_a_number(root):
    files = [path for folder in FOLDERS for path in (root / folder).rglob("*") if path.suffix in ENDINGS]
    files += [path for path in root.iterdir() if path.suffix in ENDINGS]
    assert len(files) > 400
    lines = [
        f"{path.relative_to(root)}:{number}"
        for path in files
        for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1)
        if NUMBER.search(line)
    ]
    assert lines == []


def test_the_check_can_fail():
    told = ("seed" + " 000 eq. (13)", "Seed" + " 003's filter", "seed" + "s 001 and 002", "seed" + "_004")
    assert all(NUMBER.search(text) for text in told)
    assert not any(NUMBER.search(text) for text in ("seed 7", "seed=1000", "--seed 5", "seed: int = 0"))
