"""Modules of at most 400 lines, functions of at most 60, one subject a file: its docstring says which."""

import ast

MOST_LINES_OF_A_MODULE = 400
MOST_LINES_OF_A_FUNCTION = 60


def functions(tree):
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def test_modules(sources):
    assert len(sources) > 30
    long = {str(path): n for path in sources if (n := len(path.read_text().splitlines())) > MOST_LINES_OF_A_MODULE}
    assert long == {}


def test_functions(sources):
    """Counted without decorator and docstring: the docstring is not what makes a function hard to read."""
    long = {}
    for path in sources:
        for node in functions(ast.parse(path.read_text())):
            body = node.body[1:] if ast.get_docstring(node) is not None else node.body
            if body and (lines := node.end_lineno - body[0].lineno + 1) > MOST_LINES_OF_A_FUNCTION:
                long[f"{path.name}:{node.name}"] = lines
    assert long == {}


def test_every_module_says_what_it_is(sources):
    without = [str(path) for path in sources if not ast.get_docstring(ast.parse(path.read_text()))]
    assert without == []


def test_no_star_imports_and_no_prints(sources):
    found = []
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.names[0].name == "*":
                found.append(f"{path}:{node.lineno}: star import")
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
                found.append(f"{path}:{node.lineno}: print")
    assert found == []
