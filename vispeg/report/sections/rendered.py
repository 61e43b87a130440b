"""The section with rendered frames of a task, if the run made some (`vispeg demo` does)."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.record import Record, data_link

TITLE = "Rendered for training"


def context(record: Record) -> Mapping[str, object] | None:
    """Return the contact sheet as a `data:` link; None if there is none."""
    if record.sheet is None:
        return None
    return {"sheet": data_link(record.sheet)}
