"""Scores of diagnoses against the hidden truth, with Wilson intervals. Reads plain records only."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import sqrt
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

Record = dict[str, Any]

# Effects that recordings of this kind cannot distinguish at the same place.
CLASSES = (
    {"command_delay", "actuator_lag", "sensor_delay"},
    {"coulomb_friction", "stribeck_friction", "hysteresis"},
    {"joint_bias", "encoder_offset"},
    {"backlash", "joint_elasticity"},
)
BODIES = {"payload", "link_mass", "link_com"}  # one at a neighbouring link is of the same class
ABOVE_FLOOR = 1.05  # nominal held-out error over noise floor from which an effect shows at all


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson 1927); (0, 1) without trials."""
    if n == 0:
        return 0.0, 1.0
    p, d = hits / n, 1.0 + z * z / n
    half = z * sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n)) / d
    centre = (p + z * z / (2.0 * n)) / d
    return max(0.0, centre - half), min(1.0, centre + half)


def share(flags: Iterable[bool]) -> str:
    """Word the share of true flags: `83 % [74, 90] of 96`."""
    values = [bool(f) for f in flags]
    if not values:
        return "-"
    low, high = wilson(sum(values), len(values))
    return f"{100 * sum(values) / len(values):.0f} % [{100 * low:.0f}, {100 * high:.0f}] of {len(values)}"


def _link(where: str) -> int:
    return 7 if where == "flange" else int(where[-1]) if where[-1:].isdigit() else -1


def same_class(truth: Record, named: Record) -> bool:
    """Return whether `named` is the truth, names it as confounded, or is of its class in CLASSES or BODIES."""
    rivals = [named, *named.get("indistinguishable_from", [])]
    if any((r["effect"], r["where"]) == (truth["effect"], truth["where"]) for r in rivals):
        return True
    if truth["effect"] in BODIES and named["effect"] in BODIES:
        return abs(_link(truth["where"]) - _link(named["where"])) <= 1
    pair = {truth["effect"], named["effect"]}
    return truth["where"] == named["where"] and any(pair <= group for group in CLASSES)


def _matched(truth: Sequence[Record], named: Sequence[Record]) -> int:
    """Return the greatest number of truths that can each be given a named effect of its own class."""
    if not truth or not named:
        return 0
    fits = np.array([[same_class(t, n) for n in named] for t in truth])
    return int(fits[linear_sum_assignment(fits, maximize=True)].sum())


def judge(r: Record) -> Record:
    """Return the scores of one diagnosis.

    Adds: exact, right_class (nothing missed, nothing invented), right_place, found (all there, perhaps more), extras,
    confident (the verdict claims to know), error_fall, to_oracle, shows.
    """
    truth = r["hidden"] if r["kind"] != "unknown" else []
    crowded = r["kind"] in ("many", "strange")  # where what is partial counts; elsewhere it is not claimed to be all
    named = r["effects"] if crowded or r["verdict"] != "unexplained" else []
    hits = _matched(truth, named)
    sure = [e for e in named if not e.get("tentative")]
    classes = [e for e in sure if e.get("indistinguishable_from")]
    rights = sum(any(same_class(t, e) for t in truth) for e in sure)

    def key(e):
        return (e["effect"], e["where"])

    ladder, floor = r["ladder"], r["floor"]
    before, after = ladder[0]["heldout_error"], ladder[-1]["heldout_error"]
    oracle = (r.get("oracle") or {}).get("heldout_error")
    return r | {
        "exact": sorted(map(key, truth)) == sorted(map(key, named)),
        "right_class": hits == len(truth) == len(named),
        "right_place": {e["where"] for e in truth} == {e["where"] for e in named},
        "found": hits == len(truth),
        "hits": hits,
        "sure": len(sure),
        "classes": len(classes),
        "sure_hits": _matched(truth, sure),
        "false_names": len(sure) - rights,
        "extras": len(named) - hits,
        "confident": r["verdict"] == "identified",
        "error_fall": before / after if after > 0.0 else float("inf"),
        "to_oracle": after / oracle if oracle else None,
        "shows": before > ABOVE_FLOOR * floor,
    }


