"""The example notebooks run from top to bottom, and what a cell ends with is shown and stored, figures too."""

import ast
import json
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "examples"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_there_are_three():
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    names: dict = {"__name__": "__main__"}
    shown = []
    for number, cell in enumerate(c for c in notebook["cells"] if c["cell_type"] == "code"):
        tree = ast.parse("".join(cell["source"]), f"{path.name}, cell {number}")
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, path.name, "exec"), names)
        if last is not None:
            (stored,) = cell["outputs"]
            value = eval(compile(ast.Expression(last.value), path.name, "eval"), names)
            html = getattr(value, "_repr_html_", lambda: None)()
            assert "text/plain" in stored["data"] and ("text/html" in stored["data"]) == bool(html)
            assert ("image/png" in stored["data"]) == hasattr(value, "_repr_png_")
            shown.append(html or repr(value))
    assert any(text.startswith('<div class="vispeg">') for text in shown)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_has_its_figures(path):
    """As a reader sees it who runs nothing; without a place of the machine that ran it."""
    text = path.read_text(encoding="utf-8")
    data = [o["data"] for c in json.loads(text)["cells"] for o in c.get("outputs", ())]
    assert any("image/png" in each for each in data) and "/tmp/" not in text and "/home/" not in text
