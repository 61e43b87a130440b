"""Does success in the training world tell success elsewhere: a scatter a world, and the four measures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.figures import MUTED, RULE, new_figure, quiet, styled, svg
from vispeg.report.gap.colours import of_policies

TITLE = "Does the training world predict the others?"


def context(values: Mapping[str, Any]) -> dict[str, Any]:
    """The picture, and a row a target world."""
    rows = []
    for row in values["prediction"]:
        cells = [_interval(row[k]) for k in ("pearson", "spearman", "mmrv", "mean_difference")]
        rows.append({"world": row["world"], "n": row["n"], "cells": cells, "words": row["words"]})
    return {"picture": picture(values) if rows else "", "rows": rows, "reference": values["reference"]}


def _interval(e: Mapping[str, Any]) -> str:
    if e["value"] is None:
        return "-"
    if e["low"] is None:
        return f"{e['value']:.2f}"
    return f"{e['value']:.2f} ({e['low']:.2f} to {e['high']:.2f})"


def picture(values: Mapping[str, Any]) -> str:
    """Success in the reference against success in each target, one point a trained network."""
    rows, colours = values["prediction"], of_policies(values["policies"])
    with styled():
        figure = new_figure(2.4)
        axes = figure.subplots(1, max(4, len(rows)), squeeze=False)[0]
        for ax in axes[len(rows) :]:
            ax.set_visible(False)
        for ax, row in zip(axes, rows, strict=False):
            ax.plot([0, 100], [0, 100], color=RULE, linewidth=1)
            for p in row["points"]:
                dot = {"color": colours[p["policy"]], "markersize": 5, "alpha": 0.8, "markeredgewidth": 0}
                ax.plot(100 * p["reference"], 100 * p["target"], "o", **dot)
            ax.set(xlim=(-4, 104), ylim=(-4, 104), title=row["world"], aspect="equal")
            ax.set_xticks([0, 50, 100])
            ax.set_yticks([0, 50, 100])
            ax.set_xlabel(f"{values['reference']}, %")
            ax.title.set_color(MUTED)
            quiet(ax, grid="both")
        axes[0].set_ylabel("target, %")
        return svg(figure, "prediction", "Success in the training world against success in the targets")
