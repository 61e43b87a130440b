"""The section on where the model fails: shares of the residual, each joint's error, and the unexplained rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.drawings.figures import BEFORE
from vispeg.report.drawings.strips import bar
from vispeg.report.record import Record, rows
from vispeg.report.text import joint_errors, words
from vispeg.report.text.quantities import number

TITLE = "Where it fails"


def context(record: Record) -> Mapping[str, object]:
    """Return shares of the residual, the largest first, each joint's error, and the unexplained rest."""
    shares = sorted(record.rows("where_it_fails"), key=lambda row: -(number(row.get("share")) or 0.0))
    total = sum(number(row.get("share")) or 0.0 for row in shares)
    rest = record.mapping("unexplained")
    return {
        "column": "Axis" if record.values.get("evidence") == "contact" else "Joint",
        "shares": [
            {"joint": str(row.get("joint", "?")), "regime": str(row.get("regime", "?")), **_share(row)}
            for row in shares
        ],
        "elsewhere": _percent(1.0 - total) if shares and 0.005 <= 1.0 - total <= 1.0 else "",
        "unexplained": [
            {"input": words.depends_on(row), **_share(row)}
            for row in sorted(rows(rest, "depends_on"), key=lambda row: -(number(row.get("share")) or 0.0))
        ],
        "text": str(rest.get("text") or ""),
        "left": joint_errors.table(record.values),
    }


def _share(row: Mapping[str, Any]) -> dict[str, str]:
    share = number(row.get("share"))
    return {"share": _percent(share), "bar": bar(share, BEFORE) if share is not None else ""}


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.0f} %" if share >= 0.01 or share <= 0 else "< 1 %"
