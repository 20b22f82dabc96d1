"""Pages made from the program and from files outside `docs`, when the site is built: no second copy can rot.

A line `<!-- generated: NAME -->` becomes what NAME in `MAKERS` says: commands from click, keys of models from the
loader's dataclasses, public names from `relnav/__init__.py`. A line `<!-- file: PATH -->` becomes that file of the
checkout. Links to files that have a page lead to the page.
"""

import dataclasses
import os
import re
import typing
from pathlib import Path
from types import FunctionType, ModuleType

import click
import keys
import messages

import relnav
from relnav.cli import root
from relnav.files.systems import SYSTEMS, resolve

ROOT = Path(__file__).parents[2]
MARK = re.compile(r"^<!-- generated: ([a-z ]+) -->$", re.MULTILINE)
FILE = re.compile(r"^<!-- file: (\S+) -->$", re.MULTILINE)
LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)#\s]+)")
PAGES = {  # files outside `docs` that a page shows
    "README.md": "docs/index.md",
    "ARCHITECTURE.md": "docs/architecture.md",
    "CHANGELOG.md": "docs/changelog.md",
    "CONTRIBUTING.md": "docs/contributing.md",
    "models/README.md": "docs/models.md",
}


def commands() -> str:
    """Help of every command, as a terminal of 100 columns shows it."""
    parts: list[str] = []

    def walk(command: click.Command, name: str, parent: click.Context | None) -> None:
        context = click.Context(command, info_name=name, parent=parent, terminal_width=100, max_content_width=100)
        level = "###" if parent is not None and parent.parent is not None else "##"
        parts.append(f"{level} {context.command_path}\n\n```text\n{command.get_help(context)}\n```\n")
        if isinstance(command, click.Group):
            for inner in command.list_commands(context):
                found = command.get_command(context, inner)
                assert found is not None
                walk(found, inner, context)

    walk(root, "relnav", None)
    return "\n".join(parts)


def _sensor_package(name: str, module: ModuleType, told: set[int]) -> list[str]:
    lines = [f"## relnav.{name}", "", "```{eval-rst}", f".. automodule:: {module.__name__}", "   :no-index:", ""]
    for member in sorted(module.__all__):
        value = getattr(module, member)
        if id(value) in told:  # both sun sensors return the same class
            continue
        told.add(id(value))
        lines += _directive(f"{module.__name__}.{member}", value)
    return [*lines, "```", ""]


def _directive(path: str, value: object) -> list[str]:
    if isinstance(value, type):
        kind = "exception" if issubclass(value, Exception) else "class"
        return [f".. auto{kind}:: {path}", "   :members:", ""]
    return [f".. auto{'function' if callable(value) else 'data'}:: {path}", ""]


def public() -> dict[str, object]:
    """Every public name of the package and of its sensor packages (relnav.aps_sun.measure), and what it is."""
    found: dict[str, object] = {}
    for name in relnav.__all__:
        value = getattr(relnav, name)
        found[f"relnav.{name}"] = value
        if isinstance(value, ModuleType):
            found |= {f"{value.__name__}.{member}": getattr(value, member) for member in value.__all__}
    return found


def returned() -> list[type]:
    """Classes of relnav that public names give out and that have no public name.

    By return annotations, and on by the fields of what is given out. Sections of models are left out: they are read
    from files, and have their page of keys.
    """
    known = [value for value in public().values() if not isinstance(value, ModuleType)]
    sections = {cls for system in SYSTEMS.values() for cls in _reached(resolve(system.mission), set())}
    found: list[type] = []
    waiting = list(known)
    while waiting:
        for cls in _given_out(waiting.pop(0), sections):
            if cls not in known and cls not in sections:
                known.append(cls)
                found.append(cls)
                waiting.append(cls)
    return sorted(found, key=lambda cls: cls.__name__)


def _reached(cls: type, seen: set[type]) -> set[type]:
    """A model's dataclass and all classes in its fields."""
    if cls not in seen and dataclasses.is_dataclass(cls):
        seen.add(cls)
        for hint in typing.get_type_hints(cls).values():
            for inner in _classes(hint):
                _reached(inner, seen)
    return seen


