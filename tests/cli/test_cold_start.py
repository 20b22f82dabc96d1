"""A short log on a machine that has compiled nothing yet: plain Python at once, and the same track."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import relnav

MODEL = ["--model", "three_beacon_psd"]


@pytest.fixture
def fresh(tmp_path):
    """A copy of the package that has never been compiled, and its own home; fresh(code, **options)."""
    root = Path(relnav.__file__).parents[1]
    skip = shutil.ignore_patterns("__pycache__")
    shutil.copytree(root / "relnav", tmp_path / "site" / "relnav", ignore=skip)
    shutil.copytree(root / "models", tmp_path / "site" / "models")

    def call(*arguments):
        code = f"import sys; sys.path.insert(0, {str(tmp_path / 'site')!r}); import relnav.cli as c; "
        code += "code = c.run(sys.argv[1:]); print('numba' in sys.modules, file=sys.stderr); sys.exit(code)"
        environment = {"HOME": str(tmp_path / "home"), "PATH": "/usr/bin:/bin"}
        command = [sys.executable, "-c", code, *map(str, arguments)]
        return subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)

    return call


def test_short_log_needs_no_compiler(fresh, short_log, tmp_path, run):
    done = fresh("filter", short_log, *MODEL, "--out", tmp_path / "cold.csv")
    assert done.returncode == 0, done.stderr
    assert done.stderr.strip() == "False"
    assert run("filter", short_log, *MODEL, "--out", tmp_path / "warm.csv")[0] == 0
    cold, warm = (
        np.genfromtxt([line for line in (tmp_path / name).read_text().splitlines() if line[0] != "#"], delimiter=",")
        for name in ("cold.csv", "warm.csv")
    )
    assert np.allclose(cold, warm, rtol=1e-9, atol=1e-15, equal_nan=True)


def test_at_hand_only_under_the_stamp_of_this_version(monkeypatch, tmp_path):
    from relnav.codegen import store

    monkeypatch.setattr(store, "folder", lambda: tmp_path)
    monkeypatch.setattr(store, "SHIPPED", tmp_path / "none")
    assert not store.at_hand("some.kernel")
    monkeypatch.setattr(store, "code_stamp", lambda: "abc")
    store.save(store.Code("some.kernel", "float", "f", [], (b"code",)))
    assert store.at_hand("some.kernel")
    assert not store.at_hand("some.kernel", "another.kernel")
    monkeypatch.setattr(store, "code_stamp", lambda: "xyz")
    assert not store.at_hand("some.kernel")
