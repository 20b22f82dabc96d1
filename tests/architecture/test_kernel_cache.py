"""Compiled code that is kept: never that of an older callee, and no error where nothing can be kept.

Tried on a package of two kernels with the project's own `codegen`, which compiles in a second.
"""

import re

import pytest

from relnav.codegen.store import WITHOUT_KERNELS

CALLEE = """
from toy.codegen.kernel import kernel

@kernel
def inner(x: float) -> float:
    return {factor} * x
"""
CALLER = """
from toy.codegen.kernel import kernel
from toy.callee import inner

@kernel
def outer(x: float) -> float:
    return inner(x) + 1.0
"""
CALL = """
import warnings
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    from toy.caller import outer
    from toy.callee import inner
    print(outer(2.0))
from toy.codegen import kernel
print(kernel.is_compiled())
made = getattr(outer, "dispatcher", None)
print(sum(made.stats.cache_hits.values()) if hasattr(made, "stats") else 0)
for entry in caught:
    print(entry.category.__name__, entry.message)
"""


@pytest.fixture
def toy(root, tmp_path):
    """A package `toy` with a kernel that calls another, and the product's way to compile."""
    package = tmp_path / "site" / "toy"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "codegen").mkdir()
    for path in (root / "relnav" / "codegen").glob("*.py"):
        (package / "codegen" / path.name).write_text(path.read_text().replace("from relnav.", "from toy."))
    (package / "callee.py").write_text(CALLEE.format(factor=3.0))
    (package / "caller.py").write_text(CALLER)
    return package


def call(python, toy, **environment):
    variables = {"RELNAV_JIT": "1", "HOME": str(toy.parent / "home"), "NUMBA_CACHE_DIR": ""} | environment
    done = python(CALL, path=toy.parent, environment=variables)
    assert done.returncode == 0, done.stderr
    result, compiled, hits, *warned = done.stdout.splitlines()
    return float(result), compiled == "True", int(hits), warned


def test_compiled_code_is_kept_from_one_process_to_the_next(python, toy):
    assert call(python, toy) == (7.0, True, 0, [])
    assert call(python, toy) == (7.0, True, 1, [])