def coverage(records: Sequence[Record]) -> list[bool]:
    """Return whether the 95 % interval holds the truth, for every parameter of effects that were named exactly."""
    out = []
    for r in records:
        for e in r["effects"]:
            for t in r["hidden"]:
                if (e["effect"], e["where"]) != (t["effect"], t["where"]):
                    continue
                for name, got in e["params"].items():
                    if name in t["params"] and got.get("low") is not None:
                        out.append(got["low"] <= t["params"][name] <= got["high"])
    return out


def _median(values: Iterable[float | None]) -> str:
    known = sorted(v for v in values if v is not None)
    return f"{known[len(known) // 2]:.3g}" if known else "-"


def _row(*cells: object) -> str:
    return "| " + " | ".join(str(c) for c in cells) + " |"


def report(records: Sequence[Record]) -> str:
    """Return the whole score as Markdown."""
    failed = [r for r in records if r["verdict"] == "failed"]
    done = [judge(r) for r in records if r["verdict"] != "failed"]
    known, pairs = [r for r in done if r["kind"] == "single"], [r for r in done if r["kind"] == "pair"]
    none, unknown = [r for r in done if r["kind"] == "none"], [r for r in done if r["kind"] == "unknown"]
    seen = [r for r in known if r["shows"]]
    crowd, strange = ([r for r in done if r["kind"] == kind] for kind in ("many", "strange"))
    if crowd or strange:
        return _many(crowd, strange, failed)
    rivals = sum(len(e.get("indistinguishable_from", [])) for r in known for e in r["effects"])
    head = f"{len(done)} diagnoses, {len(failed)} runs failed; [..]: 95 % Wilson interval."
    lines = ["# Hidden effects", "", head, ""]
    lines += [_row("measure", "result"), _row("---", "---")]
    lines += [
        _row("one effect: exact name and place", share(r["exact"] for r in known)),
        _row("one effect: class and place, nothing invented", share(r["right_class"] for r in known)),
        _row("... of those whose error shows above the noise", share(r["right_class"] for r in seen)),
        _row("one effect: rivals listed beside it, on average", f"{rivals / max(len(known), 1):.2f}"),
        _row("one effect: place", share(r["right_place"] for r in known)),
        _row("one effect: confidently wrong", share(r["confident"] and not r["right_class"] for r in known)),
        _row("pairs: both classes, nothing invented", share(r["right_class"] for r in pairs)),
        _row("pairs: both found, perhaps more", share(r["found"] for r in pairs)),
        _row("no effect: false alarms (an effect named)", share(bool(r["effects"]) for r in none)),
        _row("no effect: verdict adequate", share(r["verdict"] == "adequate" for r in none)),
        _row("unknown disturbance: verdict unexplained", share(r["verdict"] == "unexplained" for r in unknown)),
        _row("unknown disturbance: confidently given a name", share(r["confident"] for r in unknown)),
        _row("95 % intervals that hold the truth", share(coverage(known + pairs))),
        _row("median fall of held-out error", _median(r["error_fall"] for r in known) + "-fold"),
        _row("held-out error within 10 % of the oracle's",
             share(r["to_oracle"] <= 1.1 for r in known + pairs if r["to_oracle"] is not None)),
        _row("fixed parameter set: largest z names effect and place",
             share(r["baseline"]["named"] == [r["hidden"][0]["effect"], r["hidden"][0]["where"]]
                   for r in known if r.get("baseline"))),
        _row("fixed parameter set: held-out error within 10 % of the oracle's",
             share(r["baseline"]["heldout_error"] <= 1.1 * r["oracle"]["heldout_error"]
                   for r in known if r.get("baseline") and r.get("oracle"))),
        _row("median processor seconds a diagnosis", _median(r["seconds"] for r in done)),
    ]  # fmt: skip
    columns = ("hidden", "exact (unknown: no name)", "class", "extras", "fall", "to oracle", "verdicts")
    lines += ["", "## By effect", "", _row(*columns)]
    lines.append(_row(*["---"] * 7))
    for effect in dict.fromkeys(r["hidden"][0]["effect"] for r in known + unknown):
        rows = [r for r in known + unknown if r["hidden"][0]["effect"] == effect]
        exact, right = (f"{sum(r[k] for r in rows)}/{len(rows)}" for k in ("exact", "right_class"))
        lines.append(_row(
            effect, exact, right,
            sum(r["extras"] for r in rows), _median(r["error_fall"] for r in rows),
            _median(r["to_oracle"] for r in rows), _verdicts(rows)))  # fmt: skip
    lines += ["", "## By size", "", _row("size", "exact", "class"), _row("---", "---", "---")]
    for size in ("small", "medium", "large"):
        rows = [r for r in known if r["case"].endswith(size)]
        lines.append(_row(size, share(r["exact"] for r in rows), share(r["right_class"] for r in rows)))
    lines += ["", "## What went wrong", ""]
    lines.append(_row("case", "verdict", "named", "held-out error / floor, before and after"))
    lines.append(_row(*["---"] * 4))
    for r in done:
        good = r["verdict"] == "unexplained" if r["kind"] == "unknown" else r["right_class"]
        if not good:
            ratio = [f"{step['heldout_error'] / r['floor']:.3g}" for step in (r["ladder"][0], r["ladder"][-1])]
            names = ", ".join(f"{e['effect']}({e['where']})" for e in r["effects"]) or "nothing"
            lines.append(_row(r["case"], r["verdict"], names, " to ".join(ratio)))
    lines += [_row(r["case"], "failed", str(r.get("message", ""))[-120:].replace("\n", " "), "") for r in failed]
    return "\n".join(lines) + "\n"


