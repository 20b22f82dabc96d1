"""The command line, called in this process (`run`) or as a program (`program`)."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import relnav.cli

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def vbar_log():
    return ROOT / "examples" / "basilisk_approach" / "vbar_log.csv"


@pytest.fixture
def short_log(tmp_path, vbar_log):
    """The first twenty seconds of the example."""
    path = tmp_path / "short.csv"
    path.write_text("".join(vbar_log.read_text().splitlines(keepends=True)[:201]))
    return path


@pytest.fixture
def run(capsys):
    """run(*arguments) -> (exit code, standard output, standard error)."""

    def call(*arguments):
        code = relnav.cli.run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def program(tmp_path):
    """program(*arguments, **options of subprocess.run) -> what came of `python -m relnav ...`, output piped."""

    def call(*arguments, environment=None, **options):
        command = [sys.executable, "-m", "relnav", *(str(argument) for argument in arguments)]
        defaults = {"capture_output": True, "text": True, "timeout": 120, "cwd": tmp_path}
        return subprocess.run(command, check=False, env=os.environ | (environment or {}), **(defaults | options))

    return call
