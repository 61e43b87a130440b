"""Imports that wait inside functions name what there is: a move of a module breaks no command in silence."""

import ast
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted(p for folder in ("vispeg", "scripts", "docs/examples") for p in (ROOT / folder).rglob("*.py"))


def imported(path):
    """(module, name) of each import of the package in a file, wherever it stands."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and not node.level and (node.module or "").split(".")[0] == "vispeg":
            yield from ((node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names if alias.name.split(".")[0] == "vispeg")


def resolves(module, name):
    """Whether the module is there and has the name."""
    try:
        if find_spec(module) is None:
            return False
    except ModuleNotFoundError:
        return False
    return name is None or hasattr(import_module(module), name) or find_spec(f"{module}.{name}") is not None


def test_every_import_of_the_package_resolves():
    pytest.importorskip("torch")
    wanted = {pair: path for path in FILES for pair in imported(path)}
    missing = [f"{p.relative_to(ROOT)}: from {m} import {n}" for (m, n), p in wanted.items() if not resolves(m, n)]
    assert not missing and len(wanted) > 1000
