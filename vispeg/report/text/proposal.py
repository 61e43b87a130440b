"""The proposal that torques suggest before the search, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.record import Record, label, rows
from vispeg.report.text.effect_words import named, size, sized
from vispeg.report.text.quantities import number, plain, quantity

LISTED = 8  # most effects named in a line


def likely(proposal: Mapping[str, Any]) -> str:
    """Return two lines on the likely effects, which say that the search has yet to confirm them."""
    effects, unit = rows(proposal, "effects"), str(proposal.get("unit", ""))
    source = f"the torques {proposal.get('torque')}"
    if not effects:
        return f"likely: no effect; {source} need none"
    words = [f"{sized(row)} ({_percent(row.get('share'))})" for row in effects[:LISTED]]
    more = f", and {len(effects) - LISTED} more" if len(effects) > LISTED else ""
    fall = f"{quantity(proposal.get('before'), unit)} to {quantity(proposal.get('after'), unit)}"
    return (
        f"likely: {', '.join(words)}{more}\n"
        f"  by {source}, whose held-out error would fall from {fall}. A proposal: the search confirms or corrects it."
    )


def table(record: Record) -> list[Mapping[str, str]]:
    """Return rows: effect, size, share of the missing torque, equivalent effects, and whether the search named it."""
    found = {(row.get("effect"), row.get("where")) for row in record.rows("effects")}
    out = []
    for row in rows(record.mapping("proposal"), "effects"):
        equals = rows(row, "equals")
        keys = [(e.get("effect"), e.get("where")) for e in (row, *equals)]
        out.append(
            {
                "effect": named(row),
                "size": size(row) or "–",
                "share": _percent(row.get("share")),
                "equals": ", ".join(map(label, equals)) or "–",
                "confirmed": "yes" if keys[0] in found else "in its place" if found & {*keys[1:]} else "no",
            }
        )
    return out


def _percent(share: Any) -> str:
    x = number(share)
    return "–" if x is None else f"{plain(100 * x, 2)} %"
