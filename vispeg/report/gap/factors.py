"""Which factor costs what: a heat map of policy by world, the total split into main effects and their interaction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vispeg.report.figures import MEASURED, new_figure, styled, svg
from vispeg.report.gap import words

TITLE = "What the change costs, and which part of it"


def context(values: Mapping[str, Any]) -> dict[str, Any]:
    """The heat map, rows of the attribution, gaps in words."""
    gaps = [
        {**row, "interval": words.lost(row["gap"]), "pairing": "" if row["paired"] else "other starts"}
        for row in values["gaps"]
    ]
    parts = []
    for row in values["attribution"]:
        cells = [_part(name, e, row) for name, e in row["parts"].items()]
        parts.append({"policy": row["policy"], "cells": cells})
    return {
        "picture": heat_map(values),
        "gaps": gaps,
        "parts": parts,
        "heads": ["total", *values["factors"], "together, beyond the sum"],
        "joint": values["joint"],
        "reference": values["reference"],
    }


def _part(name: str, e: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, str]:
    share = row["share"].get(name)
    certain = e["low"] > 0 or e["high"] < 0
    return {
        "value": words.lost(e),
        "share": "" if share is None else f"{100 * share:.0f} % of the total",
        "certain": "yes" if certain else "",
    }


def heat_map(values: Mapping[str, Any]) -> str:
    """Points of success lost, policies by target worlds; empty without targets."""
    worlds = [w["name"] for w in values["worlds"] if w["name"] != values["reference"]]
    policies = [p["name"] for p in values["policies"]]
    found = {(g["policy"], g["world"]): g for g in values["gaps"]}
    if not found:
        return ""
    loss = np.array([[_loss(found.get((p, w))) for w in worlds] for p in policies])
    with styled():
        figure = new_figure(0.75 + 0.5 * len(policies))
        ax = figure.add_subplot()
        top = max(10.0, float(np.nanmax(np.abs(loss))))
        ax.imshow(np.ma.masked_invalid(loss), cmap="RdBu_r", vmin=-top, vmax=top, aspect="auto", alpha=0.85)
        for i, p in enumerate(policies):
            for j, w in enumerate(worlds):
                g = found.get((p, w))
                if g is None:
                    continue
                dark = abs(loss[i, j]) > 0.62 * top
                ink = "white" if dark else MEASURED
                ax.text(j, i - 0.1, words.points(g["gap"]["value"]), ha="center", va="center", color=ink, fontsize=11)
                ends = f"{words.whole(g['gap']['low'])} to {words.whole(g['gap']['high'])}"
                ax.text(j, i + 0.27, ends, ha="center", va="center", color=ink, fontsize=7)
        ax.set_xticks(range(len(worlds)), worlds)
        ax.set_yticks(range(len(policies)), policies)
        ax.xaxis.tick_top()
        ax.tick_params(length=0, labelcolor=MEASURED, labelsize=9)
        for side in ax.spines.values():
            side.set_visible(False)
        return svg(figure, "heat", "Points of success lost by policy and world")


def _loss(row: Mapping[str, Any] | None) -> float:
    return float("nan") if row is None else 100 * row["gap"]["value"]
