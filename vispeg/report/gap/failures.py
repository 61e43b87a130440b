"""How episodes fail in reference and target, and whether the distributions of failures differ."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vispeg.report.drawings.figures import MEASURED, Shape, chart, new_figure, quiet, side_by_side
from vispeg.report.gap import words
from vispeg.report.gap.colours import BY_CATEGORY, of_categories

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "How they fail"


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
    """Return the template's values: the picture, and one row per policy and target."""
    rows = []
    for row in values["categories"]:
        counts = [_counts(row["first"], row["n"][0]), _counts(row["second"], row["n"][1])]
        rows.append({**row, "counts": counts, "p_text": words.p_value(row["p"]), "verdict": row["words"]})
    return {"picture": picture(values), "rows": rows, "reference": values["reference"]}


def _counts(side: Mapping[str, int], n: int) -> str:
    order = sorted(((k, v) for k, v in side.items() if v), key=lambda kv: -kv[1])
    return ", ".join(f"{name} {count}" for name, count in order) + f" of {n}" if order else f"none of {n}"


def picture(values: Mapping[str, Any]) -> str:
    """Draw the share of each failure category as stacked bars: one panel per policy, one bar per world."""
    return chart(lambda shape: _figure(values, shape), "failures", "Failure categories by policy and world")


def _figure(values: Mapping[str, Any], shape: Shape) -> Figure | None:
    worlds, policies = [w["name"] for w in values["worlds"]], values["policies"]
    categories = {(r["policy"], r["world"]): r["categories"] for r in values["success"] if not r["control"]}
    names = list(dict.fromkeys(c for counts in categories.values() for c in counts if c != "success"))
    names.sort(key=lambda c: list(BY_CATEGORY).index(c) if c in BY_CATEGORY else len(BY_CATEGORY))
    if not names:
        return None
    colours = of_categories(names)
    lines, columns = shape.grid(len(policies), 4)
    figure = new_figure(0.7 + (0.6 + 0.23 * len(worlds)) * lines, shape.width)
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True).ravel()
    for ax in axes[len(policies) :]:
        ax.set_visible(False)
    for panel, (ax, policy) in enumerate(zip(axes, policies, strict=False)):
        for j, world in enumerate(worlds):
            counts, start = categories.get((policy["name"], world), {}), 0.0
            for c in names:
                share = 100 * counts.get(c, 0) / max(1, sum(counts.values()))
                ax.barh(j, share, left=start, height=0.72, color=colours[c])
                start += share
        ax.set(ylim=(len(worlds) - 0.4, -0.6))
        ax.set_title(policy["name"], color=MEASURED)
        ax.set_yticks(range(len(worlds)), worlds if panel % columns == 0 else [""] * len(worlds))
        ax.tick_params(axis="y", labelcolor=MEASURED)
        if panel >= len(policies) - columns:
            ax.set_xlabel("failed, %")
        quiet(ax, grid="x")
    from matplotlib.patches import Patch

    handles = [Patch(color=colours[c], label=c) for c in names]
    figure.legend(handles=handles, loc="outside upper left", ncols=side_by_side(figure, names), handlelength=1.4)
    return figure
