"""What a reader should take away, in three sentences and three numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.gap import words

TITLE = "The gap"


def context(values: Mapping[str, Any]) -> dict[str, Any]:
    """The hardest target's headline, one line a policy, and what the controls say."""
    target = values["joint"] or (values["worlds"][-1]["name"] if len(values["worlds"]) > 1 else None)
    reference = values["reference"]
    rates = {(r["policy"], r["world"], r["control"]): r["success"] for r in values["success"]}
    gaps = {g["policy"]: g for g in values["gaps"] if g["world"] == target}
    lines, figures = [], []
    for p in values["policies"]:
        g = gaps.get(p["name"])
        if g is None:
            continue
        lines.append(
            {"policy": p["name"], "words": g["words"], "cost": _dearest(values, p["name"]), "blind": p["blind"]}
        )
        figures.append((p["name"], words.percent(rates[p["name"], str(target), ""]["value"]), words.lost(g["gap"])))
    if target is None:
        shown = [(n, e) for (n, w, c), e in rates.items() if w == reference and not c]
        figures = [(n, words.percent(e["value"]), f"{100 * e['low']:.0f} to {100 * e['high']:.0f}") for n, e in shown]
    best = max((f for f in figures), key=lambda f: rates[f[0], str(target or reference), ""]["value"], default=None)
    return {
        "title": f"{best[0]} keeps most in {target}: {best[1]}" if best and target else f"Success in {reference}",
        "lines": lines,
        "figures": [(n, value, f"lost {rest}" if target else rest) for n, value, rest in figures][:5],
        "target": target or reference,
        "reference": reference,
        "controls": _controls(values),
        "factors": values["factors"],
    }


def _dearest(values: Mapping[str, Any], policy: str) -> str:
    """The factor that costs most, where one stands out."""
    for row in values["attribution"]:
        if row["policy"] == policy:
            parts = {f: row["parts"][f] for f in values["factors"]}
            name, e = max(parts.items(), key=lambda kv: kv[1]["value"])
            return f"of the single factors, {name} costs most: {words.lost(e)}" if e["low"] > 0 else ""
    return ""


def _controls(values: Mapping[str, Any]) -> list[str]:
    """A sentence a control in the reference world."""
    rates = {(r["policy"], r["world"], r["control"]): r["success"] for r in values["success"]}
    found, reference = [], values["reference"]
    for (policy, world, control), e in rates.items():
        own = rates.get((policy, reference, ""))
        if control and world == reference and own:
            what = words.CONTROLS.get(control, control)
            found.append(f"{policy} with {what}: {words.rate(e)} instead of {words.percent(own['value'])}")
    for p in values["policies"]:
        e = rates.get((p["name"], reference, ""))
        if p["blind"] and e:
            found.append(f"{p['name']} sees nothing: {words.rate(e)}")
    return found
