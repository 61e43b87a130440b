"""The section on candidates: effects that were tried, their gain on held-out data, and why each was refused."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from vispeg.report.drawings.figures import MUTED
from vispeg.report.drawings.strips import bar
from vispeg.report.record import Record, label, rows
from vispeg.report.text.quantities import number, plain

TITLE = "Candidates tried"
MOST_SCREENED = 20  # most rows of the ranking that are shown


def context(record: Record) -> Mapping[str, object]:
    """Return the tried candidates by decreasing gain, and the ranking of the screening."""
    tried = sorted(record.rows("candidates"), key=lambda row: -_sortable(row.get("heldout_gain")))
    screened = _screened(record)
    top = screened[:MOST_SCREENED]
    low, high = _decades([number(row.get("score")) for row in top])
    return {
        "tried": _by_model(
            {
                "effect": label(row),
                "beside": _beside(row),
                "gain": _percent(row.get("heldout_gain")),
                "errors": plain(row.get("gain_standard_errors"), 2),
                "bar": bar(max(0.0, number(row.get("heldout_gain")) or 0.0), MUTED)
                if _positive(row.get("heldout_gain"))
                else "",
                "why": str(row.get("rejected_because") or "–"),
            }
            for row in tried
        ),
        "screened": [
            {
                "effect": label(row),
                "score": powers(row.get("score")),
                "bar": bar(_log_share(number(row.get("score")), low, high), MUTED),
                "group": "–" if row.get("cosine_group") is None else str(row["cosine_group"]),
            }
            for row in top
        ],
        "ends": (powers(10.0**low, 1), powers(10.0**high, 1)),
        "errors": any(number(row.get("gain_standard_errors")) is not None for row in tried),
        "grouped": any(row.get("cosine_group") is not None for row in screened),
        "unscreened": max(0, len(screened) - MOST_SCREENED),
        "kept": [label(row) for row in record.rows("effects")],
    }


def _screened(record: Record) -> list[Mapping[str, Any]]:
    """Return each screened effect once, at the step where it scored best, by decreasing score.

    A score of zero or less says that the effect does not fit, so these are left out.
    """
    best: dict[str, Mapping[str, Any]] = {}
    for row in sorted(record.rows("screening"), key=lambda row: -_sortable(row.get("score"))):
        if _positive(row.get("score")):
            best.setdefault(label(row), row)
    return [*best.values()]


def _by_model(tried: Iterable[dict[str, str]]) -> list[Mapping[str, object]]:
    """Group rows by the model that the candidate was added to, in the order of their best row.

    `size` is the number of effects in that model, 1 for the initial model.
    """
    models: dict[str, list[dict[str, str]]] = {}
    for row in tried:
        models.setdefault(row["beside"], []).append(row)
    return [{"beside": beside, "size": beside.count("(") or 1, "rows": group} for beside, group in models.items()]


def _beside(row: Mapping[str, Any]) -> str:
    """Return the effects already in the model when a candidate was tried; empty if the record does not say."""
    if "tried_beside" not in row:
        return ""
    return ", ".join(label(other) for other in rows(row, "tried_beside")) or "the initial model"


def _positive(value: Any) -> bool:
    return (number(value) or 0.0) > 0


def _percent(value: Any) -> str:
    x = number(value)
    return "–" if x is None else f"{plain(100 * x, 2 if abs(x) < 0.995 else 3)} %"


def _sortable(value: Any) -> float:
    x = number(value)
    return float("-inf") if x is None else x


def _decades(scores: Sequence[float | None]) -> tuple[int, int]:
    """Return the powers of ten between which the positive scores lie."""
    sizes = [math.log10(x) for x in scores if x is not None and x > 0]
    return (math.floor(min(sizes)), max(math.ceil(max(sizes)), math.floor(min(sizes)) + 1)) if sizes else (0, 1)


def _log_share(score: float | None, low: int, high: int) -> float:
    return 0.0 if score is None or score <= 0 else (math.log10(score) - low) / (high - low)


def powers(value: Any, digits: int = 3) -> str:
    """Return a number as text; very large or small ones as `2.60 × 10¹⁰`."""
    text = plain(value, digits)
    mantissa, e, exponent = text.partition("e")
    if not e:
        return text
    power = "10" + exponent.translate(_RAISED)
    return power if mantissa == "1" else f"{mantissa} × {power}"


_RAISED = str.maketrans("-\N{MINUS SIGN}0123456789", "⁻⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