@pytest.mark.parametrize("part", ["nbi", "nbc"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_half_a_file_is_as_if_it_were_not_there(python, toy, part, share):
    assert call(python, toy) == (7.0, True, 0, [])
    (path,) = (toy / "__pycache__" / "compiled").glob(f"caller.outer*.{part}")
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert call(python, toy) == (7.0, True, 0, [])
    assert call(python, toy) == (7.0, True, 1, [])


def test_a_changed_callee_is_never_run_in_its_old_form(python, toy):
    """Numba alone would look at the caller's file only, and run the old callee that it holds."""
    assert call(python, toy)[0] == 7.0
    (toy / "callee.py").write_text(CALLEE.format(factor=5.0))
    assert call(python, toy) == (11.0, True, 0, [])
    assert call(python, toy) == (11.0, True, 1, [])


@pytest.fixture
def stamp(python, toy):
    """stamp() -> that of compiled code, as a fresh process computes it after these lines."""

    def ask(lines=""):
        done = python(f"{lines}\nfrom toy.codegen.store import code_stamp; print(code_stamp())", path=toy.parent)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    return ask


REMOVED = """
import os
scandir = os.scandir

def without_it(path="."):
    if os.path.basename(path) == "removed":
        raise FileNotFoundError(path)
    return scandir(path)

os.scandir = without_it
"""


def test_what_comes_and_goes_beside_the_sources_changes_no_stamp(toy, stamp):
    """Another process removes a folder or a file while they are listed; an editor locks a file and keeps copies."""
    alone = stamp()
    (toy / "removed").mkdir()
    assert stamp(REMOVED) == alone
    (toy / "removed.py").symlink_to("nowhere")
    (toy / ".#callee.py").symlink_to("somebody@somewhere.1")
    (toy / ".ipynb_checkpoints").mkdir()
    (toy / ".ipynb_checkpoints" / "callee.py").write_text("")
    (toy / "callee-checkpoint.py").write_text("")
    assert stamp(REMOVED) == alone


def test_any_change_of_a_file_changes_the_stamp(toy, stamp):
    stamps = [stamp(), stamp()]
    assert stamps[0] == stamps[1]
    (toy / "callee.py").write_text(CALLEE.format(factor=4.0))
    stamps.append(stamp())
    (toy / "room").mkdir()
    (toy / "room" / "new.py").write_text("")
    stamps.append(stamp())
    (toy / "room" / "new.py").rename(toy / "room" / "other.py")
    stamps.append(stamp())
    assert len(set(stamps)) == 4
    (toy / "cli").mkdir()
    (toy / "cli" / "command.py").write_text("")
    assert stamp() == stamps[-1]


def test_no_kernel_stands_where_a_change_compiles_nothing_anew(root):
    marks = re.compile(r"^ *@(kernel|long_kernel|entry|long_entry|shared_entry|straight_line)\b", re.M)
    found = {
        path.relative_to(root / "relnav").parts[0]
        for path in (root / "relnav").rglob("*.py")
        if marks.search(path.read_text())
    }
    assert found, "no kernel found at all: the marks have other names"
    assert found.isdisjoint(WITHOUT_KERNELS)


def block_the_package(toy):
    for folder in (toy, toy / "codegen"):
        (folder / "__pycache__").write_text("in the way")


def test_where_nothing_can_be_written_it_works_with_one_warning(python, toy):
    """`__pycache__` and the user's cache folder are blocked by files, which stops root as well."""
    block_the_package(toy)
    blocked = toy.parent / "blocked"
    blocked.write_text("in the way")
    environment = {"HOME": str(blocked / "home"), "XDG_CACHE_HOME": str(blocked / "cache"), "NUMBA_CACHE_DIR": ""}
    result, compiled, _, warned = call(python, toy, **environment)
    assert (result, compiled) == (7.0, True)
    assert len(warned) == 1
    assert warned[0].startswith("RuntimeWarning no folder for compiled code can be written")
    assert "NUMBA_CACHE_DIR" in warned[0]


def test_a_cache_folder_that_cannot_be_made_is_no_error(python, toy):
    """NUMBA_CACHE_DIR under a regular file."""
    blocked = toy.parent / "blocked"
    blocked.write_text("in the way")
    result, compiled, _, warned = call(python, toy, NUMBA_CACHE_DIR=str(blocked / "numba"))
    assert (result, compiled) == (7.0, True)
    assert len(warned) <= 1


def test_a_read_only_install_keeps_its_code_in_the_users_folder(python, toy):
    block_the_package(toy)
    environment = {"XDG_CACHE_HOME": str(toy.parent / "cache"), "NUMBA_CACHE_DIR": ""}
    assert call(python, toy, **environment) == (7.0, True, 0, [])
    assert call(python, toy, **environment) == (7.0, True, 1, [])


def test_switched_off_it_is_plain_python(python, toy):
    result, compiled, hits, warned = call(python, toy, RELNAV_JIT="0")
    assert (result, compiled, hits, warned) == (7.0, False, 0, [])


def test_without_numba_it_is_plain_python_with_a_warning(python, toy):
    """A broken numba, as after an upgrade of numpy."""
    (toy.parent / "numba.py").write_text("raise ImportError('Numba needs NumPy 2.3 or less')")
    result, compiled, _, warned = call(python, toy)
    assert (result, compiled) == (7.0, False)
    assert len(warned) == 1
    assert "numba cannot be imported (Numba needs NumPy 2.3 or less)" in warned[0]


def test_on_a_python_with_other_objects_it_is_plain_python_with_a_warning(python, toy):
    """As built without the interpreter's lock: compiled calls would look where nothing is."""
    source = toy / "codegen" / "kernel.py"
    source.write_text(source.read_text().replace("OBJECT_HEADER = 16", "OBJECT_HEADER = 32"))
    result, compiled, _, warned = call(python, toy)
    assert (result, compiled) == (7.0, False)
    assert len(warned) == 1
    assert "lays out its objects in another way" in warned[0]
