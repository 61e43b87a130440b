"""The section on undetectable effects: for effects not found, the sizes that these recordings would not show."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.record import Record
from vispeg.report.text.unseen import SHOWN, unseen

TITLE = "What could not have been seen"


def context(record: Record) -> Mapping[str, object] | None:
    """Return the least certain effects and the rest, in two tables; None without data."""
    hidden = unseen(record.values)
    return {"tables": [part for part in (hidden[:SHOWN], hidden[SHOWN:]) if part]} if hidden else None
