"""Colours of policies and of failures: each modality has the same colour on all pages and in the pictures of README."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from vispeg.report.drawings.palette import day

BY_MODALITY = {m: day(m) for m in ("state", "depth", "rgbd", "rgb")} | {
    "privileged": day("plum"),
    "proprio": day("blind"),
}
FURTHER = ("other", "lagoon", "plum", "olive", "brown", "rival", "violet", "wine", "red", "amber")
SPARE = tuple(map(day, FURTHER))  # for what has no colour of its own, where the picture does not use them yet
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
    "failure": day("brown"),
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
    spare, used = _spare(BY_MODALITY[m] for m in counts if m in BY_MODALITY), Counter[str]()
    for row in ordered(policies):
        modality = str(row["modality"])
        colour = BY_MODALITY.get(modality)
        used[modality] += 1
        if colour is not None and (used[modality] == 1 or counts[modality] == 2):
            styles[row["name"]] = Style(colour, used[modality] > 1)
        else:
            styles[row["name"]] = Style(next(spare))
    return styles


def of_categories(names: Iterable[str]) -> dict[str, str]:
    """Return category -> colour for the categories of one picture; a user's own words have spare colours in turn."""
    names = list(names)
    spare = _spare(BY_CATEGORY[c] for c in names if c in BY_CATEGORY)
    return {c: BY_CATEGORY.get(c) or next(spare) for c in names}


def _spare(used: Iterable[str]) -> Iterator[str]:
    """Return spare colours that are not used yet, again and again."""
    taken = set(used)
    return itertools.cycle(c for c in SPARE if c not in taken)


def ordered(policies: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Sort policies by modality: state, depth, RGB-D, RGB, privileged, others, blind."""
    order = [m for m in BY_MODALITY if m != "proprio"]
    places = {m: i for i, m in enumerate(order)} | {"proprio": len(order) + 1}
    return sorted(policies, key=lambda p: places.get(str(p["modality"]), len(order)))
