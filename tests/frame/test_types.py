"""Typed from birth: untyped mappings become fewer, and the public face has none."""

import inspect
from pathlib import Path

import pytest

import vispeg

ROOM = Path(__file__).parents[2] / "vispeg"
LEFT = 29  # `dict[str, Any]` in the package; lower it with every one that gets a type


def test_untyped_mappings_become_fewer():
    count = sum(path.read_text(encoding="utf-8").count("dict[str, Any]") for path in ROOM.rglob("*.py"))
    assert count <= LEFT, "give the mapping a type: a dataclass, a TypedDict, or Mapping[str, object]"


@pytest.mark.parametrize("name", [n for n in vispeg.__all__ if n != "effects"])
def test_the_public_face_is_typed(name):
    value = getattr(vispeg, name)
    signature = inspect.signature(value)
    assert inspect.isclass(value) or signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty, parameter
    assert "dict[str, Any]" not in str(signature)
