"""What these recordings could not have shown: the sizes up to which an effect that was not found may be there."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.record import Record
from vispeg.report.text.unseen import SHOWN, unseen

TITLE = "What could not have been seen"


def context(record: Record) -> Mapping[str, object] | None:
    """Give the least certain effects and the rest; None where the record does not say."""
    hidden = unseen(record.values)
    return {"tables": [part for part in (hidden[:SHOWN], hidden[SHOWN:]) if part]} if hidden else None
