"""Which messages of the package are triggered while the tests run: one that no test triggers nobody has read.

A site is a statement `raise ERROR(...)`. Before relnav is imported, `watch` puts a finder in
front of Python's own that gives every site a note of its file and line. Nothing else of the code is changed, and no
file of it is written.
"""

import ast
import builtins
import importlib.abc
import importlib.machinery
import sys
from functools import cache
from pathlib import Path
from types import CodeType

PACKAGE = Path(__file__).resolve().parents[1] / "relnav"
NOTE = "_a_message_of_relnav"
seen: set[str] = set()
"""Sites that ran in this process: "relnav/module.py:LINE"."""
skipped: set[str] = set()
"""Tests that were skipped, as something they need is not there."""
left_out: set[str] = set()
"""Tests that were not asked for."""
PARTS = (
    *("keyword", "markexpr", "deselect", "ignore", "ignore_glob", "lf", "stepwise"),
    *("collectonly", "setuponly", "setupplan"),
)
"""Options of pytest that run a part of the tests, or none."""


def is_site(node: ast.AST) -> bool:
    """Whether a statement makes an error; raising again what was caught does not."""
    return isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)


def name_of(path: Path, node: ast.stmt) -> str:
    return f"{PACKAGE.name}/{path.relative_to(PACKAGE).as_posix()}:{node.lineno}"


@cache
def sites() -> dict[str, str]:
    """Every site of the package -> its statement."""
    return {
        name_of(path, node): ast.unparse(node)
        for path in sorted(PACKAGE.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if is_site(node)
    }


def untold(told: set[str]) -> list[str]:
    """Sites that are not among those told, with what they say."""
    return [f"{name}: {statement}" for name, statement in sites().items() if name not in told]


def note_skip(report) -> None:
    """Of pytest's report of a test or of a file; `messageless` marks tests that trigger no message."""
    if report.skipped and not hasattr(report, "wasxfail") and "messageless" not in getattr(report, "keywords", ()):
        skipped.add(report.nodeid)


def kept() -> dict[str, list[str]]:
    """What this process saw, as text that another can `join`."""
    return {"seen": sorted(seen), "skipped": sorted(skipped), "left_out": sorted(left_out)}


def join(other: dict[str, list[str]]) -> None:
    """Add what another process has `kept`."""
    for mine, name in ((seen, "seen"), (skipped, "skipped"), (left_out, "left_out")):
        mine.update(other.get(name, ()))


def is_whole(option) -> bool:
    """Whether all tests were asked for, by pytest's options and by what was deselected."""
    return not left_out and not any(getattr(option, name, None) for name in PARTS)


def verdict() -> tuple[list[str], bool]:
    """Lines about the messages that a whole run has not triggered, and whether it fails for them."""
    if not (missed := untold(seen)):
        return [], False
    lines = [f"messages that no test triggers: {len(missed)}", *(f"  {line}" for line in missed)]
    if skipped:
        lines.append(f"no failure, as tests that may trigger them were skipped: {len(skipped)} (pytest -rs tells why)")
    return lines, not skipped


class Noting(ast.NodeTransformer):
    """Puts a note before every site of a module."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def visit(self, node: ast.AST) -> ast.AST | list[ast.stmt]:
        if not is_site(node):
            return super().generic_visit(node)
        note = ast.Expr(ast.Call(ast.Name(NOTE, ast.Load()), [ast.Constant(name_of(self._path, node))], []))
        return [ast.fix_missing_locations(ast.copy_location(note, node)), node]


class Loader(importlib.machinery.SourceFileLoader):
    """Reads a module with notes, past Python's store of compiled modules."""

    def get_code(self, fullname: str) -> CodeType:
        path = Path(self.get_filename(fullname)).resolve()
        return compile(Noting(path).visit(ast.parse(self.get_data(str(path)))), str(path), "exec")


class Finder(importlib.abc.MetaPathFinder):
    """Finds the package's modules where Python does."""

    def find_spec(self, fullname, path=None, target=None):
        if fullname.partition(".")[0] != PACKAGE.name:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin and Path(spec.origin).resolve().is_relative_to(PACKAGE):
            spec.loader = Loader(fullname, spec.origin)
        return spec


def watch() -> None:
    """Note sites from now on; for a process that has not imported relnav.

    Finders that came before Python's own stay before this one: a mutant of `benchmarks/mutation.py` is what is tested.
    """
    if PACKAGE.name not in sys.modules:
        setattr(builtins, NOTE, seen.add)
        sys.meta_path.insert(sys.meta_path.index(importlib.machinery.PathFinder), Finder())
