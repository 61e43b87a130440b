"""The interactive section: the reader switches effects on and off, and sees the error and each joint's residual."""

from __future__ import annotations

import numpy as np

from vispeg.report.evidence import Choices
from vispeg.report.live.traces import STYLES as CHART_STYLES
from vispeg.report.live.traces import coded, inert
from vispeg.report.record import Record
from vispeg.report.text import effect_words, words
from vispeg.report.text.quantities import PREFIXED, quantity

TITLE = "Try it: the model's error"
SCRIPTS = ("vendored/uPlot.js", "charts.js", "explore.js")
STYLES = CHART_STYLES
SHARE = 0.05  # share of the largest residual below which joints are hidden at first


def context(record: Record) -> dict[str, object] | None:
    """Return buttons for effects and rivals, a bar for the error, and the script's data; None without choices."""
    choices = record.evidence.choices
    if choices is None or not len(choices.error) or not choices.residuals:
        return None
    unit, floor = record.evidence.unit, record.floor
    last = int(np.flatnonzero(np.array(choices.rivals) == "")[-1])
    rows = [_row(choices, i, unit, floor) for i in range(len(choices.error))]
    data = {
        "on": choices.on.astype(int).tolist(),
        "rival": list(choices.rivals),
        "rows": rows,
        "start": last,
        "joints": list(record.evidence.joints),
        **_traces(choices, unit),
    }
    return {
        "effects": [_named(record, name, where) for name, where in choices.effects],
        "rivals": [(i, _rival_words(name), name) for i, name in enumerate(choices.rivals) if name],
        "joints": _joints(record.evidence.joints, choices),
        "recordings": [name for name, _, _ in choices.residuals],
        "start": rows[last],
        "first": rows[0],
        "bar": _bar_marks(choices, floor),
        "data": inert(data),
        "held_out": record.kind == "diagnosis",
        "one_by_one": len(choices.effects) > 1 and len(choices.on) < 2 ** len(choices.effects),
    }


def _named(record: Record, name: str, where: str) -> dict[str, str]:
    listed = [*record.rows("effects"), *record.rows("partial")]
    row = next((e for e in listed if (e.get("effect"), e.get("where")) == (name, where)), None)
    sure = " (tentative)" if row is not None and row.get("tentative") else ""
    return {
        "words": effect_words.named({"effect": name, "where": where}) + sure,
        "size": "" if row is None else effect_words.size(row),
        "name": f"{name}({where})",
    }


def _rival_words(name: str) -> str:
    """Return a rival in words: `Payload at the flange in place of ...` for `payload(flange) in place of ...`."""

    def word(label: str) -> str:
        effect, _, where = label.partition("(")
        return effect_words.named({"effect": effect, "where": where.rstrip(")")})

    return " in place of ".join(word(label) for label in name.split(" in place of "))


def _row(choices: Choices, i: int, unit: str, floor: float | None) -> dict[str, object]:
    error, first = float(choices.error[i]), float(choices.error[0])
    return {
        "error": quantity(error, unit),
        "change": "" if i == 0 else words.change(first, error) or "stays",
        "floor": words.against_floor(error, floor),
        "at": _position(error, choices, floor),
        "joints": [quantity(float(v), unit) for v in choices.joints[i]],
    }


def _ends(choices: Choices, floor: float | None) -> tuple[float, float]:
    """Return the ends (low, high) of the bar's logarithmic axis, at least a decade, with room below the least error."""
    errors = [float(e) for e in choices.error if np.isfinite(e) and e > 0] + ([floor] if floor else [])
    high = max(errors, default=1.0)
    return min(min(errors, default=0.1) / 1.6, high / 10), high


def _position(error: float, choices: Choices, floor: float | None) -> float:
    """Return an error's position on the bar, in per cent of its length."""
    low, high = _ends(choices, floor)
    if not np.isfinite(error) or error <= 0:
        return 100.0 if not np.isfinite(error) else 0.0
    return round(100 * float(np.clip(np.log(error / low) / np.log(high / low), 0, 1)), 2)


def _bar_marks(choices: Choices, floor: float | None) -> dict[str, float | None]:
    return {
        "floor": None if not floor else _position(floor, choices, floor),
        "first": _position(float(choices.error[0]), choices, floor),
    }


def _joints(names: tuple[str, ...], choices: Choices) -> list[tuple[str, bool]]:
    """Return (joint, whether it is shown at first): those with at least SHARE of the first model's largest error."""
    first = np.nan_to_num(choices.joints[0])
    return [(name, bool(first[j] >= SHARE * first.max(initial=0.0))) for j, name in enumerate(names)]


def _traces(choices: Choices, unit: str) -> dict[str, object]:
    """Return the encoded residuals of each recording, for each choice and joint."""
    recordings = []
    for name, time, values in choices.residuals:
        m, n, nj = values.shape
        rows = coded(values.transpose(0, 2, 1).reshape(m * nj, n))
        recordings.append({"name": name, "time": np.round(time, 4).tolist(), **rows})
    return {"unit": unit, "prefixed": unit in PREFIXED, "recordings": recordings}
