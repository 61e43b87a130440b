"""Each reason not to trust a fitted value."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.fitted import doubts
from vispeg.report.record import Record

TITLE = "What to doubt"


def context(record: Record) -> Mapping[str, object] | None:
    """Give the reasons, in words; None without one."""
    reasons = doubts(record.values)
    return {"doubts": reasons} if reasons else None
