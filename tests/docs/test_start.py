"""The quick start does what it says: its blocks run word for word, and its table names every extra."""

import importlib.util
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
SPEC = importlib.util.spec_from_file_location("first_hour", ROOT / "benchmarks" / "first_hour.py")
first_hour = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(first_hour)
PAGE = (ROOT / "docs" / "start.md").read_text(encoding="utf-8")


def test_every_block_but_the_installation_runs(tmp_path):
    """In an empty folder with the examples beside it, by the command of this environment."""
    (heading, install), *rest = first_hour.blocks(PAGE)
    assert "Install" in heading
    assert "pip install ." in install
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "bin").mkdir()
    command = tmp_path / "bin" / "relnav"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m relnav "$@"\n')
    command.chmod(0o755)
    path = f"{command.parent}{os.pathsep}{os.environ['PATH']}"
    for heading, code in rest:
        done = subprocess.run(
            ["sh", "-ec", code],
            cwd=tmp_path,
            env=os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
        )
        assert done.returncode == 0, f"{heading}: {done.stderr}"
    for name in (first_hour.PLOT, first_hour.VEHICLE):
        assert (tmp_path / name).stat().st_size > 1000, name
    changed = (tmp_path / "my_vehicle.toml").read_text().splitlines()
    shipped = (tmp_path / "my_vehicle.toml.bak").read_text().splitlines()
    assert sum(a != b for a, b in zip(changed, shipped, strict=True)) == 2


def test_every_extra_is_explained():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    table = PAGE.partition("| extra | brings |")[2].partition("\n\n")[0]
    assert sorted(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == sorted(declared)


def test_an_extra_brings_what_the_page_says():
    """`formats` is all of the extras above it; what the page names is what the extra installs."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]

    def packages(extra):
        found = set()
        for line in declared[extra]:
            inner = re.fullmatch(r"relnav\[([\w,]+)\]", line)
            found |= set().union(*map(packages, inner[1].split(","))) if inner else {re.match(r"[\w.-]+", line)[0]}
        return found

    table = PAGE.partition("| extra | brings |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|", table, re.MULTILINE)
    above = [extra for extra, _ in rows[: [extra for extra, _ in rows].index("formats")]]
    assert set().union(*map(packages, above)) == packages("formats")
    assert packages("cluster") >= packages("parquet")
    for extra, package in {
        "parquet": "pyarrow", "pandas": "pandas", "xarray": "xarray", "netcdf": "h5netcdf", "mcap": "mcap",
        "ros": "rosbags", "spice": "spiceypy", "images": "pillow", "cluster": "distributed", "docs": "sphinx",
    }.items():  # fmt: skip
        assert package in packages(extra)
    assert set().union(*map(packages, ("formats", "images", "docs", "cluster", "oracles"))) <= packages("dev")


def test_version_and_pythons_are_said_alike():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    version = project["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1] == version
    pythons = re.findall(r"Python :: (3\.\d+)", " ".join(project["classifiers"]))
    assert project["requires-python"] == f">={pythons[0]}"
    tried = re.search(r"^VERSIONS = \((.*)\)", (ROOT / "benchmarks" / "python_versions.py").read_text(), re.MULTILINE)
    assert pythons == re.findall(r"[\d.]+", tried[1]) == ["3.11", "3.12", "3.13", "3.14"]
