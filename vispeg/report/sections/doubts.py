"""The section on reasons to doubt fitted values."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.fitted import doubts
from vispeg.report.record import Record

TITLE = "Reasons for doubt"


def context(record: Record) -> Mapping[str, object] | None:
    """Return the reasons, in words; None if there are none."""
    reasons = doubts(record.values)
    return {"doubts": reasons} if reasons else None
