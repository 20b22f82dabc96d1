"""The notebooks that the site offers are made from pages and scripts: the same code, the same output, and they run."""

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SPEC = importlib.util.spec_from_file_location("notebooks", ROOT / "docs" / "_ext" / "notebooks.py")
notebooks = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(notebooks)


def read(name):
    """As Jupyter reads the file."""
    found = json.loads(json.dumps(notebooks.notebook(name)))
    assert (found["nbformat"], found["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in found["cells"]}) == len(found["cells"])
    return found["cells"]


def code(cells):
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


@pytest.mark.parametrize("name", notebooks.names())
def test_it_is_the_page(name):
    cells, page = read(name), (ROOT / "docs" / "tutorials" / f"{name}.md").read_text(encoding="utf-8")
    script = (ROOT / "examples" / f"{name}.py").read_text(encoding="utf-8")
    *_, definitions, call = code(cells)
    assert script.startswith(definitions)
    assert script[len(definitions) :].strip().startswith('if __name__ == "__main__":')
    assert call == "main()"
    said = "".join(cells[-1]["outputs"][0]["text"]) if cells[-1]["cell_type"] == "code" else ""
    said = said or next("".join(cell["outputs"][0]["text"]) for cell in cells if cell.get("outputs"))
    assert said.strip()
    assert said.rstrip() in page
    assert cells[0]["source"][0] == page.splitlines(keepends=True)[0].rstrip("\n") + "\n"


def test_one_runs_and_prints_what_it_shows(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    cells, names = read("filter_your_log"), {"__name__": "__main__"}
    for text in code(cells):
        exec(compile(text, "cell", "exec"), names)
    said = next("".join(cell["outputs"][0]["text"]) for cell in cells if cell.get("outputs"))
    assert capsys.readouterr().out == said
