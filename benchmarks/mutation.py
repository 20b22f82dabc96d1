"""Mutation testing of the formulas: an operator, number or choice of a formula is changed, a test must fail.

A mutant is made in memory, where the module is imported, and its tests run in a child of a process that has loaded
numpy and pytest already: kernels as plain Python (`RELNAV_JIT=0`), so that nothing is compiled. The tests of a module
are those of all files that name it, then of those that name a module which imports it, the quickest, as far as the
time allows. They have to pass unchanged first. A mutant is killed if a test fails (pytest's exit code 1), or if
they take five times the processor time. One whose tests could not be run (any other code) counts as neither.

    python benchmarks/mutation.py [--sample 100] [--seed 0] [--room estimation] [--json FILE]
    python benchmarks/mutation.py --module relnav/estimation/factored.py

Survivors are printed with their line. Those that change no answer are named with the reason in mutation_judged.toml, by
the function, the source line and the place in it, so that no other change of the same letters is excused.
"""

import argparse
import ast
import copy
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import random
import resource
import signal
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("estimation", "dynamics", "geometry")
CLOSED_FORMS = (
    *(f"sensors/three_beacon/{name}.py" for name in ("fix", "invariants", "parallel", "perspective", "off_nominal")),
    *(f"sensors/three_marker/{name}.py" for name in ("as_published", "camera", "pose")),
    *(f"sensors/{name}.py" for name in ("sun_direction",)),
)
BUDGET_S, LONGEST_TEST_S = 12.0, 3.0
"""Of a module's tests, plain and unchanged, together and each: the quickest are taken."""
SWAPS: dict[type, tuple[type, ...]] = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.Pow: (ast.Mult,),
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.And: (ast.Or,),
    ast.Or: (ast.And,),
}
NAMES = {"sin": "cos", "cos": "sin", "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}
NAMES |= {"sqrt": "abs", "asin": "acos", "acos": "asin", "any": "all", "all": "any"}


class Mutant(NamedTuple):
    """One change: of the file's `number`-th place that can be changed, the `choice`-th way."""

    path: str
    number: int
    choice: int
    line: int
    within: str
    """Function, source line and column in it, and which of these: tells the place when lines above come and go."""
    before: str
    after: str


def places(tree: ast.AST) -> Iterator[ast.AST]:
    """What can be changed: expressions of functions; not messages, annotations, decorators or docstrings."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom):
            continue
        if isinstance(node, ast.FunctionDef):
            for part in node.body:
                yield from places(ast.Module([part], []))
            continue
        if isinstance(node, ast.AnnAssign):
            yield from places(ast.Module([ast.Expr(node.value)] if node.value else [], []))
            continue
        if isinstance(node, ast.BinOp | ast.UnaryOp | ast.Compare | ast.BoolOp | ast.Constant | ast.Call):
            yield node
        yield from places(node)


def changes(node: ast.AST) -> list[ast.AST]:
    """What a place can become."""
    made: list[ast.AST] = []
    if isinstance(node, ast.BinOp | ast.BoolOp):
        for other in SWAPS.get(type(node.op), ()):
            made.append(new := copy.deepcopy(node))
            new.op = other()
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        made.append(copy.deepcopy(node.operand))
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        for other in SWAPS.get(type(node.ops[0]), ()):
            made.append(new := copy.deepcopy(node))
            new.ops = [other()]
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        made.append(ast.Constant(node.value + 1 if isinstance(node.value, int) else 2.0 * node.value or 1.0))
    elif isinstance(node, ast.Constant) and type(node.value) is bool:
        made.append(ast.Constant(not node.value))
    elif isinstance(node, ast.Call):
        name = node.func
        if isinstance(name, ast.Name | ast.Attribute) and (word := _word(name)) in NAMES:
            made.append(new := copy.deepcopy(node))
            if isinstance(new.func, ast.Name):
                new.func.id = NAMES[word]
            elif isinstance(new.func, ast.Attribute):
                new.func.attr = {"abs": "fabs"}.get(NAMES[word], NAMES[word])
    return made


def _word(name: ast.Name | ast.Attribute) -> str:
    return name.id if isinstance(name, ast.Name) else name.attr


def mutants(path: Path) -> list[Mutant]:
    """Every mutant of a file."""
    source = path.read_text(encoding="utf-8")
    tree, found, lines = ast.parse(source), [], source.splitlines()
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    seen: Counter[tuple[str, str]] = Counter()
    for number, node in enumerate(places(tree)):
        inside = [one.name for one in functions if one.lineno <= node.lineno <= (one.end_lineno or 0)]
        line = lines[node.lineno - 1]
        column = node.col_offset - len(line) + len(line.lstrip())
        within = f"{inside[-1] if inside else ''}: {line.strip()} @{column}"
        seen[within, type(node).__name__] += 1
        if (count := seen[within, type(node).__name__]) > 1:
            within += f" #{count}"
        for choice, change in enumerate(changes(node)):
            entry = str(path.relative_to(ROOT)), number, choice, node.lineno, within
            found.append(Mutant(*entry, ast.unparse(node), ast.unparse(change)))
    return found


def changed(mutant: Mutant) -> ast.Module:
    """The mutant's whole file."""
    tree = ast.parse((ROOT / mutant.path).read_text(encoding="utf-8"))
    node = next(place for number, place in enumerate(places(tree)) if number == mutant.number)
    change = ast.copy_location(changes(node)[mutant.choice], node)
    for parent in ast.walk(tree):
        for field, value in ast.iter_fields(parent):
            if value is node:
                setattr(parent, field, change)
            elif isinstance(value, list) and any(item is node for item in value):
                value[:] = [change if item is node else item for item in value]
    return ast.fix_missing_locations(tree)


class Importer(importlib.abc.MetaPathFinder):
    """Finds one module, and gives it another content."""

    def __init__(self, mutant: Mutant) -> None:
        self.name = mutant.path.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
        self.mutant = mutant

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:  # noqa: ARG002  (importlib's signature)
        """Of that module alone."""
        if fullname != self.name:
            return None
        place, code = str(ROOT / self.mutant.path), compile(changed(self.mutant), self.mutant.path, "exec")

        class Loader(importlib.machinery.SourceFileLoader):
            def get_code(self, fullname: str) -> Any:  # noqa: ARG002  (likewise)
                return code

        return importlib.util.spec_from_file_location(fullname, place, loader=Loader(fullname, place))


class Stopwatch:
    """A plugin of pytest: how long each test that passes takes; one that takes too long is none."""

    def __init__(self, out: Path) -> None:
        self.out, self.took, self.begin = out, dict[str, float](), 0.0

    def pytest_sessionstart(self) -> None:
        """Begin to count; in the child that runs the tests."""
        self.begin = time.process_time()

    def pytest_runtest_setup(self, item: Any) -> None:  # noqa: ARG002  (pytest's signature)
        """Stop the test after a while, and begin none once the time is over."""
        import pytest

        if time.process_time() - self.begin > 3.0 * BUDGET_S:  # slow ones come first in some files, and count for none
            pytest.skip("no time left")
        signal.signal(signal.SIGPROF, _too_long)
        signal.setitimer(signal.ITIMER_PROF, LONGEST_TEST_S)

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Note it."""
        if report.when == "teardown":  # a report of the setup comes before the call
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        if report.when == "call" and report.passed:
            self.took[report.nodeid] = report.duration

    def pytest_sessionfinish(self) -> None:
        """Write it down."""
        self.out.write_text(json.dumps(self.took))


def _too_long(number: int, frame: object) -> None:  # noqa: ARG001  (the signature of a signal's handler)
    import pytest

    pytest.fail("too long")  # no Exception, which what is tested may catch


TOO_LONG = -int(signal.SIGXCPU)
KILLED = (1, TOO_LONG)
"""Exit codes of tests that noticed; pytest's others say that it could not run them."""


def run_tests(tests: list[str], mutant: Mutant | None, limit_s: float, watch: Stopwatch | None = None) -> int:
    """Run tests in a child, up to the first that fails unless they are timed; the exit code of pytest or `TOO_LONG`.

    `limit_s` is processor time; a child that waits instead is ended after twenty times as long.
    """
    begin, child = time.monotonic(), os.fork()
    if child == 0:
        os.setpgid(0, 0)
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s) + 1, int(limit_s) + 5))
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, 1)
        os.dup2(null, 2)
        if mutant is not None:
            sys.meta_path.insert(0, Importer(mutant))
        import pytest

        options = ["-q", "-p", "no:xdist", "-p", "no:cacheprovider", "--override-ini=addopts=--import-mode=importlib"]
        options += ["-W", "ignore:.*encountered in scalar:RuntimeWarning", *(["-x"] if watch is None else [])]
        os._exit(int(pytest.main([*options, *tests], plugins=[watch] if watch else [])))
    while time.monotonic() - begin < 20.0 * limit_s:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return TOO_LONG


