"""Read the parameters of a function from its source, because importing its dependencies would take seconds.

Types and defaults equal those of the imported function; `tests/cli/test_declarations.py` checks this.
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

PLAIN = ("typing", "collections.abc", "pathlib")  # modules from which types are imported for evaluation
SAME = re.compile(r"(?:as )?(?:in|for) `(\w+\.[\w.]+)`\.?")  # a docstring's reference to another function


class Unknown:
    """Stand for a type that no argument of a command can have."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a function.

    Attributes:
        name: name of the parameter.
        hint: its type, with `Unknown` in place of classes of this or other packages.
        default: its default; MISSING if required, `Unknown` if it cannot be evaluated.
        help: its description in the docstring.
    """

    name: str
    hint: Any
    default: Any
    help: str


@cache
def parameters(place: str) -> dict[str, Parameter]:
    """Return name -> parameter of the function or dataclass at MODULE:NAME."""
    module, _, name = place.partition(":")
    body = _tree(module).body
    node = next(n for n in body if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name == name)
    names, descriptions = _Names(module), _descriptions(ast.get_docstring(node) or "")
    found = {}
    for key, annotation, default in _stated(node):
        value: Any = MISSING if default is None else names.evaluated(default)
        hint = Unknown if annotation is None else names.evaluated(annotation)
        found[key] = Parameter(key, hint, value, descriptions.get(key, ""))
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
    """Return the file of a module or package, without importing its parent packages."""
    top, *below = module.split(".")
    spec = importlib.util.find_spec(top)
    assert spec is not None and spec.origin is not None, module
    if not below:
        return Path(spec.origin)
    path = Path(spec.origin).parent.joinpath(*below)
    package = path / "__init__.py"  # a folder without this file may be left over from an older version
    return package if package.is_file() else path.with_suffix(".py")


def _descriptions(text: str) -> dict[str, str]:
    """Return parameter -> its description in a docstring, or in the docstring that it refers to."""
    found = {}
    for entry in parse(text).params:
        about = " ".join((entry.description or "").split())
        same = SAME.fullmatch(about)
        referred = parameters(_place(same[1])) if same else {}
        for name in entry.arg_name.split(", "):
            found[name] = referred[name].help if same else about
    return found


def _place(name: str) -> str:
    """Return MODULE:FUNCTION for a dotted name, including names such as `vispeg.NAME`."""
    module, _, function = name.rpartition(".")
    if module == "vispeg":
        from vispeg import _PLACES

        module = _PLACES[function]
    return f"{module}:{function}"


class _Names(dict[str, Any]):
    """The names bound in a module, resolved without importing it."""

    def __init__(self, module: str):
        super().__init__()
        self.module = module

    def evaluated(self, node: ast.expr) -> Any:
        """Return the value of an expression; `Unknown` if it cannot be evaluated."""
        try:
            # safe, as it is this package's source
            value = eval(compile(ast.Expression(node), self.module, "eval"), {}, self)
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
    """Stand for a module of this package in an expression."""

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
    """Yield the statements of a module, including those under `if TYPE_CHECKING`."""
    for node in tree.body:
        yield from node.body if isinstance(node, ast.If) else [node]
