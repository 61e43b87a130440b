"""The section on tossed objects: what windows of each length determine about each parameter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vispeg.report.drawings.figures import AFTER, BEFORE, MUTED, Shape, chart, new_figure
from vispeg.report.drawings.palette import day
from vispeg.report.record import Record, rows
from vispeg.report.text.quantities import interval, number, plain, quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Short windows and whole tosses"
CONTACT = {
    "friction": "coefficient of sliding friction",
    "restitution": "restitution",
    "time_constant_s": "solref's time constant, s",
    "damping_ratio": "solref's damping ratio",
}


def context(record: Record) -> Mapping[str, object] | None:
    """Return errors and parameters by window length, profiles, and contact parameters; None for an arm."""
    windows = record.rows("restarts")
    if not windows:
        return None
    contact = record.mapping("contact")
    return {
        "windows": [
            {"window": str(row.get("window", "?")), "count": row.get("count"), "median": _moved(row, "median_m", "m"),
             "turn": _moved(row, "median_rad", "rad"), "rms": _moved(row, "rms_m", "m")}
            for row in windows
        ],
        "parameters": [
            {"parameter": str(p.get("parameter", "?")), "window": str(row.get("window", "?")),
             "value": interval(p.get("best"), p.get("low"), p.get("high")), "told": bool(p.get("told"))}
            for row in windows
            for p in rows(row, "parameters")
        ],
        "contact": [(CONTACT[k], plain(v)) for k, v in contact.items() if k in CONTACT],
        "picture": chart(lambda shape: _figure(record, shape), "restarts", "Error over each parameter, by window"),
        "notes": [str(note) for note in record.values.get("notes") or ()],
    }  # fmt: skip


def _moved(row: Mapping[str, Any], key: str, unit: str) -> str:
    before, after = (quantity((row.get(side) or {}).get(key), unit) for side in ("before", "after"))
    return after if before == after else f"{before} → {after}"


def _figure(record: Record, shape: Shape) -> Figure | None:
    curves: dict[str, list[tuple[str, list[float], list[float]]]] = {}
    for row in record.rows("restarts"):
        for p in rows(row, "parameters"):
            x, y = ([number(v) for v in (p.get("profile") or {}).get(k) or ()] for k in ("value", "error"))
            pairs = [(a, b) for a, b in zip(x, y, strict=False) if a is not None and b is not None and a > 0]
            low = min((b for _, b in pairs), default=0.0)
            if low > 0:
                curve = [a for a, _ in pairs], [b / low for _, b in pairs]
                curves.setdefault(str(p.get("parameter", "?")), []).append((str(row.get("window", "?")), *curve))
    if not curves:
        return None
    lines, columns = shape.grid(len(curves), 3)
    figure = new_figure(0.5 + 2.1 * lines, shape.width)
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    for ax, (name, parts) in zip(axes, curves.items(), strict=False):
        ax.set_title(name, color=MUTED)
        for (window, x, y), colour in zip(parts, (AFTER, BEFORE, day("other")), strict=False):
            ax.plot(x, y, color=colour, label=window, marker="o", ms=2.5)
        ax.set_xscale("log")
        ticks = _ticks(min(min(x) for _, x, _ in parts), max(max(x) for _, x, _ in parts))
        ax.set_xticks(ticks, [f"{t:g}" for t in ticks])
        ax.minorticks_off()
    for ax in axes[len(curves) :]:
        ax.set_axis_off()
    axes[0].set_ylabel("error over least error")
    axes[0].legend()
    return figure


def _ticks(low: float, high: float) -> list[float]:
    steps = [
        m * 10.0**e for e in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1) for m in (1, 2, 5)
    ]
    inside = [s for s in steps if low <= s <= high]
    return inside[:: max(1, len(inside) // 4)]
