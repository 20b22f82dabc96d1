"""Finished code of entries: the same bits without numba, and compiled anew where it is damaged or does not fit.

Tried on a package of one entry with the project's own `codegen`, which compiles in a second.
"""

import json
import math
import os

import pytest

ENTRY = """
import math
from toy.codegen.kernel import entry, shared_entry

@entry
def mixed(values, table, scale: float, count: int, negate: bool):
    total = 0.0
    for i in range(count):
        total += math.sin(values[i]) * scale / (1.0 + table[i, 1] * table[i, 1])
    table[0, 0] = -total if negate else total
    return total, count + 1, negate, None

@entry
def turned(record):
    record["x"][1] += record["n"]

@shared_entry
def inner(x: float) -> float:
    return math.exp(-x)

@entry
def outer(x: float) -> float:
    return inner(x) + inner(2.0 * x)

@entry
def root(x: float) -> float:
    return math.sqrt(x)
"""
PREPARE = """
import sys
import numpy as np
from toy.module import mixed, root, turned
values, table = np.linspace(0.1, 0.9, 3), np.arange(6.0).reshape(3, 2)
"""
CALL = (
    PREPARE
    + """
record = np.zeros(1, [("x", float, 2), ("n", int)])[0]
record["n"] = 5
total, count, negate, none = mixed(values, table, 0.7, 3, True)
print(total.hex(), table[0, 0].hex(), count, negate, none)
turned(record)
print(record["x"].tolist(), root(2.0).hex(), root(np.float64(2.0)).hex(), root(4))
print("numba" in sys.modules)
"""
)


@pytest.fixture(scope="module")
def compiled(root, python, tmp_path_factory):
    """A package `toy` with an entry that was called once: its folder, and what the call printed."""
    place = tmp_path_factory.mktemp("site")
    (place / "toy" / "codegen").mkdir(parents=True)
    (place / "toy" / "__init__.py").write_text("")
    for path in (root / "relnav" / "codegen").glob("*.py"):
        (place / "toy" / "codegen" / path.name).write_text(path.read_text().replace("from relnav.", "from toy."))
    (place / "toy" / "module.py").write_text(ENTRY)
    return place, run(python, place, place / "kept")


def run(python, place, kept, code=CALL, **environment):
    """Lines that a fresh process prints, and what it says on stderr."""
    variables = {"RELNAV_JIT": "1", "NUMBA_CACHE_DIR": str(kept)} | environment
    done = python(code, path=place, environment=variables)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines(), done.stderr


def files(place, kept="kept"):
    return {path.name.partition("-")[0]: path for path in (place / kept).rglob("*.code")}


def test_the_second_process_has_the_same_bits_and_no_numba(compiled, python):
    place, (first, said) = compiled
    assert first[-1] == "True"
    assert first[0].split()[2:] == ["4", "True", "None"]
    assert first[1] == f"[0.0, 5.0] {2.0**0.5:.0f}"[:10] + f" {(2.0**0.5).hex()} {(2.0**0.5).hex()} 2.0"
    assert said.startswith("relnav: compiling for this processor")
    assert len(said.splitlines()) == 1
    again, silent = run(python, place, place / "kept")
    assert again == [*first[:-1], "False"]
    assert silent == ""


def test_code_that_only_another_entry_needed_is_finished_when_it_is_called(compiled, python, tmp_path):
    """A log first, then a step: numba holds the step's code, and the second process makes a file of its own of it."""
    place, _ = compiled
    called = "import sys\nfrom toy.module import inner, outer\nprint({}(0.5).hex(), 'numba' in sys.modules)"
    plain = {"inner": math.exp(-0.5), "outer": math.exp(-0.5) + math.exp(-1.0)}
    for name, compiles in (("outer", True), ("inner", True), ("inner", False), ("outer", False)):
        (said,), _ = run(python, place, tmp_path / "kept", called.format(name))
        assert said.split() == [plain[name].hex(), str(compiles)]


def test_plain_python_gives_the_same(compiled, python):
    place, (first, _) = compiled
    plain, _ = run(python, place, place / "kept", RELNAV_JIT="0")
    assert plain[1:] == [first[1], "False"]
    assert float.fromhex(plain[0].split()[0]) == pytest.approx(float.fromhex(first[0].split()[0]), rel=1e-14)


def test_what_was_shipped_is_used_where_nothing_was_kept(compiled, python, tmp_path):
    place, (first, _) = compiled
    shipped = place / "toy" / "compiled"
    shipped.mkdir()
    for name, path in files(place).items():
        (shipped / path.name).write_bytes(path.read_bytes())
        assert name.startswith("toy.module.")
    try:
        assert run(python, place, tmp_path / "none")[0] == [*first[:-1], "False"]
    finally:
        for path in shipped.iterdir():
            path.unlink()
        shipped.rmdir()


def changed(header, **values):
    return lambda data: json.dumps(json.loads(data.partition(b"\n")[0]) | values).encode() + data[len(header) :]


