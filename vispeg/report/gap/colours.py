"""Colours of policies: each modality has the same colour on all pages and in the pictures of README."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from vispeg.report.drawings.palette import day

BY_MODALITY = {m: day(m) for m in ("state", "depth", "rgbd", "rgb")} | {
    "privileged": day("plum"),
    "proprio": day("blind"),
}
SPARE = tuple(map(day, ("other", "lagoon", "plum", "olive", "brown", "rival", "violet")))
BY_CATEGORY = {  # category of an episode's end
    "success": day("after"),
    "approach": day("pale"),
    "search": day("sand"),
    "jam": day("before"),
    "wedge": day("plum"),
    "slip": day("depth"),
    "force limit": day("wine"),
    "timeout": day("slate"),
    "diverged": day("ink"),
    "joint velocity": day("lagoon"),
    "joint limit": day("olive"),
    "singularity": day("violet"),
    "failure": day("before"),
}


@dataclass(frozen=True)
class Style:
    """A policy's colour, and whether it is the second of its modality (drawn hatched, dashed or hollow)."""

    colour: str
    second: bool = False

    @property
    def hatch(self) -> str | None:
        """Hatch of bars, for matplotlib."""
        return "////" if self.second else None

    @property
    def line(self) -> str:
        """Line style of curves, for matplotlib."""
        return "--" if self.second else "-"


def of_policies(policies: Sequence[Mapping[str, Any]]) -> dict[str, Style]:
    """Return policy name -> style.

    The first policy of a modality has the modality's colour. If there are two, the second has the same colour, hatched.
    If there are more, all but the first have spare colours in turn.
    """
    counts, styles = Counter(str(row["modality"]) for row in policies), {}
    spare, used = itertools.cycle(SPARE), Counter[str]()
    for row in policies:
        modality = str(row["modality"])
        colour = BY_MODALITY.get(modality)
        used[modality] += 1
        if colour is not None and (used[modality] == 1 or counts[modality] == 2):
            styles[row["name"]] = Style(colour, used[modality] > 1)
        else:
            styles[row["name"]] = Style(next(spare))
    return styles


def ordered(policies: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Sort policies by modality: state, depth, RGB-D, RGB, privileged, others, blind."""
    order = [m for m in BY_MODALITY if m != "proprio"]
    places = {m: i for i, m in enumerate(order)} | {"proprio": len(order) + 1}
    return sorted(policies, key=lambda p: places.get(str(p["modality"]), len(order)))
