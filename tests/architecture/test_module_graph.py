"""Between modules: no import in a circle, and no module that nothing uses. `lint-imports` sees layers, not these."""

import ast
import re

import pytest

import relnav

KNOWN_ALONE = {
    # nothing but their tests uses these. To be decided: public, used, or gone.
    "relnav.sensors.birefringent_sun.patent",
    "relnav.sensors.sun_attitude",
    "relnav.simulation.marker_images",
}

ENTRY_POINTS = {"relnav", "relnav.__main__"}


def is_type_checking(node):
    return isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")


def run_nodes(node):
    """Every node that can run: all but the bodies of `if TYPE_CHECKING`."""
    left = [node]
    while left:
        node = left.pop()
        yield node
        left += node.orelse if is_type_checking(node) else ast.iter_child_nodes(node)


def imported(text, names):
    """Modules among `names` that a module's text imports, in functions too; not those that lie on the way to one."""
    found = set()
    for node in run_nodes(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "a relative import"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in names else node.module)
    return found & names


def named(text, names):
    """Modules among `names` in whole strings, as "module" or "module:name": tables of what is imported when needed."""
    strings = [n.value for n in run_nodes(ast.parse(text)) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
    return {match[1] for text in strings if (match := re.fullmatch(r"(relnav[\w.]*)(:\w+)?", text))} & names


def reach(graph, start):
    """Modules that the import of `start` can come to."""
    seen, left = set(), [start]
    while left:
        new = graph[left.pop()] - seen
        seen |= new
        left += new
    return seen


def circles(graph):
    """Groups of modules that import one another, directly or not."""
    reached = {name: reach(graph, name) for name in graph}
    groups = {tuple(sorted(b for b in reached[a] if a in reached[b])) for a in graph if a in reached[a]}
    return sorted(list(group) for group in groups)


@pytest.fixture(scope="module")
def texts(root, sources):
    """Module -> text of its file."""
    parts = {path: path.relative_to(root).with_suffix("").parts for path in sources}
    return {".".join(p[:-1] if p[-1] == "__init__" else p): path.read_text() for path, p in parts.items()}


def test_no_import_in_a_circle(texts):
    graph = {name: imported(text, texts.keys()) - {name} for name, text in texts.items()}
    assert sum(map(len, graph.values())) > 500
    assert circles(graph) == []


def test_every_module_is_used(root, texts):
    """By another module, by a benchmark or tool, or as a public name; a test alone is no use."""
    used = set(ENTRY_POINTS)
    for name, text in texts.items():
        used |= (imported(text, texts.keys()) | named(text, texts.keys())) - {name}
    for folder in ("benchmarks", "tools"):
        for path in (root / folder).rglob("*.py"):
            used |= imported(path.read_text(), texts.keys())
    for name, home in relnav._HOME.items():
        used |= {home, f"{home}.{name}"}
    packages = {name for name in texts if any(other.startswith(f"{name}.") for other in texts)}
    assert texts.keys() - used - packages == KNOWN_ALONE


def test_circles_are_found():
    """Also through functions and over three modules; not through what only a type checker reads."""
    texts = {
        "p.a": "def f():\n    from p import b",
        "p.b": "import p.c",
        "p.c": "if x:\n    from p.a import f",
        "p.d": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p.e import g",
        "p.e": "from p import d",
        "p.f": "import p.a",
    }
    assert circles({name: imported(text, texts.keys()) for name, text in texts.items()}) == [["p.a", "p.b", "p.c"]]


def test_names_in_tables_are_found():
    names = {"relnav.a", "relnav.b.c", "relnav.d"}
    assert named('x = {"k": "relnav.a", "l": "relnav.b.c:f"}; y = "see relnav.d."', names) == {"relnav.a", "relnav.b.c"}
