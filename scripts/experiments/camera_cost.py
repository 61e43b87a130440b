"""Measure the effect of a camera's error on a policy's success, before and after the correction that a diagnosis found.

The same episodes are played three times: with the camera that the policy was trained for, with the hidden error, and
with what is left of it when the camera is set right by the values in FOUND (hidden less found, or their ratio where a
parameter is a factor). Differences are paired over seeds.

Example: python scripts/experiments/camera_cost.py depth-S --hidden camera_offset:wrist_wide:x=0.02,ry=0.05 \
    --found found/model.yaml --world S --episodes 64 --out cost
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from vispeg.api.playing import play, silent
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.evaluation.jobs import Setting, make_jobs, seeds_of
from vispeg.evaluation.overlay import Change
from vispeg.evaluation.players import ready
from vispeg.evaluation.statistics import decide, difference, rate
from vispeg.evaluation.table import rows
from vispeg.worlds.model_file import load_model

TRUE, HIDDEN, CORRECTED = "as trained", "hidden error", "corrected"


def left_of(hidden: EffectInstance, found: Sequence[EffectInstance]) -> EffectInstance:
    """Return what remains of a hidden effect once the found one of its name and place is subtracted; all if none is."""
    same = [e for e in found if (e.effect, e.where) == (hidden.effect, hidden.where)]
    if not same:
        return hidden
    rest = {}
    for name, v in hidden.params.items():
        p, off = effect(hidden.effect).params[name], same[0].params[name].value
        rest[name] = v.value / off * p.null if p.scale == "log" else v.value - off + p.null
    return EffectInstance.of(hidden.effect, hidden.where, **rest)


def spurious(hidden: Sequence[EffectInstance], found: Sequence[EffectInstance]) -> list[EffectInstance]:
    """Return the found effects that were not hidden, with the opposite sign: correcting them adds this error."""
    have = {(e.effect, e.where) for e in hidden}
    extra = [e for e in found if (e.effect, e.where) not in have]
    return [left_of(EffectInstance.of(e.effect, e.where), [e]) for e in extra]


def changes(effects: Sequence[EffectInstance]) -> tuple[Change, ...]:
    """Return the effects in the form in which a world is changed by them."""
    return tuple(Change(e.effect, {k: v.value for k, v in e.params.items()}, e.where) for e in effects)


def nulls(effects: Sequence[EffectInstance]) -> tuple[Change, ...]:
    """Return the effects at null, so that whatever the world draws for them is removed in all episodes."""
    return changes([EffectInstance.of(e.effect, e.where) for e in effects])


def read(texts: Sequence[str]) -> list[EffectInstance]:
    """Parse effects, each NAME:WHERE:param=number,..."""
    out = []
    for text in texts:
        name, where, *rest = text.split(":")
        pairs = (pair.partition("=") for pair in rest[0].split(",")) if rest else ()
        out.append(EffectInstance.of(name, where, **{k: float(v) for k, _, v in pairs}))
    return out


def main(arguments: Sequence[str] | None = None) -> None:
    """Play, print a line a policy, write OUT/camera_cost.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="+")
    parser.add_argument("--hidden", nargs="+", required=True, help="effects, NAME:WHERE:param=number,...")
    parser.add_argument("--found", type=Path, required=True, help="model.yaml of a diagnosis")
    parser.add_argument("--world", default="S")
    parser.add_argument("--episodes", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args(arguments)
    hidden = read(args.hidden)
    found = [e for e in load_model(str(args.found)).effects if effect(e.effect).family == "camera"]
    if not found:
        raise UserError("has no effect of a camera", file=args.found)
    rest = [left_of(e, found) for e in hidden] + spurious(hidden, found)
    every = [*hidden, *(e for e in found if (e.effect, e.where) not in {(h.effect, h.where) for h in hidden})]
    worlds = {TRUE: nulls(every), HIDDEN: (*changes(hidden), *nulls(every[len(hidden) :])), CORRECTED: changes(rest)}
    settings = [Setting(args.world, Path(args.world).stem, tag, changed) for tag, changed in worlds.items()]
    who = ready(args.policies)
    args.out.mkdir(parents=True, exist_ok=True)
    jobs = make_jobs(who, settings, seeds_of(args.episodes, args.seed), args.out / "worlds")
    ends = play(jobs, args.out, 1, silent)
    made = []
    policies = list(dict.fromkeys(e.policy for e in ends))
    sides = {(p, t): rows(e for e in ends if (e.policy, e.configuration) == (p, t)) for p in policies for t in worlds}
    pairs = ((TRUE, HIDDEN), (CORRECTED, HIDDEN), (TRUE, CORRECTED))
    decided = decide({(p, *pair): difference(*(sides[p, t] for t in pair), True) for p in policies for pair in pairs})
    for policy in policies:
        row = {"policy": policy, "success": {t: rate(sides[policy, t]).to_json() for t in worlds}}
        for a, b in pairs:
            d = decided[policy, a, b]
            row[f"{a} - {b}"] = d.estimate.to_json() | {"p": d.test.p, "p_holm": d.p_holm, "verdict": d.verdict}
        made.append(row)
        said = ", ".join(f"{t} {100 * row['success'][t]['value']:.0f} %" for t in worlds)
        print(f"{policy}: {said}; {json.dumps({k: v for k, v in row.items() if ' - ' in k})}")
    (args.out / "camera_cost.json").write_text(json.dumps({"episodes": args.episodes, "rows": made}, indent=1) + "\n")


if __name__ == "__main__":
    main()
