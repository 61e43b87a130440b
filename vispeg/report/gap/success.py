"""Success of every policy in every world: a bar chart with intervals, and a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vispeg.report.drawings.figures import GROUND, MEASURED, MUTED, Shape, new_figure, quiet, side_by_side
from vispeg.report.gap import words, worlds
from vispeg.report.gap.colours import Style, of_policies, ordered

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Success, in numbers"
NUMBERED = 26  # most bars side by side that have room for their numbers


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
    """Return the template's values: a table of policies by worlds."""
    names = [w["name"] for w in values["worlds"]]
    rows = {}
    for policy in values["policies"]:
        role = words.role(policy)
        rows[policy["name"]] = {"tag": "blind control" if role == "blind" else role, "cells": {}}
    for row in values["success"]:
        if not row["control"]:
            rows[row["policy"]]["cells"][row["world"]] = row
    table, home = [], {p["name"]: p["home"] for p in values["policies"]}
    for name, row in rows.items():
        counts = [c["success"]["n"] for c in row["cells"].values()] or [0]
        spread = f"{min(counts)}" if min(counts) == max(counts) else f"{min(counts)}-{max(counts)}"
        cells = [_cell(row["cells"].get(w), w in (home[name] or ())) for w in names]
        table.append({"name": name, "tag": row["tag"], "cells": cells, "n": spread})
    return {"worlds": names, "rows": table}


def _cell(row: Mapping[str, Any] | None, home: bool) -> dict[str, str]:
    if row is None:
        return {"rate": "-", "interval": "", "rest": "", "home": ""}
    rest = [f"{row['time']:.1f} s"] if row["time"] is not None else []
    rest += [f"{row['peak_force']:.0f} N"] if row["peak_force"] is not None else []
    e = row["success"]
    interval = f"{100 * e['low']:.1f} to {100 * e['high']:.1f}"
    return {
        "rate": words.percent(e["value"]),
        "interval": interval,
        "rest": ", ".join(rest),
        "home": "home" if home else "",
    }


def figure(values: Mapping[str, Any], shape: Shape) -> Figure:
    """Draw one bar per policy with its 95 % interval, grouped by world; a narrow figure stacks the groups."""
    return (_horizontal if shape.narrow else _vertical)(values, shape)


def _vertical(values: Mapping[str, Any], shape: Shape) -> Figure:
    names, policies = [w["name"] for w in values["worlds"]], ordered(values["policies"])
    styles, rates = of_policies(policies), _rates(values)
    width = 0.82 / len(policies)
    figure = new_figure(3.4, shape.width)
    ax = figure.add_subplot()
    for i, policy in enumerate(policies):
        style = styles[policy["name"]]
        for j, world in enumerate(names):
            e = rates.get((policy["name"], world))
            if e is None:
                continue
            x = j + (i - (len(policies) - 1) / 2) * width
            ax.bar(x, 100 * e["value"], 0.9 * width, **_fill(style))
            ax.plot([x, x], [100 * e["low"], 100 * e["high"]], color=MEASURED, linewidth=1.3)
            if len(policies) * len(names) <= NUMBERED:
                high = 100 * max(e["high"], e["value"])
                ax.annotate(f"{100 * e['value']:.0f}", (x, high), (0, 2), textcoords="offset points", ha="center")
    ax.set(ylim=(0, 112), ylabel="success, %", xlim=(-0.55, len(names) - 0.45), yticks=range(0, 101, 20))
    ax.set_xticks(range(len(names)), [f"{w}\n{worlds.caption(w, values)}".strip() for w in names])
    ax.tick_params(axis="x", labelcolor=MEASURED)
    quiet(ax)
    _legend(figure, styles)
    return figure


def _horizontal(values: Mapping[str, Any], shape: Shape) -> Figure:
    names, policies = [w["name"] for w in values["worlds"]], ordered(values["policies"])
    styles, rates = of_policies(policies), _rates(values)
    figure = new_figure(0.3 + len(names) * (0.45 + 0.2 * len(policies)), shape.width)
    for ax, world in zip(figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0], names, strict=True):
        for i, policy in enumerate(policies):
            e = rates.get((policy["name"], world))
            if e is not None:
                ax.barh(i, 100 * e["value"], 0.8, **_fill(styles[policy["name"]]))
                ax.plot([100 * e["low"], 100 * e["high"]], [i, i], color=MEASURED, linewidth=1.3)
                ax.annotate(f"{100 * e['value']:.0f} %", (104, i), va="center", annotation_clip=False)
        ax.set(xlim=(0, 128), ylim=(len(policies) - 0.4, -0.6), xticks=range(0, 101, 50))
        ax.set_yticks(range(len(policies)), [p["name"] for p in policies])
        text = ", ".join(filter(None, (world, worlds.caption(world, values))))
        ax.set_title(text, fontweight="bold", color=MEASURED, x=0.0)
        ax.tick_params(axis="y", labelcolor=MUTED)
        quiet(ax, grid="x")
    return figure


def _rates(values: Mapping[str, Any]) -> dict[tuple[str, str], Any]:
    return {(r["policy"], r["world"]): r["success"] for r in values["success"] if not r["control"]}


def _fill(style: Style) -> Mapping[str, Any]:
    return {"facecolor": style.colour, "hatch": style.hatch, "edgecolor": GROUND, "linewidth": 0}


def _legend(figure: Figure, styles: Mapping[str, Style]) -> None:
    from matplotlib.patches import Patch

    handles = [Patch(label=name, **_fill(style)) for name, style in styles.items()]
    figure.legend(handles=handles, loc="outside upper left", ncols=side_by_side(figure, styles), handlelength=1.4)
