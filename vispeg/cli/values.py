"""Refuse option values that no command can use: impossible paths, and absurdly large numbers.

A leading `~` is replaced by the home folder here, for all commands, because shells do not expand it in `--out=~/x`.
"""

from __future__ import annotations

import math
import os
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.core.seeds import check_seed

# Larger than every quantity of an arm in SI units (a steel contact's stiffness is 1e8 N/m), and than every count that a
# run can finish; a larger value is a typing error or in another unit.
LARGEST = 1e9
LONGEST_NAME, LONGEST_PATH = 255, 4095  # limits of Linux file systems, bytes


def checked(args: Any) -> Any:
    """Check a command's dataclass, including groups of options; return it with home folders in place of `~`.

    Raises:
        UserError: an impossible value; the error names the option and what is expected.
    """
    new = {}
    for field in fields(args):
        name, value = f"--{field.name.replace('_', '-')}", getattr(args, field.name)
        if is_dataclass(value):
            new[field.name] = checked(value)
        elif isinstance(value, tuple):
            new[field.name] = tuple(_checked(name, each) for each in value)
        else:
            new[field.name] = _checked(name, value)
    changed = {name: value for name, value in new.items() if value is not getattr(args, name)}
    return replace(args, **changed) if changed else args


def _checked(name: str, value: Any) -> Any:
    """Check one value of an option; return it with the home folder in place of `~`."""
    if isinstance(value, str | Path):
        _check_text(name, str(value), isinstance(value, Path))
        return type(value)(expanded(value, key=name)) if str(value).startswith("~") else value
    if isinstance(value, int | float) and not isinstance(value, bool):
        _check_number(name, value)
    return value


def _check_text(name: str, text: str, path: bool) -> None:
    shown = text.encode("utf-8", "backslashreplace").decode()
    shown = shown if len(shown) < 80 else f"{shown[:40]}... ({len(text)} characters)"
    if "\0" in text:
        raise UserError("holds a zero byte", key=name, got=shown.replace("\0", "\\0"))
    try:
        size = len(text.encode("utf-8"))
    except UnicodeEncodeError:  # results record their command and inputs in UTF-8
        raise UserError("is not UTF-8", key=name, got=shown, expected="a name in UTF-8; rename the file") from None
    longest = max((len(os.fsencode(part)) for part in Path(text).parts), default=0)
    if (path or os.sep in text) and (longest > LONGEST_NAME or size > LONGEST_PATH):
        expected = f"names of at most {LONGEST_NAME} bytes, {LONGEST_PATH} in all"
        raise UserError("is too long for a path", key=name, got=shown, expected=expected)


def _check_number(name: str, value: float) -> None:
    if isinstance(value, float) and math.isnan(value):
        raise UserError("is not a number", key=name, got="nan")
    whole = isinstance(value, int)
    if name == "--seed":
        check_seed(value, name)
    if name not in ("--seed", "--port") and (abs(value) > LARGEST or (whole and value < 0)):
        low = "0" if whole else f"-{LARGEST:g}"
        raise UserError("out of range", key=name, got=f"{value:g}", expected=f"{low} to {LARGEST:g}")
