"""Pages that promise figures name the tests that hold them, and those tests are there."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("page", ["measure"])
def test_every_test_that_a_page_names_is_collected(page):
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    rows = text.split("\n## Checks\n")[1].split("\n## ")[0]
    rows = [line for line in rows.splitlines() if line.startswith("| ")][1:]
    assert rows
    for line in rows:
        named = re.findall(r"`(tests/[^`]+)`", line)
        assert named, line
        for name in named:
            file, _, test = name.partition("::")
            functions = [
                n.name for n in ast.parse((ROOT / file).read_text(encoding="utf-8")).body if hasattr(n, "name")
            ]
            assert Path(file).name.startswith("test_"), name
            assert test in functions if test else any(f.startswith("test_") for f in functions), name
