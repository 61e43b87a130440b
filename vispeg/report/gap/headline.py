"""The headline of the page: key figures, bars, worlds, and one line per policy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg.evaluation.statistics import CANNOT_TELL
from vispeg.report.gap import bars, words, worlds
from vispeg.report.gap.colours import of_policies

TITLE = "The gap"
RANK = list(words.ROLES.values())  # policies with cameras come first, before those that know the goal or are blind
MOST = 5  # most figures side by side


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
    """Return the template's values: headline of the joint or last target, figures, and one line per policy."""
    target = values["joint"] or (values["worlds"][-1]["name"] if len(values["worlds"]) > 1 else None)
    reference = values["reference"]
    rates = {(r["policy"], r["world"], r["control"]): r["success"] for r in values["success"]}
    gaps = {g["policy"]: g for g in values["gaps"] if g["world"] == target}
    shown = {n: e for (n, w, c), e in rates.items() if w == (target or reference) and not c}
    policies = [p for p in values["policies"] if p["name"] in (gaps if target else shown)]
    policies.sort(key=lambda p: (RANK.index(words.role(p)), -shown[p["name"]]["value"]))
    lines, figures = [], []
    for p in policies:
        name, e, g = p["name"], shown[p["name"]], gaps.get(p["name"])
        role = ", ".join(filter(None, (words.role(p), "home" if g and g["home"] else "")))
        note = words.change(g["gap"]) + " points" if g else f"{100 * e['low']:.0f} to {100 * e['high']:.0f}"
        figures.append((name, words.percent(e["value"]), "; ".join(filter(None, (role, note)))))
        if g:
            line = {"policy": name, "rate": words.rate_of(e), "words": g["words"], "cost": _dearest(values, name)}
            lines.append({**line, "role": role})
    return {
        "title": _best(values, policies, str(target), shown) if lines else _evaluation(values),
        "lines": lines,
        "figures": figures[:MOST],
        "target": target or reference,
        "reference": reference,
        "trained": worlds.home_of_all(reference, values["policies"]),
        "several": any(len(p["train_seeds"]) > 1 for p in values["policies"]),
        "bars": bars.context(values),
        "worlds": worlds.about(values),
        "outlined": any(p.second for p in of_policies(values["policies"]).values()),
    }


def _best(
    values: Mapping[str, Any], policies: Sequence[Mapping[str, Any]], target: str, rates: Mapping[str, Any]
) -> str:
    """Return the title: the policy with most success in the target, if the comparisons can tell."""
    best = policies[0]
    name, others = best["name"], [p["name"] for p in policies[1:] if words.role(p) == words.role(best)]
    verdicts = {
        frozenset((c["first"], c["second"])): c["verdict"] for c in values["comparisons"] if c["world"] == target
    }
    unsure = [other for other in others if verdicts.get(frozenset((name, other))) != "different"]
    if not others:
        return f"{name} in {target}: {words.rate_of(rates[name])}"
    if not unsure:
        return f"{name} keeps most in {target}: {words.rate_of(rates[name])}"
    rivals = " or ".join(unsure) if len(unsure) < 3 else f"{len(unsure)} others"
    return f"{name} has {words.rate_of(rates[name])} in {target}; whether that is more than {rivals}, {CANNOT_TELL}"


def _evaluation(values: Mapping[str, Any]) -> str:
    """Return the title of an evaluation in one world: the interval of a single policy, else a general title."""
    rows = [r for r in values["success"] if not r["control"]]
    if len(rows) > 1:
        return f"Success in {values['reference']}"
    count, _, interval = rows[0]["words"].partition(": ")
    return f"{rows[0]['policy']} in {values['reference']}: {count} succeed, so {interval}"


def _dearest(values: Mapping[str, Any], policy: str) -> str:
    """Return in words the cost of each single factor whose verdict is `different`, the largest first."""
    for row in values["attribution"]:
        if row["policy"] == policy:
            parts = [(f, row["parts"][f]) for f in values["factors"] if row["verdict"][f] == "different"]
            parts.sort(key=lambda part: -part[1]["value"])
            return "; ".join(f"{name} alone {words.change(e)}" for name, e in parts)
    return ""
