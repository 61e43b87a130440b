"""Which factor costs what: a heat map of policy by world, the total split into main effects and their interaction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.gap import words, worlds
from vispeg.report.gap.colours import ordered

TITLE = "What the change costs, and which part of it"


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
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
        "heat": heat_map(values),
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


def heat_map(values: Mapping[str, Any]) -> Mapping[str, object] | None:
    """Points of success lost, policies by target worlds, each with its tint; None without targets."""
    names = [w["name"] for w in values["worlds"] if w["name"] != values["reference"]]
    gaps = {(g["policy"], g["world"]): g["gap"] for g in values["gaps"]}
    if not gaps:
        return None
    top = max(0.1, *(abs(e["value"]) for e in gaps.values()))
    rows = [
        {"policy": p["name"], "cells": [_cell(gaps.get((p["name"], w)), top) for w in names]}
        for p in ordered(values["policies"])
    ]
    return {"heads": [(w, worlds.caption(w, values)) for w in names], "rows": rows}


def _cell(e: Mapping[str, Any] | None, top: float) -> dict[str, str]:
    if e is None:
        return {"value": "-", "ends": "", "tint": "transparent"}
    colour, share = ("before" if e["value"] > 0 else "depth"), round(70 * abs(e["value"]) / top)
    tint = f"color-mix(in srgb, var(--{colour}) {share}%, transparent)"
    ends = f"{words.hundredths(e['low'])} to {words.hundredths(e['high'])}"
    return {"value": words.points(e["value"]), "ends": ends, "tint": tint}
