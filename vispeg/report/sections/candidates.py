"""What else was tried, how much it helped on held-out data, and why it was refused."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.figures import MUTED
from vispeg.report.quantities import number, plain
from vispeg.report.record import Record, label, rows
from vispeg.report.strips import bar

TITLE = "Candidates tried"
MOST_SCREENED = 20


def context(record: Record) -> dict[str, Any]:
    """Candidates by falling gain, and the screening's ranking."""
    tried = sorted(record.rows("candidates"), key=lambda row: -_sortable(row.get("heldout_gain")))
    screened = sorted(record.rows("screening"), key=lambda row: -_sortable(row.get("score")))
    best = max([number(row.get("score")) or 0.0 for row in screened], default=0.0)
    return {
        "tried": [
            {
                "effect": label(row),
                "beside": _beside(row),
                "gain": _percent(row.get("heldout_gain")),
                "errors": plain(row.get("gain_standard_errors"), 2),
                "bar": bar(_share(row.get("heldout_gain"), 1.0), MUTED) if _some(row.get("heldout_gain")) else "",
                "why": str(row.get("rejected_because") or "–"),
            }
            for row in tried
        ],
        "screened": [
            {
                "effect": label(row),
                "score": plain(row.get("score"), 3),
                "bar": bar(_share(row.get("score"), best), MUTED),
                "group": "–" if row.get("cosine_group") is None else str(row["cosine_group"]),
            }
            for row in screened[:MOST_SCREENED]
        ],
        "beside": any("tried_beside" in row for row in tried),
        "errors": any(number(row.get("gain_standard_errors")) is not None for row in tried),
        "grouped": any(row.get("cosine_group") is not None for row in screened),
        "unscreened": max(0, len(screened) - MOST_SCREENED),
        "kept": [label(row) for row in record.rows("effects")],
    }


def _beside(row: Mapping[str, Any]) -> str:
    """What was in the model already when a candidate was added to it."""
    if "tried_beside" not in row:
        return "–"
    return ", ".join(label(other) for other in rows(row, "tried_beside")) or "the model as given"


def _some(value: Any) -> bool:
    return (number(value) or 0.0) > 0


def _percent(value: Any) -> str:
    x = number(value)
    return "–" if x is None else f"{plain(100 * x, 2 if abs(x) < 0.995 else 3)} %"


def _sortable(value: Any) -> float:
    x = number(value)
    return float("-inf") if x is None else x


def _share(value: Any, top: float) -> float:
    return max(0.0, number(value) or 0.0) / top if top > 0 else 0.0
