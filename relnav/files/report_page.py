"""One self-contained page: what it is made of, put together so that nothing in it can be taken for a program.

Words of others go through `html.escape`; data are JSON in which no `<` is left; and the page forbids itself, by a
content security policy, every script but the two whose hashes it states, and the network.
"""

import base64
import hashlib
import html
import json
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any

from relnav.errors import UsageError
from relnav.files.atomic import is_stream, replacing
from relnav.files.tables import relnav_version
from relnav.files.wording import printable


def check_page(path: Path) -> None:
    """Refuse a page of another kind.

    Raises
    ------
    UsageError
        Naming the ending.
    """
    if path.suffix.lower() not in (".html", ".htm") and not is_stream(path):
        raise UsageError(f"{path}: a page ends in .html; got '{path.suffix}'")


def words(text: object) -> str:
    """Text for the page: visible characters, none of them markup."""
    return html.escape(printable(text))


def data_block(data: Any) -> str:
    """Data as the page carries them."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    escaped = text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
    return f'<script type="application/json" id="data">{escaped}</script>'


def table(
    head: Iterable[str], rows: Iterable[Iterable[object]], numeric: tuple[int, ...] = (), classes: str = "scroll"
) -> str:
    """A table of words; columns named in `numeric` are set as numbers. `Markup` cells are taken as they are."""
    top = "".join(f"<th{' class=n' if k in numeric else ''}>{words(cell)}</th>" for k, cell in enumerate(head))
    body = "".join(
        "<tr>"
        + "".join(
            f"<td{' class=n' if k in numeric else ''}>{cell if isinstance(cell, Markup) else words(cell)}</td>"
            for k, cell in enumerate(row)
        )
        + "</tr>"
        for row in rows
    )
    return f'<div class="{classes}"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def numbered(texts: Iterable[str]) -> str:
    """Sentences under numbers, to which a table refers."""
    return f'<ol class="soft">{"".join(f"<li>{words(text)}</li>" for text in texts)}</ol>'


def key_cell(key: str) -> "Markup":
    """A key of a model file, which may go on in another line behind a point or an underscore."""
    return Markup(words(key).replace(".", ".<wbr>").replace("_", "_<wbr>"))


class Markup(str):
    """Markup of our own, which holds no words of others."""


def tile(name: str, value: str, note: str = "", verdict: str = "") -> str:
    """A figure of the summary; verdict "good" or "bad" colours it."""
    return (
        f'<div class="tile"><span class="soft">{words(name)}</span><b class="{words(verdict)}">{words(value)}</b>'
        f'<span class="soft">{words(note)}</span></div>'
    )


def paragraph(text: str) -> str:
    """A sentence or two for the reader."""
    return f'<p class="soft">{words(text)}</p>'


def section(title: str, *parts: str) -> str:
    """A titled part of the page."""
    return f"<section><h2>{words(title)}</h2>{''.join(parts)}</section>"


def toolbar(label: str, said: str, *buttons: tuple[str, str, str], classes: str = "tools") -> str:
    """Buttons by id, what they do and key, and a place with the id `said` for words."""
    made = "".join(
        f'<button id="{name}">{words(what)}<span class="key"> ({words(key)})</span></button>'
        for name, what, key in buttons
    )
    room = f'<span class="soft" id="{said}" role="status"></span>'
    return f'<div class="{classes}" role="toolbar" aria-label="{words(label)}">{made}{room}</div>'


def write_page(path: Path, title: str, lead: str, body: str, data: Any = None) -> None:
    """Write the page, whole or not at all; with data it draws charts."""
    room = files("relnav.files") / "report"
    css = (room / "page.css").read_text(encoding="utf-8")
    if data is not None:
        css = (room / "uplot" / "uPlot.min.css").read_text(encoding="utf-8") + css
    library = (room / "uplot" / "uPlot.iife.min.js").read_text(encoding="utf-8")
    licence = (room / "uplot" / "LICENSE").read_text(encoding="utf-8")
    scripts = [library, (room / "page.js").read_text(encoding="utf-8")] if data is not None else []
    assert not any("</script" in script for script in scripts)
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'" for s in scripts)
    allowed = hashes or "'none'"
    policy = f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data:"
    running = "".join(f"<script>{script}</script>\n" for script in scripts)
    credit = f"<details><summary>Charts by uPlot, MIT licence</summary><pre>{words_of(licence)}</pre></details>"
    page = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>{words(title)}</title>
<style>{css}</style>
</head>
<body>
<header><h1>{words(title)}</h1><p class="soft">{words(lead)}</p></header>
<main>{body}</main>
<footer><p>Made by relnav {words(relnav_version())}. This file holds all it needs and asks no network for anything.</p>
{credit if data is not None else ""}</footer>
{data_block(data) if data is not None else ""}
{running}</body>
</html>
"""
    with replacing(path, ".html") as temporary:
        temporary.write_text(page, encoding="utf-8")


def words_of(text: str) -> str:
    """A text of several lines."""
    return "\n".join(words(line) for line in text.splitlines())
