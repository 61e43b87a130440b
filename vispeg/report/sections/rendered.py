"""Frames of a task as its cameras deliver them, where the run drew some (`vispeg demo` does)."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.record import Record, data_link

TITLE = "Rendered for training"


def context(record: Record) -> Mapping[str, object] | None:
    """Give the contact sheet as a `data:` link; None where there is none."""
    if record.sheet is None:
        return None
    return {"sheet": data_link(record.sheet)}
