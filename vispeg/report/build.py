"""Builds the one self-contained HTML file of a finished diagnosis or comparison."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from vispeg.core.files import write_text_atomic
from vispeg.report.page import Section, page
from vispeg.report.record import Record, load_record
from vispeg.report.sections import COMPARE, DIAGNOSIS


def write_report(out: Path, *, overwrite: bool = False) -> Path:
    """Reads OUT/diagnosis.json (or OUT/compare.json) and OUT/evidence.npz, writes OUT/report.html; returns its path.

    Raises:
        UserError: no record in `out`, a file that cannot be read, or a report there already while `overwrite` is False.
    """
    return write_text_atomic(Path(out) / "report.html", render(load_record(Path(out))), overwrite=overwrite)


def render(record: Record) -> str:
    """The whole page as text: no script, no link that leaves it."""
    sections = []
    for name in DIAGNOSIS if record.kind == "diagnosis" else COMPARE:
        module = import_module(f"vispeg.report.sections.{name}")
        values = module.context(record)
        if values is not None:  # else nothing to show
            sections.append(Section(name, module.TITLE, f"sections/{name}", values))
    kind = "diagnosis" if record.kind == "diagnosis" else "comparison"
    verdict = record.values.get("verdict") if record.kind == "diagnosis" else None
    return page(f"vispeg {kind}" + (f": {verdict}" if verdict else ""), kind, sections)
