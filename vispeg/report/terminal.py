"""The short tables that the command line prints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vispeg.report import words
from vispeg.report.quantities import fold, quantity
from vispeg.report.record import Record, rows
from vispeg.report.sections.headline import effect_rows, ladder_rows

if TYPE_CHECKING:
    from rich.table import Table


def ladder_table(diagnosis: Mapping[str, Any]) -> Table:
    """Model, error on fitted and on held-out recordings, and the latter in noise floors; of either kind of record."""
    table = _table(("Model", "left"), ("Fitted", "right"), ("Held out", "right"), ("Floor", "right"))
    for row in ladder_rows(_record(diagnosis)):
        table.add_row(*_safe(row["model"], row["fit"], row["heldout"], row["floor"] or "–"))
    return table


def effects_table(diagnosis: Mapping[str, Any]) -> Table:
    """What was found: effect, parameter, value with its 95 % interval, unit, and whether it ended at its bound."""
    found = effect_rows(_record(diagnosis))
    bound = any(row["bound"] for row in found)
    names: list[tuple[str, Any]] = [("Effect", "left"), ("Parameter", "left"), ("Value", "right")]
    names += [("95 % interval", "left"), ("Unit", "left")]
    table = _table(*names, *([("", "left")] if bound else []))
    for row in found:
        cells = [row["effect"], row["param"], row["value"], row["interval"] or "–", row["unit"]]
        table.add_row(*_safe(*cells, *([row["bound"]] if bound else [])))
    return table


def print_diagnosis(diagnosis: Mapping[str, Any], out: Path) -> None:
    """Prints the verdict in words, both tables, and where the report lies."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    if verdict := diagnosis.get("verdict"):
        console.print(Text(f"{verdict}: ", style="bold").append(words.verdict(diagnosis), style="not bold"))
    console.print(Text(words.fall(diagnosis)))
    console.print(ladder_table(diagnosis))
    if diagnosis.get("effects"):
        console.print(effects_table(diagnosis))
        for chosen, *others in words.rivals(diagnosis):
            console.print(Text(f"{chosen} cannot be told from {words.join(others, 'or')}"))
    console.print(Text(f"report: {out / 'report.html'}"), soft_wrap=True)


def joints_table(comparison: Mapping[str, Any]) -> Table:
    """Error, noise and their ratio of each joint; the torque error too where torque was measured."""
    found = rows(comparison, "joints")
    torque = any("torque_error" in row for row in found)
    columns: list[tuple[str, Any]] = [
        ("Joint", "left"),
        ("Error", "right"),
        ("Noise floor", "right"),
        ("Times", "right"),
    ]
    table = _table(*columns, *([("Torque error", "right")] if torque else []))
    for row in found:
        unit = str(row.get("unit") or "")
        cells = [str(row.get("joint", "?")), quantity(row.get("error"), unit), quantity(row.get("floor"), unit)]
        cells.append(fold(float(row["times_floor"])) if row.get("times_floor") else "–")
        table.add_row(*_safe(*cells, *([quantity(row.get("torque_error"), "N m RMS")] if torque else [])))
    return table


def print_comparison(comparison: Mapping[str, Any], out: Path) -> None:
    """Prints the error in words, joint by joint, where it arises, and where the report lies."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    console.print(Text(words.fall(comparison)))
    console.print(joints_table(comparison))
    worst = [
        f"{r.get('joint')}, {r.get('regime')} ({100 * r['share']:.0f} %)" for r in rows(comparison, "where_it_fails")
    ]
    if comparison.get("chi2", 0.0) <= words.NEAR_FLOOR**2:
        console.print(Text("the model is at the noise floor: nowhere does it fail"))
    elif worst:
        console.print(Text(f"where it fails: {'; '.join(worst[:3])}"))
    for note in comparison.get("notes") or ():
        console.print(Text(f"note: {note}"))
    console.print(Text(f"report: {out / 'report.html'}"), soft_wrap=True)


def _record(values: Mapping[str, Any]) -> Record:
    from vispeg.report.evidence import Evidence

    return Record("diagnosis", values, Evidence())


def _table(*columns: tuple[str, Any]) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for name, side in columns:
        table.add_column(name, justify=side, overflow="fold", no_wrap=name != "95 % interval")
    return table


def _safe(*cells: str) -> list[str]:
    from rich.markup import escape

    return [escape(cell) for cell in cells]
