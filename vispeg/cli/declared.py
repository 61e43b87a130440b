"""The parameters of a function, read from its source: to import what it needs takes seconds, which help must not.

Types and defaults are those that the function has when it is imported; `tests/cli/test_declarations.py` holds that.
"""

from __future__ import annotations

import ast
import builtins
import importlib
import importlib.util
import re
from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from docstring_parser.google import parse

PLAIN = ("typing", "collections.abc", "pathlib")  # whose names are types by themselves
SAME = re.compile(r"(?:as )?(?:in|for) `(\w+\.[\w.]+)`\.?")  # a docstring's pointer to another function's


class Unknown:
    """Stands for a type that no argument of a command can have."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a function.

    Attributes:
        hint: its type, in which `Unknown` stands for each class of this or another package.
        default: MISSING where it is required, `Unknown` where it is no plain value.
        help: what the docstring says of it.
    """

    name: str
    hint: Any
    default: Any
    help: str


@cache
def parameters(place: str) -> dict[str, Parameter]:
    """Give name -> parameter of a function or of a dataclass at a place, MODULE:NAME."""
    module, _, name = place.partition(":")
    body = _tree(module).body
    node = next(n for n in body if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name == name)
    names, said = _Names(module), _said(ast.get_docstring(node) or "")
    found = {}
    for key, annotation, default in _stated(node):
        value: Any = MISSING if default is None else names.evaluated(default)
        hint = Unknown if annotation is None else names.evaluated(annotation)
        found[key] = Parameter(key, hint, value, said.get(key, ""))
    return found


def _stated(node: ast.FunctionDef | ast.ClassDef) -> Iterator[tuple[str, ast.expr | None, ast.expr | None]]:
    """Yield name, annotation and default of each parameter."""
    if isinstance(node, ast.ClassDef):
        for each in node.body:
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
                yield each.target.id, each.annotation, each.value
        return
    positional = [*node.args.posonlyargs, *node.args.args]
    absent = [None] * (len(positional) - len(node.args.defaults))
    defaults = [*absent, *node.args.defaults, *node.args.kw_defaults]
    for arg, default in zip([*positional, *node.args.kwonlyargs], defaults, strict=True):
        yield arg.arg, arg.annotation, default


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(_file(module).read_text(encoding="utf-8"))


def _file(module: str) -> Path:
    """Give the file of a module or package, without importing the packages that it is in."""
    top, *below = module.split(".")
    spec = importlib.util.find_spec(top)
    assert spec is not None and spec.origin is not None, module
    if not below:
        return Path(spec.origin)
    path = Path(spec.origin).parent.joinpath(*below)
    package = path / "__init__.py"  # a folder alone may be what an older version has left
    return package if package.is_file() else path.with_suffix(".py")


def _said(text: str) -> dict[str, str]:
    """Give parameter -> what a docstring says of it, there or where it points to."""
    found = {}
    for entry in parse(text).params:
        about = " ".join((entry.description or "").split())
        same = SAME.fullmatch(about)
        there = parameters(_place(same[1])) if same else {}
        for name in entry.arg_name.split(", "):
            found[name] = there[name].help if same else about
    return found


def _place(name: str) -> str:
    """Give MODULE:FUNCTION of a dotted name, of the public face too."""
    module, _, function = name.rpartition(".")
    if module == "vispeg":
        from vispeg import _PLACES

        module = _PLACES[function]
    return f"{module}:{function}"


class _Names(dict[str, Any]):
    """Names bound in a module, resolved without importing it."""

    def __init__(self, module: str):
        super().__init__()
        self.module = module

    def evaluated(self, node: ast.expr) -> Any:
        """Give the value of an expression; `Unknown` where it has a part that is none."""
        try:
            value = eval(compile(ast.Expression(node), self.module, "eval"), {}, self)  # of this package's own source
            return Unknown if isinstance(value, Unknown) else value
        except (TypeError, AttributeError):
            return Unknown

    def __missing__(self, name: str) -> Any:
        for node in _statements(_tree(self.module)):
            if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == name for t in node.targets):
                return self.evaluated(node.value)
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                for alias in node.names:
                    if name == (alias.asname or alias.name):
                        return _imported(node.module, alias.name)
        if hasattr(builtins, name):
            raise KeyError(name)
        return Unknown


class _Module:
    """Stands for a module of this package in an expression."""

    def __init__(self, module: str):
        self._names = _Names(module)

    def __getattr__(self, name: str) -> Any:
        return self._names[name]


def _imported(module: str, name: str) -> Any:
    if module in PLAIN:
        return getattr(importlib.import_module(module), name)
    if not module.startswith("vispeg."):
        return Unknown
    below = f"{module}.{name}"
    return _Module(below) if _file(below).exists() else _Names(module)[name]


def _statements(tree: ast.Module) -> Iterator[ast.stmt]:
    """Yield the statements of a module, those below `if TYPE_CHECKING` too."""
    for node in tree.body:
        yield from node.body if isinstance(node, ast.If) else [node]