def _given_out(value: object, sections: set[type]) -> list[type]:
    """Classes that a call of a function, a method or a property of a class, or a field of it, hands over."""
    if not isinstance(value, type):
        return _classes(typing.get_type_hints(value).get("return")) if callable(value) else []
    hints = [] if value in sections else list(typing.get_type_hints(value).values())
    for name, member in vars(value).items():
        call = getattr(member, "fget", None) or getattr(member, "func", None) or getattr(member, "__func__", member)
        if not name.startswith("_") and isinstance(call, FunctionType):
            hints.append(typing.get_type_hints(call).get("return"))
    return [cls for hint in hints for cls in _classes(hint)]


def _classes(hint: object) -> list[type]:
    """Classes of relnav that a type hint names."""
    own = isinstance(hint, type) and hint.__module__.split(".")[0] == "relnav"
    return [typing.cast("type", hint)] * own + [cls for part in typing.get_args(hint) for cls in _classes(part)]


def names() -> str:
    """Every public name with its docstring: functions, classes, errors, the sensor packages, and what calls return."""
    found = {name: getattr(relnav, name) for name in relnav.__all__}
    modules = {name: value for name, value in found.items() if isinstance(value, ModuleType)}
    errors = [name for name, value in found.items() if isinstance(value, type) and issubclass(value, Exception)]
    classes = [name for name, value in found.items() if isinstance(value, type) and name not in errors]
    functions = [name for name in found if name not in {*modules, *errors, *classes}]
    lines: list[str] = []
    for title, group in (("Functions", functions), ("Classes", classes), ("Errors", errors)):
        lines += [f"## {title}", "", "```{eval-rst}"]
        for name in group:
            lines += _directive(f"relnav.{name}", found[name])
        lines += ["```", ""]
    told: set[int] = set()
    for name, module in modules.items():
        lines += _sensor_package(name, module, told)
    lines += ["## What calls return", "", "Classes without a public name, which what stands above gives out.", ""]
    lines += ["```{eval-rst}"]
    for cls in returned():
        lines += _directive(f"{cls.__module__}.{cls.__name__}", cls)
    return "\n".join([*lines, "```", ""])


MAKERS = {
    "commands": commands,
    "names": names,
    "keys": keys.keys,
    "messages": messages.messages,
    "shipped models": keys.shipped,
}


def linked(text: str, home: Path, page: Path) -> str:
    """Text of a file in the folder `home` with links as they must be on a page in the folder `page`."""

    def target(link: re.Match[str]) -> str:
        path = os.path.relpath(home / link[1], ROOT)
        found = ROOT / PAGES.get(path, path)
        return f"]({os.path.relpath(found, page)}" if found.exists() else link[0]

    return LINK.sub(target, text)


def _filled(app, docname, source):
    page = Path(app.env.doc2path(docname)).parent
    text = linked(source[0], page, page)
    text = FILE.sub(lambda mark: linked((ROOT / mark[1]).read_text("utf-8"), (ROOT / mark[1]).parent, page), text)
    source[0] = MARK.sub(lambda mark: MAKERS[mark[1]](), text)


def _formulas_as_they_stand(app, what, name, obj, options, lines):
    """What is indented in a docstring's text is a formula: shown letter by letter, not read as markup."""
    end = next((k - 1 for k, line in enumerate(lines) if k and line and set(line) == {"-"}), len(lines))
    text: list[str] = []
    for before, line in zip(["", *lines], lines[:end], strict=False):
        if line.startswith("    ") and not before.strip() and (not text or not text[-1].startswith("    ")):
            opened = any(earlier.strip() for earlier in text) and _last(text).startswith("    ")
            text += [] if opened else ["::", ""]
        text.append(line)
    formula = [line.startswith("    ") for line in text] + [False] * len(lines[end:])
    lines[:] = [
        line if inside or "``" in line else line.replace("|", r"\|")  # |x| is a size here, not a substitution
        for line, inside in zip([*text, *lines[end:]], formula, strict=True)
    ]


def _last(text: list[str]) -> str:
    return next(line for line in reversed(text) if line.strip())


def setup(app):
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", _formulas_as_they_stand, priority=400)
    app.connect("source-read", _filled)
    return {"version": "1", "parallel_read_safe": True}
