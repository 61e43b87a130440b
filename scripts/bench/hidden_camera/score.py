"""The table of a benchmark: which of the hidden effects were named."""

from __future__ import annotations

from typing import Any

import numpy as np


def judged(case, result: dict[str, Any]) -> dict[str, Any]:
    """Return one case's row."""
    hidden = {(e, w): dict(v) for e, w, v in case.hidden}
    found = {(e["effect"], e["where"]): e for e in result["effects"]}
    among = set(found) | {(o["effect"], o["where"]) for e in found.values() for o in e["indistinguishable_from"]}
    sure = result["verdict"] == "identified"
    classes = [{key, *((o["effect"], o["where"]) for o in e["indistinguishable_from"])} for key, e in found.items()]
    right = set(hidden) <= among and bool(hidden) and all(c & set(hidden) for c in classes)
    silent = {(n["effect"], n["where"]): n.get("numbers") for n in result["not_excited"]}
    unseen = {key for key, v in hidden.items() if key in silent and set(v) <= set(silent[key] or v)}
    errors, inside = {}, []
    for key in set(hidden) & set(found):
        for name, p in found[key]["params"].items():
            truth = hidden[key].get(name, result["null"].get(f"{key[0]}.{name}", 0.0))
            errors[f"{key[0]}.{name}"] = p["value"] - truth
            if p.get("low") is not None:
                inside.append(p["low"] <= truth <= p["high"])
    return {
        "case": case.name,
        "kind": case.kind,
        "verdict": result["verdict"],
        "named": sorted(f"{e}({w})" for e, w in found),
        "right": right,
        "silent": bool(hidden) and unseen == set(hidden) and not right,
        "wrong": sure and bool(set(found) - set(hidden)),
        "errors": errors,
        "inside": [bool(x) for x in inside],
        "fall": result["before"] / max(result["after"], 1e-9),
        "cpu": result["cpu"],
        "reason": result["reason"],
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Return all rows as Markdown, with the shares on top."""
    every = [r for r in rows if r["kind"] in ("single", "pair")]
    single = [r for r in every if not r["silent"]]
    silent = [r for r in rows if r["silent"]]
    none, unknown = ([r for r in rows if r["kind"] == k] for k in ("none", "unknown"))
    inside = [x for r in single for x in r["inside"]]

    def share(flags: list[bool]) -> str:
        return f"{sum(flags)} of {len(flags)}" if flags else "-"

    lines = ["| what | result |", "|---|---|"]
    lines.append(
        f"| hidden effects all named (or among what cannot be told apart) | {share([r['right'] for r in every])} |"
    )
    lines.append(f"| the same without cases that it lists as not excited | {share([r['right'] for r in single])} |")
    said = share([not r["named"] for r in silent])
    lines.append(f"| hidden effects that no picture of the case can show: said so, and none named | {said} |")
    lines.append(f"| confidently wrong | {share([r['wrong'] for r in rows])} |")
    lines.append(f"| no effect hidden: none named | {share([not r['named'] for r in none])} |")
    lines.append(f"| unknown fault: unexplained | {share([r['verdict'] == 'unexplained' for r in unknown])} |")
    lines.append(f"| true value inside the 95 % interval | {share(inside)} |")
    falls = [r["fall"] for r in single if r["right"] and r["fall"] > 0]
    if falls:
        lines.append(f"| held-out picture error falls, median | {np.median(falls):.1f}-fold |")
    if rows:
        lines.append(f"| processor time of a diagnosis, median | {np.median([r['cpu'] for r in rows]):.0f} s |")
    lines += ["", "| case | verdict | named | right |", "|---|---|---|---|"]
    for r in rows:
        if r["silent"] or r["kind"] == "none":
            ok = not r["named"]
        else:
            ok = r["right"] if r["kind"] in ("single", "pair") else r["verdict"] == "unexplained"
        lines.append(f"| {r['case']} | {r['verdict']} | {', '.join(r['named']) or '-'} | {'yes' if ok else 'no'} |")
    return "\n".join(lines) + "\n"
