"""An effect in words taken from its file: title, summary, place and size.

The title is the first line of the file up to its colon ("Coulomb friction: `tau = ...`"), the summary the first line of
the class's docstring. So a new effect needs no change here.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Mapping
from typing import Any

from vispeg.core.effect import REGISTRY, Effect
from vispeg.report.record import params_of
from vispeg.report.text.quantities import number, plain, quantity

TITLE = re.compile(r"[A-Z][\w -]{2,38}")  # a title is a few plain words
NUMBERED = re.compile(r"([a-z]{4,}?)_?(\d+)")  # a word and a number; a short name such as `l1` stays as it is


def summary(kind: Effect) -> str:
    """Return the first line of the effect's docstring."""
    return (inspect.getdoc(type(kind)) or "").partition("\n")[0]


def file_text(kind: Effect) -> str:
    """Return the docstring of the effect's file: equation, mechanism and source."""
    return (getattr(sys.modules.get(type(kind).__module__), "__doc__", None) or "").strip()


def title(name: str) -> str:
    """Return an effect's title, such as `Coulomb friction`; its name with blanks if it has none or is unknown."""
    kind = REGISTRY.get(name)
    head = file_text(kind).partition(":")[0] if kind is not None else ""
    return head if TITLE.fullmatch(head) else name.replace("_", " ").capitalize()


def what(name: str) -> str:
    """Return the summary of an effect; empty if it is unknown."""
    kind = REGISTRY.get(name)
    return "" if kind is None else summary(kind)


def site(where: Any) -> str:
    """Return a place in words: `in joint 4`, `of link 7`, `at the flange`, `everywhere`; empty without a place."""
    text = str(where or "")
    if text in ("all", "each"):
        return "everywhere"
    if text == "several":
        return "in several places"
    if text in ("flange", "base"):
        return f"at the {text}"
    if numbered := NUMBERED.fullmatch(text):
        return f"{'of' if numbered[1] == 'link' else 'in'} {numbered[1]} {numbered[2]}"
    return f"at {text}" if text else ""


def named(row: Mapping[str, Any]) -> str:
    """Return the name of a mapping with `effect` and `where`, such as `Coulomb friction in joint 4`."""
    return f"{title(str(row.get('effect', '?')))} {site(row.get('where'))}".strip()


def size(row: Mapping[str, Any]) -> str:
    """Return the size of an effect: `1.20 N m`, or `coulomb 1.20 N m, excess 0.400 N m`; empty without a value.

    Shape parameters are left out. So are those at their value without effect (null), or whose interval includes it, if
    others are not. A lone ratio has its parameter's name too: `scale 0.500`.
    """
    kind, params = REGISTRY.get(str(row.get("effect"))), params_of(row)
    names = [n for n in params if kind is None or n not in kind.params or not kind.params[n].shape]
    stated = [(n, params[n]) for n in names if number(params[n].get("value")) is not None]
    alone = len(stated) == 1
    if kind is not None:
        for at_null in (_is_null, _may_be_null):
            stated = [
                (n, p) for n, p in stated if n not in kind.params or not at_null(p, kind.params[n].null)
            ] or stated
    texts = [in_unit(p) for _, p in stated]
    if alone and " " in texts[0]:  # the unit tells what the number is
        return texts[0]
    return ", ".join(f"{n.replace('_', ' ')} {text}" for (n, _), text in zip(stated, texts, strict=True))


def _is_null(p: Mapping[str, Any], null: float) -> bool:
    return p["value"] == null


def _may_be_null(p: Mapping[str, Any], null: float) -> bool:
    low, high = number(p.get("low")), number(p.get("high"))
    return low is not None and high is not None and low <= null <= high


def sized(row: Mapping[str, Any]) -> str:
    """Return an effect's name and size: `Coulomb friction in joint 4 (1.20 N m)`."""
    how = size(row)
    return f"{named(row)} ({how})" if how else named(row)


def before(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a changed effect with the values that it had in the baseline (`was`)."""
    return {**row, "params": row["was"]}


def unit(text: Any) -> str:
    """Return a unit as it is written after a number: empty for a ratio, `m²` for `m2`."""
    return "" if text in (None, "1") else str(text).replace("m2", "m²")


def in_unit(p: Mapping[str, Any]) -> str:
    """Return the quantity of a mapping with `value` and `unit`, such as `1.20 N m`; for a ratio just the number."""
    name = unit(p.get("unit"))
    return quantity(p.get("value"), name) if name else plain(p.get("value"))