DAMAGE = {
    "empty": lambda _: b"",
    "half": lambda data: data[: len(data) // 2],
    "one bit": lambda data: data[:-100] + bytes([data[-100] ^ 1]) + data[-99:],
    "no header": lambda data: b"\x00\xff" + data,
    "another processor": lambda data: data.replace(b'"machine": "', b'"machine": "0', 1),
    "another version": lambda data: data.replace(b'"stamp": "', b'"stamp": "0', 1),
    "what it calls is not here": lambda data: data.replace(b'"needs": [', b'"needs": ["no_such_function", ', 1),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_file_that_is_damaged_or_does_not_fit_is_compiled_anew(compiled, python, tmp_path, damage):
    place, (first, _) = compiled
    run(python, place, tmp_path, PREPARE + "root(2.0)")
    (path,) = tmp_path.rglob("toy.module.root*.code")
    path.write_bytes(DAMAGE[damage](path.read_bytes()))
    code = PREPARE + "print(root(2.0).hex(), 'numba' in sys.modules)"
    assert run(python, place, tmp_path, code)[0] == [f"{(2.0**0.5).hex()} True"]
    if damage != "what it calls is not here":
        assert run(python, place, tmp_path, code)[0] == [f"{(2.0**0.5).hex()} False"]
    assert first


KINDS = (
    PREPARE
    + """
ready = mixed.ready(values, table, 0.7, 3, True)
read_only = values.copy()
read_only.setflags(write=False)
assert ready(read_only, table, 1, 3, False)[1] == 4
assert ready(None, table, 1.0, 0, False)[0] == 0.0
for given in (
    (values.tolist(), table, 0.7, 3, True),
    (values.astype(np.float32), table, 0.7, 3, True),
    (values.astype(">f8"), table, 0.7, 3, True),
    (values.astype(complex), table, 0.7, 3, True),
    (values[::2], table, 0.7, 3, True),
    (values.reshape(1, 3), table, 0.7, 3, True),
    (values, table.T, 0.7, 3, True),
    (values.view(np.recarray), table, 0.7, 3, True),
    (values, table, "0.7", 3, True),
    (values, table, True, 3, True),
    (values, table, 0.7, 3.0, True),
    (values, table, 0.7, 3, 1),
    (values, table, 0.7, 3),
    (),
):
    assert ready(*given) is NotImplemented, given
for t in (10**400, -10**400):
    try:
        ready(values, table, t, 3, True)
    except OverflowError:
        continue
    raise AssertionError("no error")
assert ready(values, table, -1.0, 3, True)[1] == 4
assert ready(values, table, 0.7, -1, True)[1] == 0
try:
    mixed(values.view(np.recarray), table, 0.7, 3, True)
except TypeError as error:
    print(error)
print("numba" in sys.modules)
"""
)


def test_other_kinds_of_arguments_are_not_taken(compiled, python):
    place, _ = compiled
    sentence, numba = run(python, place, place / "kept", KINDS)[0]
    assert sentence == (
        "toy.module.mixed takes aligned arrays of numpy's own class; got <f8[1C], <f8[2C], float, int, bool"
    )
    assert numba == "False"


LEAK = (
    PREPARE
    + """
import tracemalloc
def many():
    for _ in range(20000):
        mixed(values, table, 0.7, 3, True), root(2.0), root(3)
many()
tracemalloc.start()
before = tracemalloc.get_traced_memory()[0], sys.getrefcount(values), sys.getrefcount(True), sys.getrefcount(None)
many()
after = tracemalloc.get_traced_memory()[0], sys.getrefcount(values), sys.getrefcount(True), sys.getrefcount(None)
print(after[0] - before[0] < 20000, [abs(b - a) < 50 for a, b in zip(before[1:], after[1:])])
"""
)


def test_calls_leave_nothing_behind(compiled, python):
    place, _ = compiled
    assert run(python, place, place / "kept", LEAK)[0] == ["True [True, True, True]"]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can become nobody")
def test_an_unknown_user_without_home_gets_an_answer(compiled, python):
    place, _ = compiled
    code = (
        "import os, warnings, toy.codegen.store as s, llvmlite.binding, pathlib\n"
        "os.setgid(54321); os.setuid(54321); os.environ.pop('HOME', None); os.chdir('/')\n"
        "warnings.simplefilter('ignore')\n"
        "print(s.at_hand('toy.module.absent'), s.folder(), pathlib.Path('~').exists())"
    )
    os.chmod(place, 0o755)
    lines, _ = run(python, place, "/proc/no", code, XDG_CACHE_HOME="")
    assert lines == ["False None False"]


def test_a_disk_that_takes_nothing_is_no_error(compiled, python):
    """/dev/full takes the place of a full disk: what is written there fails."""
    place, _ = compiled
    code = (
        "import pathlib, toy.codegen.store as s\n"
        "pathlib.Path.write_bytes = lambda path, data: open('/dev/full', 'wb', buffering=0).write(data)\n"
        "s.save(s.Code('toy.x', 'float', 'f', [], (b'code',)))\n"
        "print(s.at_hand('toy.x'))"
    )
    assert run(python, place, place / "full", code)[0] == ["False"]
