"""Formulas as MathML, which browsers draw by themselves: no script, no font, no network.

docutils brings the translation from LaTeX; here it is made known to Sphinx as a way to write formulas in HTML.
"""

import re

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

PAPER = re.compile(r"-(\d+)(?:-(\d+))?$")
"""Of an equation's label: the numbers that it has in its paper, cai-4-6; they are shown, Sphinx's own are not."""

SPACED = (  # docutils writes sin as a variable, without space before and after, and a bar as if it were a relation
    (
        re.compile(r"<mi>(arcsin|arccos|arctan|sin|cos|tan|exp|log|ln|arg)</mi>"),
        r'<mo lspace=".17em" rspace=".17em">\1</mo>',
    ),
    (re.compile(r"<mo([^>]*)>\|</mo>"), r'<mo\1 lspace="0" rspace="0">|</mo>'),
)

logger = logging.getLogger(__name__)


def _mathml(node: nodes.Element, *, block: bool) -> str:
    """MathML of a node's LaTeX; a warning, and the LaTeX as it stands, if it cannot be translated."""
    text = node.astext()
    if block and ("&" in text or r"\\" in text) and r"\begin" not in text:
        text = rf"\begin{{aligned}}{text}\end{{aligned}}"
    try:
        written = str(tex2mathml(text, as_block=block))
    except MathError as error:
        logger.warning("formula cannot be written as MathML: %s: %s", error, text, location=node)
        return f"<code>{text}</code>"
    for found, put in SPACED:
        written = found.sub(put, written)
    return written


def _inline(translator, node):
    translator.body.append(_mathml(node, block=False))
    raise nodes.SkipNode


def _displayed(translator, node):
    paper = PAPER.search(node.get("label") or "")
    first, last = (paper[1], paper[2]) if paper else ("", "")
    more = f"{', ' if int(last) == int(first) + 1 else ' to '}({last})" if last else ""
    number = f'<span class="eqno">({first}){more}</span>' if paper else ""
    anchor = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    translator.body.append(f'<div class="math"{anchor}>{_mathml(node, block=True)}{number}</div>\n')
    raise nodes.SkipNode


def setup(app):
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", (_inline, None), (_displayed, None))
    app.config.html_math_renderer = "mathml"
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
