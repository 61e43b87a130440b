"""One colour a policy: a modality keeps its own through all figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

BY_MODALITY = {"state": "#16181d", "proprio": "#9aa1ab", "depth": "#0a7a75", "rgb": "#d9541e", "rgbd": "#5b4bb7"}
SPARE = ("#b0892b", "#2f6fb0", "#a2456b", "#5d7d2a", "#7a5230", "#3b8ea5", "#8e6bbf", "#c2703d")
BY_CATEGORY = {
    "success": "#cfe7e5",
    "approach": "#c9ced6",
    "search": "#e3b04b",
    "jam": "#d9541e",
    "wedge": "#a2456b",
    "slip": "#2f6fb0",
    "force limit": "#7a1f1f",
    "timeout": "#8a8f98",
    "diverged": "#16181d",
    "failure": "#d9541e",
}


def of_policies(policies: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Policy name -> colour. The first of a modality takes the modality's, the others spare ones in turn."""
    used, found = set(), {}
    spare = iter(SPARE * (1 + len(policies) // len(SPARE)))
    for row in policies:
        colour = BY_MODALITY.get(str(row["modality"]))
        found[row["name"]] = colour if colour and colour not in used else next(spare)
        used.add(found[row["name"]])
    return found
