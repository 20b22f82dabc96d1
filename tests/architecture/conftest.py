"""The checkout, and a wheel built from it once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def root():
    return ROOT


@pytest.fixture(scope="session")
def sources():
    """Every Python file of the package."""
    return sorted((ROOT / "relnav").rglob("*.py"))


@pytest.fixture(scope="session")
def tool():
    """tool(name, *arguments) -> a development tool that stands beside this Python, run over the checkout."""

    def call(name, *arguments):
        command = [Path(sys.executable).with_name(name), *arguments]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)

    return call


@pytest.fixture(scope="session")
def python():
    """python(code, *arguments, path, environment, **options) -> the code run by a fresh interpreter."""

    def call(code, *arguments, path=ROOT, environment=None, **options):
        variables = os.environ | {"PYTHONPATH": str(path)} | (environment or {})
        command = [sys.executable, "-c", code, *(str(argument) for argument in arguments)]
        defaults = {"capture_output": True, "text": True, "timeout": 300}
        return subprocess.run(command, check=False, env=variables, **(defaults | options))

    return call


@pytest.fixture(scope="session")
def distributions(tmp_path_factory):
    """Folder with the sdist and the wheel made from it, as `python -m build` makes them."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    pure = os.environ | {"RELNAV_PREBUILD": "0"}  # compiling takes a minute: test_prebuilt.py
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, env=pure)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder
