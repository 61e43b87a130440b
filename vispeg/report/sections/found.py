"""The section of effects found: each in words, with values, 95 % intervals and plausible ranges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypedDict

import numpy as np

from vispeg.core.effect import REGISTRY
from vispeg.core.params import Param
from vispeg.diagnosis.scale import times
from vispeg.report.drawings.strips import interval_strip, place
from vispeg.report.record import Record, label, params_of, rows
from vispeg.report.text import effect_words, words
from vispeg.report.text.quantities import number, plain, prefix, scaled

TITLE = "What was found"
STRONG = 0.9  # smallest correlation of two estimates that is called strong
MOST_OPEN = 4  # with more effects, their tables are folded
AT_BOUND = "at a bound: the true value may lie beyond"
NO_PARAMETER: dict[str, str] = dict.fromkeys(("param", "value", "interval", "unit", "bound"), "")


def context(record: Record) -> Mapping[str, object]:
    """Return the effects with one row per parameter, earlier values that changed, and correlations of the estimates."""
    partial = [e for e in [*record.rows("effects"), *record.rows("partial")] if in_part(record, e)]
    everything = [*partial, *(e for e in record.rows("effects") if not in_part(record, e))]
    return {
        "glance": [_glance(e) for e in sorted(everything, key=lambda e: bool(e.get("tentative")))],
        "folded": len(everything) > MOST_OPEN,
        "shared": any(without(e) for e in everything),
        "effects": [_effect(e) for e in record.rows("effects") if not (e.get("partial") or e.get("tentative"))],
        "partial": [_effect(e) for e in partial if not e.get("tentative")],
        "tentative": [_effect(e) for e in everything if e.get("tentative")],
        "moved": [_moved(row) for row in record.rows("parameters_moved")],
        "correlations": correlations(record),
    }


def effect_rows(record: Record) -> list[dict[str, str]]:
    """Return the effects found as table rows, one per parameter."""
    listed = record.rows("effects")
    return [{"effect": label(e), "sure": sure(e), **row} for e in listed for row in _params(e) or [NO_PARAMETER]]


def sure(effect: Mapping[str, Any]) -> str:
    """Return the certainty of an effect: `named`, `tentative`, or `1 of 3` if two others explain the data as well."""
    others = len(rows(effect, "indistinguishable_from"))
    return "tentative" if effect.get("tentative") else f"1 of {others + 1}" if others else "named"


def share(effect: Mapping[str, Any]) -> str:
    """Return the share of the excess (of error over the noise floor) that an effect explains; empty if not recorded."""
    part = number(effect.get("explains"))
    return "" if part is None else f"{100 * part:z.1f} % of the excess".replace("-", "−")


def without(effect: Mapping[str, Any]) -> str:
    """Return the held-out error without an effect; empty if the record does not say."""
    error = number(effect.get("without"))
    return "" if error is None else f"{times(error)} × the noise floor"


def in_part(record: Record, effect: Mapping[str, Any]) -> bool:
    """Return whether an effect is partial: accepted although a residual remains. Old records list these separately."""
    return bool(effect.get("partial")) or effect in record.rows("partial")


def _params(effect: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return one row per parameter; if some were fitted, without the others that are at their null value."""
    name, values = str(effect.get("effect")), params_of(effect)
    fitted = any(_fitted(p) for p in values.values())
    had = params_of(effect_words.before(effect)) if effect.get("was") else {}
    shown = {k: p for k, p in values.items() if _fitted(p) or not fitted or not _at_null(name, k, p)}
    return [_row(name, k, p, had.get(k)) for k, p in shown.items()]


def _fitted(p: Mapping[str, Any]) -> bool:
    return number(p.get("low")) is not None and number(p.get("high")) is not None


def _at_null(name: str, param: str, p: Mapping[str, Any]) -> bool:
    """Return whether a parameter has its null value."""
    bounds = bounds_of(name, param)
    return bounds is not None and number(p.get("value")) == bounds.null


def _effect(effect: Mapping[str, Any]) -> Mapping[str, object]:
    params = _params(effect)
    others = [effect_words.named(other) for other in rows(effect, "indistinguishable_from")]
    return {
        "words": words.one_of(effect),
        "label": label(effect),
        "what": effect_words.what(str(effect.get("effect"))),
        "rivals": words.join(others, "or"),
        "share": share(effect),
        "without": without(effect),
        "params": params,
        "remarks": any(row["remark"] for row in params),
    }


