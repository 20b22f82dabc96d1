"""The theory pages' figures show what the program gives now: their numbers, kept in the PNG, are computed anew."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
pytest.importorskip("PIL", reason="pillow is not installed")

DOCS = Path(__file__).parents[2] / "docs"
LARGEST_BYTES = 120_000

spec = importlib.util.spec_from_file_location("theory_figures", DOCS / "theory_figures.py")
figures = importlib.util.module_from_spec(spec)
spec.loader.exec_module(figures)


def differing(shown, found):
    """Largest difference of any curve, in parts of its own size; infinite for other curves."""
    if [np.shape(curve) for curve in shown] != [np.shape(curve) for curve in found]:
        return np.inf
    worst = 0.0
    for before, now in zip(shown, found, strict=True):
        for a, b in zip(before, now, strict=True):
            known = np.isfinite(b)
            if not np.array_equal(known, np.isfinite(a)):
                return np.inf
            a, b = np.array(a)[known], np.array(b)[known]
            worst = max(worst, np.abs(a - b).max(initial=0.0) / max(np.abs(b).max(initial=0.0), 1e-12))
    return worst


@pytest.mark.parametrize("name", figures.FIGURES)
def test_a_figure_is_what_the_program_draws_now(name):
    path = DOCS / "theory" / f"{name}.png"
    assert path.stat().st_size < LARGEST_BYTES
    assert differing(figures.numbers_in(path), figures.made(name)[1]) < 1e-4, "python docs/theory_figures.py"
    page = (DOCS / "theory" / f"{figures.FIGURES[name][2]}.md").read_text(encoding="utf-8")
    assert f"]({name}.png)" in page


def test_a_stale_figure_is_found():
    shown = figures.numbers_in(DOCS / "theory" / "small_angle.png")
    changed = [[list(row) for row in curve] for curve in shown]
    changed[1][1][3] *= 1.01
    assert differing(shown, shown) == 0.0
    assert differing(shown, changed) > 1e-4
    assert differing(shown, changed[:-1]) == np.inf


def test_every_theory_page_of_a_system_has_a_figure():
    for page in (DOCS / "theory").glob("*.md"):
        assert page.stem == "index" or re.search(r"!\[[^]]+\]\(\w+\.png\)", page.read_text(encoding="utf-8")), page
