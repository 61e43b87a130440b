"""The section on drift: each identified value in every recording, compared with its interval from identification."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vispeg.report.drawings.figures import AFTER, BEFORE, RULE, Shape, chart, new_figure, quiet
from vispeg.report.record import Record, label
from vispeg.report.text import effect_words
from vispeg.report.text.quantities import prefix
from vispeg.report.text.words import drifted, spread

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Has the robot changed?"


def context(record: Record) -> Mapping[str, object] | None:
    """Return sentences, one row per value, and the picture; None if the record has no drift."""
    drift = record.rows("drift")
    if not drift:
        return None
    return {
        "said": [sentence.removeprefix("has the robot changed? ") for sentence in drifted(drift)],
        "rows": [
            {
                "effect": label(row),
                "then": spread(row["parameter"], row["then"], row["unit"]),
                "now": [{**n, "text": spread("", n, row["unit"])} for n in row["now"]],
                "since": row["since"] or "-",
            }
            for row in drift
        ],
        "recordings": [n["recording"] for n in drift[0]["now"]],
        "picture": chart(lambda shape: _figure(drift, shape), "drift", "Each value over the recordings"),
    }


def _figure(drift: Sequence[Mapping[str, Any]], shape: Shape) -> Figure:
    columns = 3 if shape.name == "wide" else 1
    lines = math.ceil(len(drift) / columns)
    figure = new_figure(1.5 * lines + 0.3, shape.width)
    grid = figure.subplots(lines, columns, squeeze=False)
    for axes, row in zip(grid.ravel(), drift, strict=False):
        intervals = (row["then"], *row["now"])
        factor, unit = prefix(max(abs(e[key]) for e in intervals for key in ("low", "high")), row["unit"])
        then, *points = ({key: factor * e[key] for key in ("value", "low", "high")} for e in intervals)
        axes.axhspan(then["low"], then["high"], color=RULE)
        axes.axhline(then["value"], color=AFTER, linewidth=1)
        for k, (at, now) in enumerate(zip(points, row["now"], strict=True)):
            colour = BEFORE if now["outside"] else AFTER
            axes.plot([k, k], [at["low"], at["high"]], color=colour, linewidth=2)
            axes.plot(k, at["value"], "o", color=colour, markersize=4)
        named = ", ".join(part for part in (row["parameter"], effect_words.unit(unit)) if part)
        axes.set_title(f"{label(row)}: {named}", loc="left", fontsize="small")
        axes.set_xticks(range(len(row["now"])), [str(k + 1) for k in range(len(row["now"]))])
        quiet(axes, grid="y")
    for axes in grid.ravel()[len(drift) :]:
        axes.set_visible(False)
    return figure