def _glance(effect: Mapping[str, Any]) -> Mapping[str, object]:
    """Return an effect as one row: name, values with intervals, certainty, and what it explains."""
    others = [effect_words.named(other) for other in rows(effect, "indistinguishable_from")]
    return {
        "words": effect_words.named(effect),
        "params": _params(effect),
        "sure": "tentative" if effect.get("tentative") else f"or {words.join(others, 'or')}" if others else "named",
        "share": share(effect),
        "without": without(effect),
    }


def bounds_of(effect: str, param: str) -> Param | None:
    """Return the registered parameter; None if this installation does not know it."""
    kind = REGISTRY.get(effect)
    return kind.params.get(param) if kind is not None else None


def remark(value: float | None, low: float | None, high: float | None, param: Param | None) -> str:
    """Return a remark on the values: no interval, at a bound, or an interval that includes the null value."""
    if value is None:
        return "no value"
    notes = []
    if low is None or high is None:
        notes.append("no interval")
    if param is not None:
        at = place(value, param.low, param.high, param.scale)
        if at <= 0.005 and param.low != param.null or at >= 0.995:
            notes.append(AT_BOUND)
        if not param.shape and low is not None and high is not None and low <= param.null <= high:
            notes.append("interval includes the null value")
    return "; ".join(notes)


class Correlations(TypedDict):
    """Names of parameters, rows of (text, colour) of their correlations, and strong pairs (label, label, text)."""

    labels: list[str]
    rows: list[list[tuple[str, str]]]
    strong: list[tuple[str, str, str]]


def correlations(record: Record) -> Correlations:
    """Return the correlations of a record; all lists are empty without a valid matrix."""
    section = record.mapping("correlations")
    names = [str(name) for name in section.get("labels") or []]
    cells = [[number(v) for v in row] for row in section.get("matrix") or [] if isinstance(row, list)]
    if len(names) < 2 or len(cells) != len(names) or any(len(row) != len(names) for row in cells):
        return {"labels": [], "rows": [], "strong": []}
    strong = [
        (names[i], names[j], plain(cells[i][j], 2))
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True)
        if abs(cells[i][j] or 0.0) >= STRONG
    ]
    coloured = [[(plain(v, 2), _shade(v, i == j)) for j, v in enumerate(row)] for i, row in enumerate(cells)]
    return {"labels": names, "rows": coloured, "strong": strong}


def _row(effect: str, name: str, p: Mapping[str, Any], had: Mapping[str, Any] | None) -> dict[str, str]:
    """Return one parameter as a table row; `had` is the same in the baseline, None if it was not there."""
    declared = bounds_of(effect, name)
    base_unit = str(p.get("unit") or (declared.unit if declared else ""))
    value, between, unit = scaled(p.get("value"), p.get("low"), p.get("high"), base_unit)
    numbers = number(p.get("value")), number(p.get("low")), number(p.get("high"))
    strip = bounds = ""
    if declared is not None:
        null = None if declared.shape else declared.null
        strip = interval_strip(numbers[0], numbers[1:], (declared.low, declared.high), null, declared.scale)
        factor, scaled_unit = prefix(max(abs(declared.low), abs(declared.high)), base_unit)
        ends = f"{plain(factor * declared.low)} to {plain(factor * declared.high)}"
        bounds = f"{ends} {effect_words.unit(scaled_unit)}".strip()
    notes = "; ".join(filter(None, [f"{effect_words.in_unit(had)} before" if had else "", remark(*numbers, declared)]))
    return {
        "param": name,
        "doc": declared.doc if declared else "",
        "value": value,
        "interval": between,
        "unit": effect_words.unit(unit),
        "bounds": bounds,
        "strip": strip,
        "remark": notes,
        "bound": "at its bound" if AT_BOUND in notes else "",
    }


def _moved(row: Mapping[str, Any]) -> dict[str, str]:
    param = bounds_of(str(row.get("effect")), str(row.get("param")))
    before, after = number(row.get("before")), number(row.get("after"))
    factor, unit = prefix(max(abs(before or 0.0), abs(after or 0.0)), param.unit if param else "")
    return {
        "effect": label(row),
        "param": str(row.get("param", "?")),
        "before": plain(None if before is None else factor * before, 4),
        "after": plain(None if after is None else factor * after, 4),
        "unit": effect_words.unit(unit),
    }


def _shade(value: float | None, diagonal: bool) -> str:
    if value is None or diagonal:
        return "transparent"
    share = round(60 * min(1.0, abs(value)) ** 2)
    return f"color-mix(in srgb, var(--{'before' if value > 0 else 'after'}) {share}%, transparent)"
