"""The documentation builds as a site without network, every warning an error, and its generated pages are complete."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest

import relnav
from relnav.cli import COMMANDS

ROOT = Path(__file__).parents[2]
NEEDED = ("sphinx", "myst_parser", "numpydoc", "furo")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        pytest.skip(f"not installed: {', '.join(missing)}; pip install 'relnav[docs]'")
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-nW", "--keep-going", "-q", "-d", str(out / "made"), "docs", str(out)]
    variables = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=600, env=variables)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def returned_classes():
    """Classes that calls give out, as the page's maker finds them (`docs/_ext/generated.py`)."""
    sys.path.insert(0, str(ROOT / "docs" / "_ext"))
    try:
        import generated
    finally:
        sys.path.pop(0)
    return generated.returned()


@pytest.fixture(scope="module")
def text(site):
    """text(page) -> the page's HTML without its tags."""
    return lambda page: unescape(re.sub(r"<[^>]+>", "", (site / page).read_text(encoding="utf-8")))


def test_every_public_name_is_there(text):
    page = text("reference/python.html")
    for name in relnav.__all__:
        assert re.search(rf"relnav\.(sensors\.)?{name}\b", page), name
    for cls in returned_classes():
        assert f"relnav.{cls.__name__}" in page or f"{cls.__module__}.{cls.__name__}" in page, cls
    assert "Raises" in page
    assert "system message" not in page.lower()


def test_every_command_is_there(text):
    page = text("reference/commands.html")
    for name in [*COMMANDS, "stars solve", "calibrate psd", "sun measure"]:
        assert f"Usage: relnav {name} " in page, name


def test_every_key_is_there(text):
    page = text("reference/keys.html")
    for key in ("focal_length_m", "mirror_normal", "glass_index", "bias_walk_rad_s_sqrt_s", "axis_polar_rad"):
        assert key in page, key
    shipped = text("reference/shipped.html")
    for name in relnav.list_models():
        assert relnav.load_model(name).title in shipped, name


def test_every_message_is_there(text):
    page = text("reference/messages.html")
    for message in (
        'method must be "spots" or "fix"; got ...',
        "cells separated by commas are expected in the header; got ...",
        "the folder ... does not exist; make it, or write elsewhere",
    ):
        assert message in page, message
    assert page.count("(ValueError)") > 200
    assert page.count("Error)") > 450


def test_notebooks_are_offered(site):
    for page in (ROOT / "docs" / "tutorials").glob("*.md"):
        if page.stem != "index":
            assert f'href="{page.stem}.ipynb"' in (site / "tutorials" / f"{page.stem}.html").read_text(encoding="utf-8")
            assert json.loads((site / "tutorials" / f"{page.stem}.ipynb").read_text(encoding="utf-8"))["nbformat"] == 4


def test_formulas_are_mathml_and_nothing_comes_from_elsewhere(site):
    page = (site / "theory" / "three_beacon.html").read_text(encoding="utf-8")
    assert page.count("<math ") > 15
    assert re.search(r'<mo lspace="[^"]+" rspace="[^"]+">sin</mo>', page)  # not as a product of variables
    assert re.findall(r'class="eqno">([^<]+)<', page)[:3] == ["(1) to (3)", "(4) to (6)", "(7), (8)"]
    for path in site.rglob("*.html"):
        loaded = re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="(https?:[^"]*)"', path.read_text(encoding="utf-8"))
        assert loaded == [], path
