"""What a reader should take away: the picture, what the worlds in it are, and a line a policy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.gap import bars, words, worlds
from vispeg.report.gap.colours import of_policies

TITLE = "The gap"
RANK = list(words.ROLES.values())  # a policy that is told where the goal is, or sees nothing, wins nothing
MOST = 5  # figures side by side


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
    """The hardest target's headline, the picture, and one line a policy (those that see first)."""
    target = values["joint"] or (values["worlds"][-1]["name"] if len(values["worlds"]) > 1 else None)
    reference = values["reference"]
    rates = {(r["policy"], r["world"], r["control"]): r["success"] for r in values["success"]}
    gaps = {g["policy"]: g for g in values["gaps"] if g["world"] == target}
    there = {n: e for (n, w, c), e in rates.items() if w == (target or reference) and not c}
    policies = [p for p in values["policies"] if p["name"] in (gaps if target else there)]
    policies.sort(key=lambda p: (RANK.index(words.role(p)), -there[p["name"]]["value"]))
    lines, figures = [], []
    for p in policies:
        name, role, e, g = p["name"], words.role(p), there[p["name"]], gaps.get(p["name"])
        note = f"lost {words.lost(g['gap'])}" if g else f"{100 * e['low']:.0f} to {100 * e['high']:.0f}"
        figures.append((name, words.percent(e["value"]), "; ".join(filter(None, (role, note)))))
        if g:
            line = {"policy": name, "rate": words.rate(e), "words": g["words"], "cost": _dearest(values, name)}
            lines.append({**line, "role": role})
    best = f"{figures[0][0]} keeps most in {target}: {figures[0][1]}" if lines else ""
    return {
        "title": best or _evaluation(values),
        "lines": lines,
        "figures": figures[:MOST],
        "target": target or reference,
        "reference": reference,
        "bars": bars.context(values),
        "worlds": worlds.about(values),
        "outlined": any(p.second for p in of_policies(values["policies"]).values()),
    }


def _evaluation(values: Mapping[str, Any]) -> str:
    """The title of an evaluation in one world: what the episodes of its only policy can tell, or that it compares."""
    rows = [r for r in values["success"] if not r["control"]]
    if len(rows) > 1:
        return f"Success in {values['reference']}"
    count, _, interval = rows[0]["words"].partition(": ")
    return f"{rows[0]['policy']} in {values['reference']}: {count} succeed, so {interval}"


def _dearest(values: Mapping[str, Any], policy: str) -> str:
    """The factor that costs most, where one stands out."""
    for row in values["attribution"]:
        if row["policy"] == policy:
            parts = {f: row["parts"][f] for f in values["factors"]}
            name, e = max(parts.items(), key=lambda kv: kv[1]["value"])
            return f"of the single factors, {name} costs most: {words.lost(e)}" if e["low"] > 0 else ""
    return ""