def _many(crowd: Sequence[Record], strange: Sequence[Record], failed: Sequence[Record]) -> str:
    """Return the score of cases with many effects."""
    truths = [i < r["hits"] for r in crowd for i in range(len(r["hidden"]))]
    certain = [i < r["sure_hits"] for r in crowd for i in range(len(r["hidden"]))]
    names = [i < r["false_names"] for r in (*crowd, *strange) for i in range(r["sure"])]
    extras = sum(r["sure"] - r["sure_hits"] for r in crowd) / max(len(crowd), 1)
    lines = ["# Many effects at once", "", f"{len(crowd) + len(strange)} diagnoses, {len(failed)} runs failed.", ""]
    lines += [_row("measure", "result"), _row("---", "---")]
    lines += [
        _row("effects whose class and place are named", share(certain)),
        _row("... or in the model, tentatively", share(truths)),
        _row("names (`one of` is one) of what was not hidden", share(names)),
        _row("names beyond those hidden, a case", f"{extras:.2f}"),
        _row("95 % intervals that hold the truth", share(coverage(crowd))),
        _row("held-out error over the oracle's, median", _median(r["to_oracle"] for r in crowd)),
        _row("... at most twice the oracle's", share(r["to_oracle"] <= 2 for r in crowd if r["to_oracle"] is not None)),
        _row("library only: verdicts", _verdicts(crowd)),
        _row("something unknown beside them: verdicts", _verdicts(strange)),
        _row("median processor seconds a diagnosis", _median(r["seconds"] for r in (*crowd, *strange))),
        "",
        _row("case", "control", "hidden", "named", "of them `one of`", "false", "tentative", "verdict",
             "error / floor", "with the truth", "intervals that hold", "s"),
        _row(*["---"] * 12),
    ]  # fmt: skip
    for r in (*crowd, *strange):
        first, last = (r["ladder"][k]["heldout_error"] / r["floor"] for k in (0, -1))
        inside, truth = coverage([r]), r.get("oracle")
        lines.append(_row(
            r["case"], r["mode"], len(r["hidden"]), r["sure"], r["classes"], r["false_names"],
            len(r["effects"]) - r["sure"], r["verdict"], f"{first:.3g} to {last:.3g}",
            f"{truth['heldout_error'] / truth['floor']:.3g}" if truth else "",
            f"{sum(inside)} of {len(inside)}", f"{r['seconds']:.0f}",
        ))  # fmt: skip
    return "\n".join(lines) + "\n"


def _verdicts(rows: Sequence[Record]) -> str:
    names = [r["verdict"] for r in rows]
    return ", ".join(f"{names.count(v)} {v}" for v in dict.fromkeys(names))
