"""A command is declared once: each option is a parameter of the function that it calls, or of the command itself."""

import importlib
import inspect
import sys
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, get_args

import pytest

from vispeg.cli import declared
from vispeg.cli.command import SAME, Command, Option, form, leaves
from vispeg.cli.declared import Unknown, parameters
from vispeg.cli.output import Output
from vispeg.core.errors import UserError

LEAVES = leaves()


def called(place: str):
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)


def option_names(kind) -> list[str]:
    out = []
    for field in fields(kind):
        if field.name != "output":
            out += option_names(type(field.default)) if is_dataclass(field.default) else [field.name]
    return out


@pytest.mark.parametrize("name", LEAVES)
def test_what_is_read_from_the_source_is_what_python_has(name):
    command = LEAVES[name]
    for place in (command.place, *command.functions):
        real = inspect.signature(called(place)).parameters
        read = parameters(place)
        assert [*read] == [*real]
        for key, parameter in read.items():
            default = real[key].default
            if default is inspect.Parameter.empty:
                assert parameter.default is MISSING, key
            elif parameter.default is Unknown or callable(default):
                assert key not in command.taken(), key
            else:
                assert parameter.default == default and type(parameter.default) is type(default), key


@pytest.mark.parametrize("name", LEAVES)
def test_every_option_is_one_parameter_with_its_default(name):
    command = LEAVES[name]
    own = {k: v for k, v in inspect.signature(called(command.place)).parameters.items() if k != "call"}
    theirs: dict[str, inspect.Parameter] = {}
    for function in command.functions:
        there = inspect.signature(called(function)).parameters
        options = [k for k in theirs.keys() & there.keys() if k in command.taken()]
        assert all(theirs[k].default == there[k].default for k in options), "one option, two defaults"
        theirs = {**there, **theirs}
    assert not own.keys() & theirs.keys(), "declared twice"
    assert command.special.keys() <= {*own, *theirs}, "an option of no parameter"
    there = {**own, **theirs}
    options = {}
    for key, parameter in there.items():
        option = command.special.get(key, Option())
        if option is not None and key in command.taken():
            options[(option.name or key).replace("-", "_")] = parameter, option
    assert sorted(option_names(form(command))) == sorted(options)
    for key, (parameter, option, kind) in command.taken().items():
        default = parameter.default if option.default is SAME else option.default
        assert default is not None or NoneType in get_args(kind), f"{key} may be none by default, and not by its type"
    for key, field in fields_of(form(command)).items():
        parameter, option = options[key]
        said: Any = MISSING if parameter.default is inspect.Parameter.empty else parameter.default
        assert not callable(said) or said is MISSING, f"{key} is private"
        if option.default is SAME:
            assert field == (Path(said) if isinstance(field, Path) else said), key
        else:
            assert field == option.default != said, f"{key}: another default is stated, and is none"


def fields_of(kind) -> dict[str, object]:
    out = {}
    for field in fields(kind):
        if is_dataclass(field.default) and field.name != "output":
            out.update(fields_of(type(field.default)))
        elif field.name != "output":
            out[field.name] = field.default
    return out


@pytest.mark.parametrize("name", LEAVES)
def test_every_option_is_explained(name):
    for key, (parameter, _, _) in LEAVES[name].taken().items():
        assert len(parameter.help) > 5 and parameter.help.endswith("."), key


def test_a_folder_that_an_older_version_left_is_no_package(tmp_path, monkeypatch):
    package = tmp_path / "left_over"
    (package / "tools" / "__pycache__").mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "tools.py").write_text(
        'def f(n: int = 3) -> None:\n    """Do.\n\n    Args:\n        n: how often.\n    """\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert parameters("left_over.tools:f")["n"].default == 3


@pytest.mark.parametrize(("hint", "ok"), [("list[Path]", True), ("Sequence[str]", True), ("set[str]", False)])
def test_a_list_takes_several_values_but_not_none(tmp_path, monkeypatch, hint, ok):
    """A type that no argument can have is named where the command is declared, not left out."""
    (tmp_path / "counting.py").write_text(
        "from collections.abc import Sequence\nfrom pathlib import Path\n\n"
        f'def count(files: {hint}) -> int:\n    """Count.\n\n    Args:\n        files: what to count.\n    """\n'
        '    return len(files)\n\ndef show(call) -> int:\n    """Count."""\n    return call()\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "counting", raising=False)
    for read in (declared.parameters, declared._tree):
        read.cache_clear()
    command = Command("counting:show", ["counting:count"], ["files"], {})
    if not ok:
        with pytest.raises(AssertionError, match="counting:show: no argument can have the type of .'files'."):
            form(command)
        return
    assert command.run(form(command)(files=("a", "b"), output=Output())) == 2
    with pytest.raises(UserError, match="FILES: nothing given; expected at least one"):
        command.run(form(command)(files=(), output=Output()))
