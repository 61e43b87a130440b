"""Compare two policies on the same episodes: seeds that both solve, that only one solves, and how the others end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vispeg.evaluation.records import Episode
from vispeg.report.drawings.palette import name_of
from vispeg.report.gap.colours import of_categories
from vispeg.report.live.traces import inert

TITLE = "Episode by episode"
SCRIPTS = ("gap/episodes.js",)
MOST = 1_000  # seeds that the page lists


def context(
    values: Mapping[str, Any], episodes: Sequence[Episode], media: Sequence[Mapping[str, Any]] = ()
) -> Mapping[str, object] | None:
    """Return the data for the page's script; None if no two sides can be paired.

    A side is a policy with one training seed. Episodes of controls and of configurations are left out.
    """
    plain = [e for e in episodes if not e.control and not e.configuration]
    worlds = [w["name"] for w in values["worlds"] if any(e.world == w["name"] for e in plain)]
    replicas = {e.policy: len({o.train_seed for o in plain if o.policy == e.policy}) for e in plain}
    sides = list(dict.fromkeys((e.policy, e.train_seed) for e in plain))
    names = [f"{p} (seed {s})" if replicas[p] > 1 else p for p, s in sides]
    seeds = sorted({e.seed for e in plain})[:MOST]
    if not worlds or len(sides) * len(worlds) < 2 or not seeds:
        return None
    ends = list(dict.fromkeys(["success", *(e.category for e in plain)]))
    place = {seed: k for k, seed in enumerate(seeds)}
    rows: dict[str, Mapping[str, object]] = {}
    for i, side in enumerate(sides):
        for j, world in enumerate(worlds):
            of_side = [e for e in plain if (e.policy, e.train_seed) == side and e.world == world and e.seed in place]
            end: list[int | None] = [None] * len(seeds)
            numbers: dict[str, list[float | None]] = {"time": [None] * len(seeds), "force": [None] * len(seeds)}
            for e in of_side:
                k = place[e.seed]
                end[k] = 0 if e.success else ends.index(e.category)
                for key, value in (("time", e.time), ("force", e.peak_force)):
                    numbers[key][k] = round(value, 1) if np.isfinite(value) else None
            if of_side:
                rows[f"{i},{j}"] = {"end": end, **numbers}
    films = [
        {
            "policy": m["policy"],
            "seed": m["seed"],
            "world": side["world"],
            "at": f"film-{k}",
            "trained": m.get("train_seed"),  # older results do not state it
        }
        for k, m in enumerate(media)
        for side in m["sides"]
    ]
    colours = of_categories(ends)
    data = {
        "policies": [p for p, _ in sides],
        "trained": [s for _, s in sides],
        "names": names,
        "worlds": worlds,
        "seeds": seeds,
        "ends": ends,
        "colours": [name_of(colours[c]) for c in ends],
        "rows": rows,
        "films": films,
    }
    first, second = (0, 1) if len(sides) > 1 else (0, 0)
    pair = [(names[first], worlds[-1]), (names[second], worlds[-1] if len(sides) > 1 else worlds[0])]
    return {"data": inert(data), "names": names, "worlds": worlds, "pair": pair, "start": (first, second)}
