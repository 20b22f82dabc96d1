"""A notebook for each tutorial, made from its page and its script when the site is built (nbformat 4.5, plain JSON).

Prose becomes text cells, the script one code cell and its call another, whose output is what the page says it prints.
"""

import json
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^```[^\n]*\n.*?^```$\n?", re.MULTILINE | re.DOTALL)
GUARD = '\n\nif __name__ == "__main__":'
LINK = re.compile(r"\[([^\]]*)\]\((?!https?:)[^)]*\)")
PLACE = "Start Jupyter in a checkout of relnav, in whose folder `examples` this notebook finds its data."


def _cell(kind: str, text: str, **more: Any) -> dict[str, Any]:
    return {"cell_type": kind, "metadata": {}, "source": text.strip("\n").splitlines(keepends=True), **more}


def _code(text: str, printed: str = "") -> dict[str, Any]:
    said = {"output_type": "stream", "name": "stdout", "text": printed.splitlines(keepends=True)}
    return _cell("code", text, execution_count=None, outputs=[said] if printed else [])


def script_of(name: str) -> str:
    """The script of a tutorial, without the lines that run it from a command line."""
    return (ROOT / "examples" / f"{name}.py").read_text("utf-8").partition(GUARD)[0].rstrip("\n") + "\n"


def printed_by(page: str) -> str:
    """What a page says that its script prints."""
    _, _, after = page.partition('["main"]()\n')
    return after.partition("\n\n")[0].rstrip("\n") + "\n"


def notebook(name: str) -> dict[str, Any]:
    """The notebook of a tutorial as it stands in its file."""
    page = (ROOT / "docs" / "tutorials" / f"{name}.md").read_text("utf-8")
    cells, at = [], 0

    def prose(text: str) -> None:
        text = LINK.sub(r"\1", text).replace("What it prints:", "").strip()
        if text:
            cells.append(_cell("markdown", text))

    for fence in FENCE.finditer(page):
        prose(page[at : fence.start()])
        at = fence.end()
        if "literalinclude" in fence[0]:
            script = script_of(name)
            if "__file__" in script:
                cells.append(_cell("markdown", PLACE))
                cells.append(_code(f'__file__ = "examples/{name}.py"'))
            cells += [_code(script), _code("main()", printed_by(page))]
        elif "run_path" not in fence[0]:
            cells.append(_cell("markdown", fence[0]))
    prose(page[at:])
    for number, cell in enumerate(cells):
        cell["id"] = f"{name[:40]}-{number}".replace("_", "-")
    about = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return {"nbformat": 4, "nbformat_minor": 5, "metadata": about, "cells": cells}


def names() -> list[str]:
    """Every tutorial."""
    return sorted(path.stem for path in (ROOT / "docs" / "tutorials").glob("*.md") if path.stem != "index")


def _linked(app, docname, source):
    folder, _, name = docname.rpartition("/")
    if folder == "tutorials" and name in names():
        link = f'<a class="reference download" href="{name}.ipynb" download="{name}.ipynb">as a notebook</a>'
        source[0] = re.sub(r"^(The script, \[.*\)):$", rf"\1, or {link}:", source[0], flags=re.MULTILINE)


def _written(app, error):
    if error is None and app.builder.format == "html":
        for name in names():
            text = json.dumps(notebook(name), indent=1, ensure_ascii=False) + "\n"
            (Path(app.outdir) / "tutorials" / f"{name}.ipynb").write_text(text, encoding="utf-8")


def setup(app):
    """Called by Sphinx."""
    app.connect("source-read", _linked, priority=400)
    app.connect("build-finished", _written)
    return {"version": "1", "parallel_read_safe": True}
