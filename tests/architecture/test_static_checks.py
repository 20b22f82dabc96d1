"""Import rules, style and types, by the tools that the project is held to."""

import pytest


def test_imports_point_down(tool):
    done = tool("lint-imports", "--no-cache")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout


@pytest.mark.parametrize("arguments", [["check", "--no-cache"], ["format", "--check", "--no-cache"]])
def test_ruff(tool, arguments):
    done = tool("ruff", *arguments)
    assert done.returncode == 0, done.stdout + done.stderr


def test_mypy_strict(tool):
    done = tool("mypy", "--strict")
    assert done.returncode == 0, done.stdout + done.stderr


def test_benchmarks_call_what_there_is(tool):
    """Names and arguments of what they take from the package: no other test runs all that they do."""
    done = tool("mypy", "--check-untyped-defs", "--no-pretty", "benchmarks")
    lines = done.stdout.splitlines()
    wrong = [line for line in lines if line.endswith("[call-arg]") or ('Module "relnav' in line and "has no" in line)]
    assert wrong == []
    assert "source files)" in done.stdout


def test_the_import_rules_have_teeth(root, tmp_path, python):
    """A copy of the package with one upward import breaks the contract."""
    import shutil

    shutil.copytree(root / "relnav", tmp_path / "relnav", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(root / "pyproject.toml", tmp_path)
    with (tmp_path / "relnav" / "geometry" / "spherical.py").open("a") as file:
        file.write("\nfrom relnav.estimation import gating\n")
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    done = python(code, path=tmp_path, cwd=tmp_path)
    assert done.returncode != 0
    assert "relnav.geometry is not allowed to import relnav.estimation" in done.stdout