def named(module: str, text: str) -> bool:
    """Whether a text names a module, by its whole name or as it is imported from its package."""
    package, _, name = module.rpartition(".")
    return module in text or (f"from {package} import" in text and name in text)


def tests_of(path: Path, timed: dict[str, dict[str, float]]) -> dict[str, float]:
    """Tests and their durations, the quickest, as far as the time goes: of all files that name a module.

    What is left of the time goes to the files that name a module which imports it: they test it through that. A file of
    slow tests must not keep out the next one, which may hold the quick test of the very line.
    """
    module = str(path.relative_to(ROOT)).removesuffix(".py").replace("/", ".")
    own = ROOT / "tests" / path.relative_to(ROOT / "relnav").parent
    files = sorted((ROOT / "tests").rglob("test_*.py"), key=lambda file: (file.parent != own, str(file)))
    texts = {file: file.read_text(encoding="utf-8") for file in files}
    users = [
        str(file.relative_to(ROOT)).removesuffix(".py").replace("/", ".")
        for file in sorted((ROOT / "relnav").rglob("*.py"))
        if file != path and named(module, file.read_text(encoding="utf-8"))
    ]
    direct = [file for file in files if named(module, texts[file])]
    through = [file for file in files if file not in direct and any(named(user, texts[file]) for user in users)]
    took: dict[str, float] = {}
    for file in (*direct, *through):
        key = str(file.relative_to(ROOT))
        if key not in timed:
            with tempfile.TemporaryDirectory() as folder:
                out = Path(folder) / "took.json"
                run_tests([key], None, 6.0 * BUDGET_S, Stopwatch(out))
                timed[key] = json.loads(out.read_text()) if out.exists() else {}
        took |= timed[key]
        if file in through and sum(took.values()) > BUDGET_S:
            break
    chosen: dict[str, float] = {}
    for test, seconds in sorted(took.items(), key=lambda entry: entry[1]):
        if sum(chosen.values()) + seconds <= BUDGET_S:
            chosen[test] = seconds
    return chosen


