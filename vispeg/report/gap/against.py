"""Comparisons between policies on the same episodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.gap import words

TITLE = "One against another"


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
    """Return the template's values: rows of comparisons by world."""
    worlds: dict[str, list[Mapping[str, object]]] = {}
    for row in values["comparisons"]:
        needed = f"; {row['needed']} pairs would" if row["needed"] else ""
        cells = {
            "pair": f"{row['first']} - {row['second']}",
            "difference": words.signed(row["difference"]),
            "n": f"{row['difference']['n']}{'' if row['paired'] else ', unpaired'}",
            "p": words.p_value(row["p"]),
            "p_holm": words.p_value(row["p_holm"]),
            "verdict": row["verdict"] + (f": {row['refused']}" if row["refused"] else needed),
            "certain": row["verdict"] == "different",
        }
        worlds.setdefault(row["world"], []).append(cells)
    several = {p["name"] for p in values["policies"] if len(p["train_seeds"]) > 1}
    return {
        "several": bool(several),
        "worlds": [
            {"name": w, "rows": rows, "differ": sum(bool(r["certain"]) for r in rows)} for w, rows in worlds.items()
        ],
    }
