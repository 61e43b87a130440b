"""The short tables that the command line prints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vispeg.report import words
from vispeg.report.ladder import ladder_rows
from vispeg.report.quantities import fold, quantity
from vispeg.report.record import Record, rows
from vispeg.report.sections.found import effect_rows
from vispeg.report.tables import Column, Sheet, terminal


def ladder_table(diagnosis: Mapping[str, Any]) -> Sheet:
    """Model, error on fitted and on held-out recordings, and the latter in noise floors; of either kind of record."""
    columns = [Column("Model"), *(Column(head, right=True) for head in ("Fitted", "Held out", "Floor"))]
    found = ladder_rows(_record(diagnosis))
    return Sheet(columns, [[row["model"], row["fit"], row["heldout"], row["floor"] or "–"] for row in found])


def effects_table(diagnosis: Mapping[str, Any]) -> Sheet:
    """What was found: effect, parameter, value with its 95 % interval, unit, and whether it ended at its bound."""
    found = effect_rows(_record(diagnosis))
    bound = any(row["bound"] for row in found)
    columns = [Column("Effect"), Column("Parameter"), Column("Value", right=True), Column("95 % interval")]
    columns += [Column("Unit"), *([Column("Bound")] if bound else [])]
    cells = [[row["effect"], row["param"], row["value"], row["interval"] or "–", row["unit"]] for row in found]
    return Sheet(columns, [c + ([row["bound"]] if bound else []) for c, row in zip(cells, found, strict=True)], keys=2)


def print_diagnosis(diagnosis: Mapping[str, Any], out: Path) -> None:
    """Prints the verdict in words, both tables, and where the report lies."""
    from rich.text import Text

    console = terminal()
    if verdict := diagnosis.get("verdict"):
        console.print(Text(f"{verdict}: ", style="bold").append(words.verdict(diagnosis), style="not bold"))
    console.print(Text(words.fall(diagnosis)))
    console.print(ladder_table(diagnosis))
    if diagnosis.get("effects"):
        console.print(effects_table(diagnosis))
        if any(effect.get("partial") for effect in rows(diagnosis, "effects")):
            console.print(Text(words.PARTIAL))
        for chosen, *others in words.rivals(diagnosis):
            console.print(Text(f"{chosen} cannot be told from {words.join(others, 'or')}"))
    for row in diagnosis.get("windows") or ():
        console.print(Text(f"note: {row['said']}"))
    if diagnosis.get("verdict"):
        console.print(Text(f"next: {words.onward(diagnosis)}"))
    console.print(Text(f"report: {out / 'report.html'}"), soft_wrap=True)


def joints_table(comparison: Mapping[str, Any]) -> Sheet:
    """Error, noise and their ratio of each joint; the torque error too where torque was measured."""
    found = rows(comparison, "joints")
    torque = any("torque_error" in row for row in found)
    heads = ["Error", "Noise floor", "Times", *(["Torque error"] if torque else [])]
    cells = []
    for row in found:
        unit = str(row.get("unit") or "")
        line = [str(row.get("joint", "?")), quantity(row.get("error"), unit), quantity(row.get("floor"), unit)]
        line.append(fold(float(row["times_floor"])) if row.get("times_floor") else "–")
        cells.append(line + ([quantity(row.get("torque_error"), "N m RMS")] if torque else []))
    return Sheet([Column("Joint"), *(Column(head, right=True) for head in heads)], cells)


def print_comparison(comparison: Mapping[str, Any], out: Path) -> None:
    """Prints the error in words, joint by joint, where it arises, and where the report lies."""
    from rich.text import Text

    console = terminal()
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
