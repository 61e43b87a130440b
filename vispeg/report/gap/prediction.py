"""Whether success in the training world predicts success elsewhere: a scatter plot per world, and three measures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vispeg.evaluation.statistics import FEWEST_POLICIES
from vispeg.report.drawings.figures import MUTED, RULE, Shape, chart, new_figure, quiet
from vispeg.report.gap import words
from vispeg.report.gap.colours import of_policies

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Does the first world predict the others?"


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
    """Return the template's values: the picture, and one row per target world."""
    rows = []
    for row in values["prediction"]:
        pairs = row["n"] * (row["n"] - 1) // 2
        cells = [_interval(row["pearson"]) if row["n"] >= FEWEST_POLICIES else "-"]
        ceiling = row.get("ceiling")  # older records have none
        cells.append("-" if ceiling is None or row["measured"] is None else f"{row['measured']:.2f} of {ceiling:.2f}")
        cells += [
            f"{row['mmrv']:.2f} ({row['ordered']} of {pairs} pairs)",
            words.change(row["mean_difference"]),
        ]
        rows.append({"world": row["world"], "n": row["n"], "cells": cells, "words": row["words"]})
    return {"picture": picture(values) if rows else "", "rows": rows, "reference": values["reference"]}


def _interval(e: Mapping[str, Any]) -> str:
    if e["value"] is None:
        return "-"
    if e["low"] is None:
        return f"{e['value']:.2f}"
    return f"{e['value']:.2f} ({e['low']:.2f} to {e['high']:.2f})"


def picture(values: Mapping[str, Any]) -> str:
    """Draw success in each target over success in the reference, one point per trained network."""
    text = f"Success in {values['reference']} against success in the targets"
    return chart(lambda shape: _figure(values, shape), "prediction", text)


def _figure(values: Mapping[str, Any], shape: Shape) -> Figure:
    rows, styles = values["prediction"], of_policies(values["policies"])
    lines, columns = shape.grid(len(rows), 4)
    figure = new_figure(min(2.4, 0.75 * shape.width / columns + 0.7) * lines, shape.width)
    axes = figure.subplots(lines, max(2, columns), squeeze=False)
    for ax in axes.flat[len(rows) :]:
        ax.set_visible(False)
    for ax, row in zip(axes.flat, rows, strict=False):
        ax.plot([0, 100], [0, 100], color=RULE, linewidth=1)
        for p in row["points"]:
            style = styles[p["policy"]]
            fill = "none" if style.second else style.colour
            dot = {"color": style.colour, "markersize": 5, "alpha": 0.8, "markerfacecolor": fill}
            ax.plot(100 * p["reference"], 100 * p["target"], "o", **dot)
        ax.set(xlim=(-4, 104), ylim=(-4, 104), aspect="equal", xticks=[0, 50, 100], yticks=[0, 50, 100])
        ax.set_title(row["world"], color=MUTED)
        ax.set_xlabel(f"{values['reference']}, %")
        quiet(ax, grid="both")
    for ax in axes[:, 0]:
        ax.set_ylabel("target, %")
    return figure
