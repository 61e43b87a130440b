"""Success of every policy in every world: bars with intervals, and the table with the controls."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.figures import MEASURED, MUTED, legend, new_figure, quiet, styled, svg
from vispeg.report.gap import words
from vispeg.report.gap.colours import of_policies

TITLE = "Success"


def context(values: Mapping[str, Any]) -> dict[str, Any]:
    """The picture, and rows of policies (then controls) by worlds."""
    worlds = [w["name"] for w in values["worlds"]]
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    roles = {p["name"]: words.role(p) for p in values["policies"]}
    for row in values["success"]:
        key = (row["policy"], row["control"])
        shown = rows.setdefault(key, {"name": words.name(row), "tag": "control", "cells": {}})
        shown["cells"][row["world"]] = row
        if not row["control"]:
            role = roles[row["policy"]]
            shown["tag"] = "blind control" if role == "blind" else role
    table = []
    for row in rows.values():
        cells = [_cell(row["cells"].get(w)) for w in worlds]
        known = [c["success"]["n"] for c in row["cells"].values()]
        spread = f"{min(known)}" if min(known) == max(known) else f"{min(known)}-{max(known)}"
        table.append({"name": row["name"], "tag": row["tag"], "cells": cells, "n": spread})
    return {"worlds": worlds, "rows": table, "picture": picture(values), "reference": values["reference"]}


def _cell(row: Mapping[str, Any] | None) -> dict[str, str]:
    if row is None:
        return {"rate": "-", "interval": "", "rest": ""}
    rest = [f"{row['time']:.1f} s"] if row["time"] is not None else []
    rest += [f"{row['peak_force']:.0f} N"] if row["peak_force"] is not None else []
    e = row["success"]
    interval = f"{100 * e['low']:.1f} to {100 * e['high']:.1f}"
    return {"rate": words.percent(e["value"]), "interval": interval, "rest": ", ".join(rest)}


def picture(values: Mapping[str, Any]) -> str:
    """Bars grouped by world, one a policy, with 95 % intervals; blind ones pale, teachers outlined."""
    worlds, policies = [w["name"] for w in values["worlds"]], values["policies"]
    colours = of_policies(policies)
    found = {(r["policy"], r["world"]): r["success"] for r in values["success"] if not r["control"]}
    width = 0.82 / len(policies)
    with styled():
        figure = new_figure(2.9)
        ax = figure.add_subplot()
        for i, policy in enumerate(policies):
            colour, seen = colours[policy["name"]], not words.role(policy)
            style: dict[str, Any] = {"color": colour, "alpha": 0.45 if policy["blind"] else 0.9}
            if words.role(policy).startswith("teacher"):
                style = {"facecolor": "none", "edgecolor": colour, "linewidth": 1.2}
            for j, world in enumerate(worlds):
                e = found.get((policy["name"], world))
                if e is None:
                    continue
                x = j + (i - (len(policies) - 1) / 2) * width
                ax.bar(x, 100 * e["value"], 0.88 * width, **style)
                ax.plot([x, x], [100 * e["low"], 100 * e["high"]], color=MEASURED, linewidth=1.3)
                if len(policies) * len(worlds) <= 26:
                    ink = "white" if e["value"] > 0.08 and seen else MEASURED
                    ax.annotate(f"{100 * e['value']:.0f}", (x, 1.5), ha="center", fontsize=7, color=ink)
        ax.set(ylim=(0, 104), ylabel="success, %", xlim=(-0.55, len(worlds) - 0.45))
        labels = [f"{w}\ntraining" if w == values["reference"] and len(worlds) > 1 else w for w in worlds]
        ax.set_xticks(range(len(worlds)), labels)
        ax.tick_params(axis="x", labelcolor=MUTED, labelsize=9)
        quiet(ax)
        legend(figure, {p["name"]: (colours[p["name"]], "-") for p in policies})
        return svg(figure, "success", "Success by world and policy, with 95 % intervals")
