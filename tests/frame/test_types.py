"""The public face is typed."""

import ast
import inspect
import re
from pathlib import Path

import pytest

import vispeg

ROOM = Path(__file__).parents[2] / "vispeg"


@pytest.mark.parametrize("name", [n for n in vispeg.__all__ if n != "effects"])
def test_the_public_face_is_typed(name):
    value = getattr(vispeg, name)
    signature = inspect.signature(value)
    assert inspect.isclass(value) or signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty, parameter
    assert "dict[str, Any]" not in str(signature)


def public(tree):
    """Functions of a module, and of its classes, whose names have no underscore in front."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public(node)
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node


@pytest.mark.parametrize("file", sorted((ROOM / "api").rglob("*.py")), ids=lambda file: file.stem)
def test_what_commands_do_is_typed_from_python(file):
    for function in public(ast.parse(file.read_text(encoding="utf-8"))):
        given = function.args
        others = [a for a in (*given.posonlyargs, *given.args, *given.kwonlyargs) if a.arg not in ("self", "cls")]
        hints = [a.annotation for a in (*others, given.vararg, given.kwarg) if a is not None]
        assert None not in hints and function.returns is not None, function.name
        text = " ".join(map(ast.unparse, [*hints, function.returns]))
        assert "dict[str, Any]" not in text, function.name


def test_what_the_type_checker_is_told_to_ignore_has_a_reason():
    """One rule, and in the same comment why it is wrong there."""
    bare = re.compile(r"# (type|pyright): ignore(?!\[[\w-]+\]  # \w)")
    files = {path.relative_to(ROOM): path.read_text(encoding="utf-8") for path in ROOM.rglob("*.py")}
    found = [
        f"{path}:{n}" for path, text in files.items() for n, line in enumerate(text.split("\n"), 1) if bare.search(line)
    ]
    assert not found
