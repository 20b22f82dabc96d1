"""Sentences of pages and public docstrings can be read at first sight: none has more than forty words."""

import inspect
import re
from pathlib import Path
from types import ModuleType

import pytest

import relnav

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "ARCHITECTURE.md",
    ROOT / "CHANGELOG.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "models" / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
LONGEST = 40

FENCE = re.compile(r"^ *(```|~~~).*?^ *\1[^\n]*$|^\$\$.*?^\$\$|^<!--.*?-->", re.MULTILINE | re.DOTALL)
ABBREVIATION = re.compile(r"\b(?:e\.g|i\.e|et al|cf|eq|eqs|fig|no|ch|sec|vs|p|pp)\.$")


def blocks(text):
    """Paragraphs, list items, table cells and headings, one string each."""
    text = FENCE.sub("\n\n", text)
    for part in re.split(r"\n\s*\n|\n(?= *(?:[-*]|\d+\.) )|\n(?=#)|(?<=\n)(?=\|)", text):
        if part.lstrip().startswith("|"):
            yield from (cell for row in part.splitlines() for cell in row.strip().strip("|").split(" | "))
        elif not part.startswith("    "):
            yield re.sub(r"^ *(?:[-*]|\d+\.|#+) ", "", part)


def sentences(block):
    """A block cut at full stops, question and exclamation marks; a colon or semicolon is no end."""
    block = re.sub(r"`[^`]*`", "code", block)  # code counts as one word
    block = re.sub(r"\$[^$]*\$", "formula", block)
    block = re.sub(r"\]\([^)]*\)", "]", block)
    sentence = []
    for word in block.split():
        sentence.append(word)
        if re.search(r"[.?!][)\"'*_\]]*$", word) and not ABBREVIATION.search(word):
            yield sentence
            sentence = []
    if sentence:
        yield sentence


def words(sentence):
    """What is read as a word; dashes, signs and pipes are not."""
    return [word for word in sentence if re.search(r"\w", word)]


def long_ones(page):
    found = (s for block in blocks(page.read_text(encoding="utf-8")) for s in sentences(block))
    return [" ".join(s) for s in found if len(words(s)) > LONGEST]


def test_a_sentence_is_counted_as_a_reader_does():
    assert [len(words(s)) for s in sentences("One `a b c` of 0.5 m (e.g. two). And *three.* Four")] == [7, 2, 1]
    text = "# A\n\n- c\n- d e\n\n```\nf\n```\n| g | h |\n| - | - |\n"
    assert [part.strip() for part in blocks(text) if part.strip()] == ["A", "c", "d e", "g", "h", "-", "-"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_sentence_is_too_long(page):
    found = long_ones(page)
    assert found == [], "\n\n".join(found)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_lists_are_lists(page):
    """No paragraph holds the items of a numbered list, nor the spaces that such a list leaves when it is wrapped."""
    run_in = []
    for part in re.split(r"\n\s*\n|\n(?= *(?:[-*]|\d+\.) )", FENCE.sub("\n\n", page.read_text(encoding="utf-8"))):
        if not part.lstrip().startswith(("|", "```", "$$")) and not part.startswith("    "):
            text = re.sub(r"`[^`]*`", "code", part.strip())
            run_in += re.findall(r".{0,40}[.:;] 2\. \w.{0,20}", text)  # a second item inside a line
            run_in += re.findall(r".{0,30}\w[,;:.]? {2,}\w.{0,20}", text)
    assert run_in == []


def documented():
    """(name, docstring) of every public function, class, method and property."""
    found = {f"relnav.{name}": getattr(relnav, name) for name in relnav.__all__}
    for name, module in [*found.items()]:
        if isinstance(module, ModuleType):
            found |= {f"{name}.{inner}": getattr(module, inner) for inner in module.__all__}
    for name, value in [*found.items()]:
        if isinstance(value, type):
            found |= {f"{name}.{inner}": own for inner, own in vars(value).items() if not inner.startswith("_")}
    own = {name: value for name, value in found.items() if inspect.getdoc(value) != inspect.getdoc(type(value))}
    texts = ((name, inspect.getdoc(value) or "") for name, value in own.items())  # not what Python says of a dict
    return [(name, text) for name, text in texts if re.search(r"\.\s|\.$", text)]


def test_no_public_docstring_has_a_longer_one():
    assert len(documented()) > 150
    for name, text in documented():
        text = re.sub(r"^( *[\w, ]+ : .*|.*\n *-{3,})$", "\n", text, flags=re.MULTILINE)  # parameters, headings
        for block in blocks("\n".join(line.strip() for line in text.splitlines())):
            for sentence in sentences(block):
                assert len(words(sentence)) <= LONGEST, f"{name}: {' '.join(sentence)}"
