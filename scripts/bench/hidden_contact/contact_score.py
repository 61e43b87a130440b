"""Scores of diagnoses of contact against the hidden truth, with Wilson intervals. Reads records only."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from contact_plant import CREEP
from score import share, wilson

from vispeg.core.effect import effect
from vispeg.report.text import effect_words as words
from vispeg.report.text.quantities import quantity, scaled

Record = dict[str, Any]
# effects that stand for one another where nothing in the recordings turns or weighs them apart
TWINS = ({"hole_offset", "grip_pose"}, {"hole_tilt", "grip_pose"}, {"object_mass", "tool_mass"},
         {"contact_damping", "restitution"})  # fmt: skip
UNLIKE = {"contact_stiffness", "contact_damping"}  # whose numbers mean another thing in another law of contact
PLANTS = {("gripper_slip", "viscosity"): CREEP}  # what the plant has, whatever is hidden
HOLE, CLEARANCE = 1e-4, 5e-5  # m: goals


def same(truth: Record, named: Record) -> bool:
    """Return whether `named` is the truth, or names the truth as confounded with it."""
    rivals = [named, *named.get("indistinguishable_from", [])]
    return any((r["effect"], r["where"]) == (truth["effect"], truth["where"]) for r in rivals)


def same_class(truth: Record, named: Record) -> bool:
    """Return whether `named` is the truth, names the truth as confounded with it, or is of a kind in one of `TWINS`."""
    return same(truth, named) or any({truth["effect"], named["effect"]} <= twins for twins in TWINS)


def silent(r: Record) -> bool:
    """Return whether the diagnosis itself says that the recordings could not show one of the hidden effects."""
    between = {(s["effect"], s["where"]): s["between"] for s in r.get("shows_from") or []}
    return any(_inside(t["params"], between.get((t["effect"], t["where"]))) for t in r["hidden"])


def _inside(params: dict[str, float], between: dict[str, list[float] | None] | None) -> bool:
    """Return whether every hidden value is in the range that does not show."""
    if between is None:
        return False
    ends = {k: between[k] for k in params if k in between}
    return len(ends) == len(params) and all(e is None or e[0] <= params[k] <= e[1] for k, e in ends.items())


def judge(r: Record) -> Record:
    """Return the scores of one diagnosis: `hits`, `right` (nothing missed, nothing invented), `exact`, `fall`."""
    named = [e for e in r["effects"] if not e.get("tentative")] if r["verdict"] != "unexplained" else []
    left, hits = list(named), 0
    for truth in r["hidden"]:
        match = next((n for n in left if same(truth, n)), None) or next((n for n in left if same_class(truth, n)), None)
        if match is not None:
            left.remove(match)
            hits += 1
    truths, names = ({(e["effect"], e["where"]) for e in es} for es in (r["hidden"], named))
    ladder = r.get("ladder") or []
    first, last = (ladder[i]["heldout_error"] for i in (0, -1)) if ladder else (0.0, 0.0)
    partial = [e for e in r["effects"] if any(same_class(t, e) for t in r["hidden"])]
    return r | {
        "named": sorted(names), "hits": hits, "right": hits == len(r["hidden"]) == len(named), "exact": truths == names,
        "extras": len(left), "fall": first / last if last > 0 else None, "partly": len(partial) >= len(r["hidden"]),
        "confident": r["verdict"] == "identified", "silent": silent(r),
    }  # fmt: skip


def plain_fall(r: Record) -> float | None:
    """Return the factor by which the RMS of measured less predicted force fell over all phases; None if nothing did.

    The ladder's errors leave out what errors of sensor and kinematics explain.
    """
    phases = [p for p in r.get("phases") or [] if p.get("after")]
    before, after = (sum(p["seconds"] * p[key] ** 2 for p in phases) for key in ("before", "after"))
    return (before / after) ** 0.5 if r["effects"] and after > 0 else None


def values(records: Sequence[Record]) -> list[tuple[str, str, float, float, float | None, float | None]]:
    """Return (effect, parameter, true, found, low, high) of all parameters of effects that were named exactly."""
    out = []
    for r in records:
        for e in r["effects"]:
            for t in r["hidden"]:
                if (e["effect"], e["where"]) == (t["effect"], t["where"]) and e["effect"] not in UNLIKE:
                    out += [
                        (
                            e["effect"],
                            k,
                            t["params"].get(k, PLANTS.get((e["effect"], k), 0.0)),
                            p["value"],
                            p.get("low"),
                            p.get("high"),
                        )
                        for k, p in e["params"].items()
                    ]
    return out


def report(records: Sequence[Record]) -> str:
    """Return the whole score as Markdown."""
    failed = [r for r in records if r["verdict"] == "failed"]
    done = [judge(r) for r in records if r["verdict"] != "failed"]
    kind = {k: [r for r in done if r["kind"] == k] for k in ("single", "pair", "none", "unknown")}
    shown = {k: [r for r in kind[k] if not r["silent"]] for k in ("single", "pair")}
    known = kind["single"] + kind["pair"]
    quiet = [r for r in known if r["silent"]]
    numbers = values(known)
    inside = [low <= true <= high for _, _, true, _, low, high in numbers if low is not None and high is not None]
    near = {name: [abs(found - true) for e, _, true, found, *_ in numbers if e == name]
            for name in ("hole_offset", "hole_clearance")}  # fmt: skip
    rows = [
        ("one effect: class, nothing invented", share(r["right"] for r in kind["single"])),
        ("one effect: the same of those that show, by the record itself", share(r["right"] for r in shown["single"])),
        ("one effect: exact name and place", share(r["exact"] for r in kind["single"])),
        ("one effect: among what lowered the error, whatever the verdict", share(r["partly"] for r in kind["single"])),
        ("one effect: confidently wrong", share(r["confident"] and not r["right"] for r in kind["single"])),
        ("pairs: both classes, nothing invented", share(r["right"] for r in kind["pair"])),
        ("pairs: the same of those that show, by the record itself", share(r["right"] for r in shown["pair"])),
        ("does not show, and said so: nothing named falsely", share(not r["extras"] for r in quiet)),
        ("no effect: given a name", share(bool(r["named"]) for r in kind["none"])),
        ("no effect: verdict adequate", share(r["verdict"] == "adequate" for r in kind["none"])),
        ("unknown: verdict unexplained", share(r["verdict"] == "unexplained" for r in kind["unknown"])),
        ("unknown: confidently given a name", share(r["confident"] for r in kind["unknown"])),
        ("95 % intervals that hold the truth", share(inside)),
        ("hole position within 0.1 mm", share(d <= HOLE for d in near["hole_offset"])),
        ("clearance within 0.05 mm", share(d <= CLEARANCE for d in near["hole_clearance"])),
        ("fall of held-out error, median", times(r["fall"] for r in known)),
        ("fall of the plain force error, median", times(plain_fall(r) for r in known)),
        ("processor seconds a diagnosis, median", middle(r.get("cpu_s") for r in done)),
    ]
    lines = [
        "# Hidden contact",
        "",
        f"{len(done)} diagnoses, {len(failed)} runs failed; [..]: 95 % Wilson interval.",
        "",
    ]
    lines += table(("measure", "result"), rows)
    lines += ["", "## Case by case", ""]
    cells = [_row(r) for r in done]
    cells += [
        (r["case"], "failed", "no", str(r.get("message", ""))[-100:].replace("\n", " "), "-", "-", "-") for r in failed
    ]
    lines += table(("hidden", "verdict", "right", "named: values [95 %]", "truth", "held-out error, N", "s"), cells)
    return "\n".join(lines) + "\n"


def references(records: Sequence[Record]) -> str:
    """Return as Markdown the errors of fits of the true effects, the least that a diagnosis can reach."""
    done = [r for r in records if r["verdict"] != "failed"]
    falls = [(r["before"] / r["after"], r["plain_before"] / r["plain_after"]) for r in done]
    cells = [
        (r["case"], f"{r['before']:.3f} to {r['after']:.3f}", f"{r['plain_before']:.2f} to {r['plain_after']:.2f}")
        for r in done
    ]
    lines = [f"Of {len(done)} cases, with the true effects fitted from their true values ({len(records) - len(done)} "]
    lines[0] += "failed): median fall of the held-out error "
    lines[0] += f"{times(f for f, _ in falls)}, of the plain force error {times(f for _, f in falls)}."
    return "\n".join([*lines, "", *table(("hidden", "held-out error, N", "plain force error, N"), cells)]) + "\n"


def _row(r: Record) -> tuple[str, ...]:
    """Return a case as a line of the report."""
    good = r["verdict"] == "unexplained" if r["kind"] == "unknown" else r["right"]
    errors = [f"{step['heldout_error']:.3f}" for step in r["ladder"] or []]
    return (
        r["case"],
        r["verdict"],
        "yes" if good else "does not show" if r["silent"] else "no",
        "; ".join(_found(e) for e in r["effects"]) or "none",
        "; ".join(_hidden(h) for h in r["hidden"]),
        " to ".join([errors[0], errors[-1]] if len(errors) > 1 else errors),
        f"{r.get('cpu_s') or 0:.0f}",
    )


def _found(e: Record) -> str:
    """Word the parameters that were fitted: `` `hole_offset` x 0.90 [0.81, 0.98] mm ``."""
    sizes = []
    for name, p in e["params"].items():
        if p.get("low") is not None and p.get("high") is not None:
            value, span, unit = scaled(p["value"], p["low"], p["high"], _unit(e, name))
            sizes.append(f"{name} {value} [{span.replace(' to ', ', ')}] {unit}".strip())
    return " ".join([f"`{e['effect']}`", *(["tentative"] if e.get("tentative") else []), ", ".join(sizes)]).strip()


def _hidden(h: Record) -> str:
    return ", ".join(f"{name} {quantity(value, _unit(h, name))}" for name, value in h["params"].items())


def _unit(e: Record, name: str) -> str:
    return words.unit(effect(e["effect"]).params[name].unit)


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Return the lines of a Markdown table."""

    def line(cells):
        return "| " + " | ".join(map(str, cells)) + " |"

    return [line(heads), line(["---"] * len(heads)), *map(line, rows)]


def middle(found: Iterable[float | None]) -> str:
    """Return the median of the known values, three digits."""
    known = sorted(v for v in found if v is not None)
    return f"{known[len(known) // 2]:.3g}" if known else "-"


def times(falls: Iterable[float | None]) -> str:
    """Return the median as words: `3.2-fold`."""
    median = middle(falls)
    return median if median == "-" else f"{median}-fold"


__all__ = ["judge", "report", "wilson"]
