"""The library of effects as text: a table of all, or one in full."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Sequence
from typing import Any

from vispeg.core.effect import Effect


def summary(kind: Effect) -> str:
    """First line of the effect's own words."""
    return (inspect.getdoc(type(kind)) or "").partition("\n")[0]


def equation(kind: Effect) -> str:
    """What its file says: equation, mechanism and source."""
    return (sys.modules[type(kind).__module__].__doc__ or "").strip()


def places(kind: Effect, robot: Any) -> str:
    """Where it can act, in short: `joint1 ... joint7, all`."""
    targets = kind.targets(robot)
    if len(targets) == 1:
        return targets[0]
    return f"{targets[0]} ... {targets[-1]}, all" if len(targets) > 2 else ", ".join([*targets, "all"])


def describe(kind: Effect, robot: Any) -> dict[str, Any]:
    """The effect for JSON: name, kind, summary, description, where, parameters."""
    params = {}
    for name, p in kind.params.items():
        null = None if p.shape else p.null
        params[name] = {"unit": p.unit, "low": p.low, "high": p.high, "null": null, "typical": p.start, "doc": p.doc}
    return {
        "name": kind.name,
        "kind": kind.kind,
        "summary": summary(kind),
        "description": equation(kind),
        "where": kind.targets(robot),
        "params": params,
    }


def print_catalogue(kinds: Sequence[Effect], models: Sequence[Any]) -> None:
    """A table of effects, each with the robot or scene it acts on: where, parameters, bounds, null, what it is."""
    from rich.console import Console

    table = _table("Effect", "Kind", "Where", "Parameter", "Unit", "From", "To", "Null", "What it is")
    for kind, robot in zip(kinds, models, strict=True):
        for i, (name, p) in enumerate(kind.params.items()):
            first = i == 0
            head = (kind.name, kind.kind, places(kind, robot)) if first else ("", "", "")
            null = "shape" if p.shape else f"{p.null:g}"
            what = summary(kind) if first else ""
            table.add_row(*_safe(*head, name, p.unit, f"{p.low:g}", f"{p.high:g}", null, what))
    _console(Console).print(table)


def print_effect(kind: Effect, robot: Any) -> None:
    """One effect: words, equation, places, parameters."""
    from rich.console import Console
    from rich.text import Text

    console = _console(Console)
    console.print(Text(f"{kind.name}", style="bold").append(f"  {summary(kind)}", style="not bold"))
    console.print(Text("\n" + equation(kind) + "\n"))
    console.print(Text(f"where: {places(kind, robot)}"))
    table = _table("Parameter", "Unit", "From", "To", "Null", "Typical", "What it is")
    for name, p in kind.params.items():
        null = "shape" if p.shape else f"{p.null:g}"
        table.add_row(*_safe(name, p.unit, f"{p.low:g}", f"{p.high:g}", null, f"{p.start:g}", p.doc))
    console.print(table)


def _console(cls: Any) -> Any:
    """A terminal's width, and a wide one for a file or a pipe: no column may be lost there."""
    return cls(highlight=False) if sys.stdout.isatty() else cls(highlight=False, width=160)


def _table(*columns: str) -> Any:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for name in columns:
        numeric = name in ("From", "To", "Null", "Typical")
        table.add_column(name, justify="right" if numeric else "left", overflow="fold")
    return table


def _safe(*cells: str) -> list[str]:
    from rich.markup import escape

    return [escape(cell) for cell in cells]
