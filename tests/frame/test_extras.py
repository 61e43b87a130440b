"""Every extra is there for something: the package, or a test of it, imports what it installs."""

import ast
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
THROUGH = {"tensorboard": "torch", "onnx": "torch"}  # what imports it when it writes logs and networks


@cache
def imported(room: str) -> set[str]:
    """Top-level names that a folder's files import, wherever in them."""
    found = set()
    for path in (ROOT / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(str(node.module).partition(".")[0])
            elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("import_module", "importorskip"):
                found |= {a.value.partition(".")[0] for a in node.args if isinstance(a, ast.Constant)}
    return found


@pytest.mark.parametrize("extra", sorted(set(EXTRAS) - {"all", "dev"}))
def test_every_extra_is_used(extra):
    names = {re.split(r"[\[<>=!~ ]", text)[0].replace("-", "_").lower() for text in EXTRAS[extra]}
    ours, tried = imported("vispeg"), imported("tests")
    assert names & ours, f"nothing of '{extra}' is imported"
    unused = {name for name in names - ours - tried if THROUGH.get(name) not in names}
    assert not unused, f"'{extra}' installs what nothing imports"
