"""The cost of each factor: a heat map of policies by worlds, and the total split into main effects and interaction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.gap import words, worlds
from vispeg.report.gap.colours import ordered

TITLE = "What the change costs, and which part of it"


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
    """Return the template's values: heat map, rows of the attribution, and gaps in words."""
    gaps = [
        {**row, "interval": words.change(row["gap"]), "of": _of(row), "holm": words.p_value(row["p_holm"])}
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
        "worth": [f"{g['policy']} in {g['world']}: {g['worth']['words']}" for g in values["gaps"] if g.get("worth")],
        "heads": ["total", *values["factors"], "together, beyond the sum"],
        "joint": values["joint"],
        "reference": values["reference"],
    }


def _part(name: str, e: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, str]:
    share = row["share"].get(name)
    ends = "" if share is None else f" ({words.hundredths(share['low'])} to {words.hundredths(share['high'])})"
    return {
        "value": words.change(e),
        "share": "" if share is None else f"{words.hundredths(share['value'])} %{ends} of the total",
        "certain": "yes" if row["verdict"][name] == "different" else "",
    }


def _of(row: Mapping[str, Any]) -> str:
    """Return the sample behind a gap: `60 pairs`, `3 networks`, `20 episodes, not the same`."""
    if len(row["train_seeds"]) > 1:
        return f"{len(row['train_seeds'])} networks"
    return f"{row['gap']['n']} {'pairs' if row['paired'] else 'episodes, not the same'}"


def heat_map(values: Mapping[str, Any]) -> Mapping[str, object] | None:
    """Return the change of success in points, policies by target worlds, coloured if significant; None without any."""
    names = [w["name"] for w in values["worlds"] if w["name"] != values["reference"]]
    gaps = {(g["policy"], g["world"]): g for g in values["gaps"]}
    if not gaps:
        return None
    top = max([0.1, *(abs(g["gap"]["value"]) for g in gaps.values())])
    rows = [
        {"policy": p["name"], "cells": [_cell(gaps.get((p["name"], w)), top) for w in names]}
        for p in ordered(values["policies"])
    ]
    return {"heads": [(w, worlds.caption(w, values)) for w in names], "rows": rows}


def _cell(row: Mapping[str, Any] | None, top: float) -> dict[str, str]:
    if row is None:
        return {"value": "-", "ends": "", "tint": "transparent", "home": ""}
    e, tint = row["gap"], "transparent"
    if row["verdict"] == "different":
        colour, share = ("before" if e["value"] > 0 else "depth"), round(70 * abs(e["value"]) / top)
        tint = f"color-mix(in srgb, var(--{colour}) {share}%, transparent)"
    ends = f"{words.hundredths(-e['high'])} to {words.hundredths(-e['low'])}"
    return {"value": words.points(-e["value"]), "ends": ends, "tint": tint, "home": "home" if row["home"] else ""}
