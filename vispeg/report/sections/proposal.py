"""The section on the first proposal: effects that torques suggest, and whether the search found them."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.record import Record, rows
from vispeg.report.text.proposal import table
from vispeg.report.text.quantities import quantity

TITLE = "First proposal"


def context(record: Record) -> Mapping[str, object] | None:
    """Return the proposed effects, and each joint's missing torque before and after; None without a proposal."""
    proposal = record.mapping("proposal")
    if not proposal:
        return None
    unit = str(proposal.get("unit", ""))
    return {
        "source": str(proposal.get("torque", "")),
        "effects": table(record),
        "before": quantity(proposal.get("before"), unit),
        "after": quantity(proposal.get("after"), unit),
        "joints": [
            {
                "joint": str(row.get("joint", "?")),
                **{k: quantity(row.get(k), unit) for k in ("before", "after", "noise")},
            }
            for row in rows(proposal, "joints")
        ],
    }
