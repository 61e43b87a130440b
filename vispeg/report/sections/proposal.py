"""What torques call for before any rollout, and what of it the search confirmed."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.record import Record, rows
from vispeg.report.text.proposal import table
from vispeg.report.text.quantities import quantity

TITLE = "First proposal"


def context(record: Record) -> Mapping[str, object] | None:
    """Give the proposed effects, and the torque that each joint lacks before and after; None where no torque is
    known.
    """
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
