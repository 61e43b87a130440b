"""The headline section: the verdict in words, the error of each model, and the effects that were found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from vispeg.report.drawings.figures import chart
from vispeg.report.drawings.ladder import ladder_figure, ladder_rows
from vispeg.report.record import Record, data_link
from vispeg.report.text import camera_words, contact_words, effect_words, words
from vispeg.report.text.quantities import number, quantity

TITLE = "Verdict"
APART = 0.045  # distance between marks of one joint, in widths or heights of the picture


def context(record: Record) -> Mapping[str, object]:
    """Return the values that the template `headline.html.j2` shows, by name.

    Each of `figures` is a title, a quantity and a note.
    """
    values = record.values
    first, last, unit = words.ladder_ends(values)
    floor = record.mapping("noise_floor")
    name, against = words.error_name(values), words.against_floor(last, record.floor)
    if len(record.rows("ladder")) > 1:
        note = name[0].lower() + name[1:]
        figures = [("Before", quantity(first, unit), note), ("After", quantity(last, unit), against or note)]
    else:
        figures = [(name, quantity(last, unit), against)]
    if record.floor is not None:
        figures.append(("Noise floor", quantity(record.floor, str(floor.get("unit") or unit)), _source(floor)))
    return {
        "verdict": values.get("verdict") if record.kind == "diagnosis" else None,
        "sentence": " ".join(filter(None, (*words.diverged(values), words.verdict(values)))),
        "change": words.baseline(values),
        "error_change": words.fall(values),
        "phases": contact_words.phases(values),
        "cameras": camera_words.cameras(values),
        "figures": figures,
        "picture": chart(lambda shape: ladder_figure(record, shape), "ladder", words.fall(values)),
        "ladder": ladder_rows(record),
        "fitted": any(number(row.get("fit_error")) is not None for row in record.rows("ladder")),
        "next_step": words.onward(values) if record.kind == "diagnosis" else "",
        "reason": words.reason(values),
        "judged": _judged(record),
        "contact_residual": contact_words.left(values) if values.get("unexplained") else "",
        "robot": "" if record.robot is None else data_link(record.robot),
        "marks": _marks(record),
        "floor_unit_differs": bool(floor.get("unit")) and floor.get("unit") != unit and bool(unit),
    }


def _judged(record: Record) -> str:
    """Return in words on which recordings the ladder's errors were computed."""
    if record.values.get("judged") == "fitted":
        return "Fitted recordings"
    return "Recordings" if record.kind == "compare" else "Held-out recordings"


def _marks(record: Record) -> list[dict[str, str]]:
    """Return `words`, `x` and `y` of the found effects that have a place in the robot's picture.

    x and y are per cent of its width and height, from the top left. Tentative effects are left out.
    """
    places = record.mapping("picture").get("places")
    marks, taken = [], Counter[tuple[float, float]]()
    if not isinstance(places, dict):
        return []
    for effect in record.rows("effects"):
        if effect.get("tentative"):
            continue
        x, y = places.get(str(effect.get("where"))) or (None, None)
        if x is not None and y is not None:
            left, top = _mark_place(x, y, taken[x, y])
            taken[x, y] += 1
            marks.append({"words": effect_words.sized(effect), "x": f"{100 * left:.1f}", "y": f"{100 * top:.1f}"})
    return marks


def _mark_place(x: float, y: float, k: int) -> tuple[float, float]:
    """Return the place of mark number `k`, from 0, of a joint at (x, y), in widths and heights of the picture.

    Marks of one joint stand side by side up to the picture's right edge, then in rows towards its middle.
    """
    row, column = divmod(k, 1 + max(0, int((1.0 - x) / APART)))
    return x + APART * column, y + APART * row * (1 if y < 0.5 else -1)


def _source(floor: Mapping[str, Any]) -> str:
    """Return in words where the noise floor comes from; empty if the record does not say."""
    source = floor.get("from")
    return {"repeats": "from repeats", "stated noise": "from stated noise"}.get(str(source), str(source or ""))