def judged() -> dict[tuple[str, str, str], str]:
    """Survivors that were looked at: (file, within, after) -> why no test can tell, or needs to."""
    table = tomllib.loads((ROOT / "benchmarks" / "mutation_judged.toml").read_text(encoding="utf-8"))
    return {(entry["file"], entry["within"], entry["after"]): entry["why"] for entry in table.get("survivor", [])}


def room_files() -> dict[str, list[Path]]:
    """The packages of formulas and their files; a file that is named and missing is an error."""
    rooms = {room: sorted((ROOT / "relnav" / room).glob("*.py")) for room in ROOMS}
    rooms["closed forms"] = [ROOT / "relnav" / name for name in CLOSED_FORMS]
    missing = [str(path) for files in rooms.values() for path in files if not path.is_file()]
    if missing or not all(rooms.values()):
        raise FileNotFoundError(f"formulas that are named in mutation.py are not there: {missing or rooms}")
    return rooms


def try_room(room: str, files: list[Path], options: argparse.Namespace, timed: dict[str, dict[str, float]]) -> Any:
    """A sample of the mutants of some files, and what became of each."""
    known, begin = judged(), time.monotonic()
    every = [mutant for path in files for mutant in mutants(path)]
    chosen = random.Random(options.seed).sample(every, min(options.sample or len(every), len(every)))
    counts = {"possible": len(every), "tried": 0, "killed": 0, "judged": 0}
    entry: dict[str, Any] = {"room": room, **counts, "untested": [], "broken": [], "survivors": []}
    tests: dict[str, dict[str, float]] = {}
    for mutant in chosen:  # in the order drawn, so that a run which is cut short is a sample too
        if time.monotonic() - begin > options.seconds:
            break
        if mutant.path not in tests:
            found = tests_of(ROOT / mutant.path, timed)
            passes = found and run_tests(list(found), None, 20.0 + 5.0 * sum(found.values())) == 0
            tests[mutant.path] = found if passes else {}
        if not tests[mutant.path]:
            entry["untested"] = sorted({*entry["untested"], mutant.path})
            continue
        code = run_tests(list(tests[mutant.path]), mutant, 20.0 + 5.0 * sum(tests[mutant.path].values()))
        if code not in (0, *KILLED):
            entry["broken"].append({**mutant._asdict(), "code": code})
            continue
        entry["tried"] += 1
        if code in KILLED:
            entry["killed"] += 1
            continue
        why = known.get((mutant.path, mutant.within, mutant.after), "")
        entry["judged"] += bool(why)
        entry["survivors"].append({**mutant._asdict(), "why": why})
        print(f"survived: {mutant.path}:{mutant.line}: {mutant.before} -> {mutant.after}  {why}", flush=True)
    return entry


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sample", type=int, default=100, help="Mutants of each package; 0: all of them.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--room", choices=(*ROOMS, "closed forms"), action="append")
    parser.add_argument("--module", type=Path, action="append")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="Of each package, of wall time.")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    os.chdir(ROOT)
    os.environ |= {"RELNAV_JIT": "0", "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    sys.path[:] = [str(ROOT), *(entry for entry in sys.path if Path(entry or ".").resolve() != ROOT / "benchmarks")]
    for name in (
        "numpy",
        "scipy.optimize",
        "scipy.special",
        "scipy.integrate",
        "scipy.spatial.transform",
        "pytest",
    ):
        importlib.import_module(name)
    rooms = room_files()
    if options.room:
        rooms = {room: rooms[room] for room in options.room}
    if options.module:
        rooms = {str(path): [path.resolve()] for path in options.module}
    timed, found = dict[str, dict[str, float]](), []
    for room, files in rooms.items():
        found.append(entry := try_room(room, files, options, timed))
        print(json.dumps({key: value for key, value in entry.items() if key != "survivors"}), flush=True)
        if options.json:
            options.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
