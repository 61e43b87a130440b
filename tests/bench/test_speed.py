"""Benchmarks of speed fill a page, each its own place."""

import ast
import re
from pathlib import Path

import pytest
from speed import BENCHES, filled

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "results" / "speed.md"


def test_every_benchmark_is_a_script_and_has_one_place_on_the_page():
    page = PAGE.read_text(encoding="utf-8")
    for name, (script, *_) in BENCHES.items():
        assert (ROOT / "scripts" / "bench" / script).is_file()
        assert f"| {name}" in filled(page, name, f"| {name}")
        assert f"scripts/bench/{script}" in page


def test_the_tables_on_the_page_are_those_that_the_benchmarks_print():
    page = PAGE.read_text(encoding="utf-8")
    for name, (script, *_) in BENCHES.items():
        place = re.search(f"<!-- measured: {name} -->\n(.*?)<!-- end -->", page, re.DOTALL)
        assert place is not None
        heads = re.findall(r"^(\|.+\|)\n\|(?:---\|)+$", place[1], re.MULTILINE)
        assert heads
        code = ast.walk(ast.parse((ROOT / "scripts" / "bench" / script).read_text(encoding="utf-8")))
        texts = [n.value for n in code if isinstance(n, ast.Constant) and isinstance(n.value, str)]
        for head in heads:
            assert any(head in text for text in texts), f"{script}: {head}"


def test_a_place_is_filled_anew_and_the_rest_stays():
    page = "a\n<!-- measured: x -->\nold \\1\n<!-- end -->\nb\n<!-- measured: y -->\n<!-- end -->\n"
    once = filled(page, "x", "new \\1\n")
    assert once == "a\n<!-- measured: x -->\nnew \\1\n<!-- end -->\nb\n<!-- measured: y -->\n<!-- end -->\n"
    assert filled(once, "x", "new \\1") == once
    for wrong in ("", page + page):
        with pytest.raises(ValueError, match="not one"):
            filled(wrong, "x", "")
