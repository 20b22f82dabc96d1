"""Every message that the package raises at a caller or user, from its source: `raise ERROR("...")`, by module.

What a message fills in (names, numbers) is shown as `...`. A sentence that is put together elsewhere and only handed on
is not among them.
"""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
ERRORS = ("ValueError", "TypeError", "UsageError", "LogError", "InputError", "ModelError", "UnknownModelError")


def template(node: ast.expr) -> str:
    """Text of an expression that makes a message, with `...` for what is filled in."""
    match node:
        case ast.Constant(value=str() as text):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(template(part) for part in parts)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return template(left) + template(right)
    return "..."


def raised(path: Path) -> list[tuple[str, str]]:
    """(error, message) of every `raise` of a module whose message stands there."""
    found = []
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if not (isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)):
            continue
        name = node.exc.func.id if isinstance(node.exc.func, ast.Name) else ""
        texts = [template(argument) for argument in node.exc.args]
        text = max(texts, key=lambda said: len(said.replace("...", "")), default="")
        while "......" in text:
            text = text.replace("......", "...")
        if name in ERRORS and any(letter.isalpha() for letter in text):
            found.append((name, " ".join(text.split())))
    return sorted(set(found), key=lambda entry: entry[1])


def collected() -> dict[str, list[tuple[str, str]]]:
    """Module -> its messages."""
    paths = sorted((ROOT / "relnav").rglob("*.py"))
    return {str(path.relative_to(ROOT)): said for path in paths if (said := raised(path))}


def messages() -> str:
    """The page: a section for each module."""
    lines: list[str] = []
    for module, said in collected().items():
        lines += [f"## {module}", ""]
        for error, text in said:
            lines.append(f"- `` {text} `` ({error})" if "`" in text else f"- `{text}` ({error})")
        lines.append("")
    return "\n".join(lines)
