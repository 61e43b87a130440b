"""The verdict in plain words, the fall of the held-out error, and what was found."""

from __future__ import annotations

from typing import Any

from vispeg.report import words
from vispeg.report.figures import chart
from vispeg.report.ladder import ladder_figure, ladder_rows
from vispeg.report.quantities import interval, number, quantity
from vispeg.report.record import Record, label, params_of, rows
from vispeg.report.sections.parameters import AT_BOUND, bounds_of, remark

TITLE = "Verdict"


def context(record: Record) -> dict[str, Any]:
    """Verdict, sentence on the error, key figures, ladder picture and table, effects found."""
    values = record.values
    first, last, unit = words.ladder_ends(values)
    floor = record.mapping("noise_floor")
    figures = [(words.error_name(values), quantity(last, unit), words.against_floor(last, record.floor))]
    if len(record.rows("ladder")) > 1:
        figures.insert(0, ("Before", quantity(first, unit), "held-out error"))
        figures[1] = ("After", figures[1][1], words.against_floor(last, record.floor) or "held-out error")
    if record.floor is not None:
        figures.append(("Noise floor", quantity(record.floor, str(floor.get("unit") or unit)), _source(floor)))
    return {
        "verdict": values.get("verdict") if record.kind == "diagnosis" else None,
        "sentence": words.verdict(values),
        "fall": words.fall(values),
        "figures": figures,
        "picture": chart(lambda shape: ladder_figure(record, shape), "ladder", words.fall(values)),
        "ladder": ladder_rows(record),
        "fitted": any(number(row.get("fit_error")) is not None for row in record.rows("ladder")),
        "reason": str(values.get("reason") or "").rstrip("."),
        "judged": "Recordings" if record.kind == "compare" else "Held-out recordings",
        "effects": effect_rows(record),
        "partial": effect_rows(record, "partial"),
        "floor_unit_differs": bool(floor.get("unit")) and floor.get("unit") != unit and bool(unit),
    }


def effect_rows(record: Record, key: str = "effects") -> list[dict[str, str]]:
    """The effects under `key`, one row a parameter: those found, or (`partial`) those that do not suffice."""
    found = []
    for effect in record.rows(key):
        params = params_of(effect)
        others = ", ".join(label(other) for other in rows(effect, "indistinguishable_from"))
        for name, p in params.items():
            value, between = interval(p.get("value"), p.get("low"), p.get("high"))
            row = {"effect": label(effect), "param": name, "value": value, "interval": between}
            bound = at_bound(str(effect.get("effect")), name, p.get("value"))
            found.append({**row, "unit": str(p.get("unit") or ""), "rivals": others, "bound": bound})
        if not params:
            found.append(
                dict.fromkeys(("param", "value", "interval", "unit", "bound"), "")
                | {"effect": label(effect), "rivals": others}
            )
    return found


def at_bound(effect: str, param: str, value: Any) -> str:
    """`at its bound` where a value is as small or large as the effect allows; empty elsewhere, and at null."""
    known, x = bounds_of(effect, param), number(value)
    if known is None or x is None:
        return ""
    return "at its bound" if AT_BOUND in remark(x, x, x, known) else ""


def _source(floor: dict[str, Any]) -> str:
    source = floor.get("from")
    return {"repeats": "from repeats", "stated noise": "from stated noise"}.get(str(source), str(source or ""))
