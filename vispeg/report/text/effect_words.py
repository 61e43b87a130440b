"""An effect in words, all of them from its own file: its title, what it is, where it sits, how large it is.

The title is what the file's first line says before its colon ("Coulomb friction: `tau = ...`"), the sentence the first
line of the class's docstring. So an effect that is added needs no edit here.
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

TITLE = re.compile(r"[A-Z][\w -]{2,38}")  # a few plain words
NUMBERED = re.compile(r"([a-z]+?)_?(\d+)")


def summary(kind: Effect) -> str:
    """First line of the effect's own words."""
    return (inspect.getdoc(type(kind)) or "").partition("\n")[0]


def equation(kind: Effect) -> str:
    """Return equation, mechanism and source from the effect's docstring."""
    return (getattr(sys.modules.get(type(kind).__module__), "__doc__", None) or "").strip()


def title(name: str) -> str:
    """`Coulomb friction`; the name with blanks where this installation does not know it or its file does not say."""
    kind = REGISTRY.get(name)
    head = equation(kind).partition(":")[0] if kind is not None else ""
    return head if TITLE.fullmatch(head) else name.replace("_", " ").capitalize()


def what(name: str) -> str:
    """One sentence on what the effect is; empty where it is not known."""
    kind = REGISTRY.get(name)
    return "" if kind is None else summary(kind)


def site(where: Any) -> str:
    """`in joint 4`, `of link 7`, `at the flange`, `everywhere`; empty where no place is given."""
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
    """`Coulomb friction in joint 4` of anything that has `effect` and `where`."""
    return f"{title(str(row.get('effect', '?')))} {site(row.get('where'))}".strip()


def size(row: Mapping[str, Any]) -> str:
    """`1.20 N m`, or `coulomb 1.20 N m, excess 0.400 N m`: the parameters that make the effect vanish at null.

    One that is at null, or whose interval includes it, is left out beside one that is not. Empty without a value.
    """
    kind, params = REGISTRY.get(str(row.get("effect"))), params_of(row)
    names = [n for n in params if kind is None or n not in kind.params or not kind.params[n].shape]
    stated = [(n, params[n]) for n in names if number(params[n].get("value")) is not None]
    alone = len(stated) == 1
    if kind is not None:  # directions in which nothing was fitted go unsaid
        for at_null in (_is_null, _may_be_null):
            stated = [
                (n, p) for n, p in stated if n not in kind.params or not at_null(p, kind.params[n].null)
            ] or stated
    texts = [in_unit(p) for _, p in stated]
    if alone and not texts[0][0].isalpha() and " " in texts[0]:
        return texts[0]
    return ", ".join(f"{n.replace('_', ' ')} {text}" for (n, _), text in zip(stated, texts, strict=True))


def _is_null(p: Mapping[str, Any], null: float) -> bool:
    return p["value"] == null


def _may_be_null(p: Mapping[str, Any], null: float) -> bool:
    low, high = number(p.get("low")), number(p.get("high"))
    return low is not None and high is not None and low <= null <= high


def sized(row: Mapping[str, Any]) -> str:
    """`Coulomb friction in joint 4 (1.20 N m)`."""
    how = size(row)
    return f"{named(row)} ({how})" if how else named(row)


def unit(text: Any) -> str:
    """Give a unit as it is written beside a number: nothing for a ratio, a power as a power."""
    return "" if text in (None, "1") else str(text).replace("m2", "m²")


def in_unit(p: Mapping[str, Any]) -> str:
    """`1.20 N m` of anything that has `value` and `unit`; a ratio is the number alone."""
    name = unit(p.get("unit"))
    return quantity(p.get("value"), name) if name else plain(p.get("value"))
