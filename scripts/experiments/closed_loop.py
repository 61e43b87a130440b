"""Go from failed trials to their cause, to its correction, and to new trials, in cells with a hidden effect.

In each cell a policy is played (`--run`: by `vispeg run` on a robot in another process), the arm and the camera are
recorded, what the model lacks is diagnosed, the trials are explained by it, the policy is fine-tuned in the corrected
world, and played again from the same seeds. The scripted policy demonstrates; where it fails in the corrected world, a
state policy that was trained there. The hidden effect is read from the sealed file only to score the cell. A
stopped run goes on with the next step that has no result.

Example: python scripts/experiments/closed_loop.py --cells 10 --out loop
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vispeg.cli.main import main as vispeg
from vispeg.core.seeds import stream
from vispeg.evaluation.statistics import ceiling, measured_correlation, wilson
from vispeg.trials.trial import folders, read_said
from vispeg.worlds.model_file import load_model, placed_dict

POLICY = "depth-S-randomized"
OTHERS = ("depth-S", "depth-S2", "state-3mm")  # with POLICY: whose success the model is to predict
MOTIONS = ("fourier", "triangle", "mix")  # of the arm; the last is held out
KINDS: dict[str, Any] = {  # effect, place, and the sizes that it is drawn from; signs are drawn too
    "camera": ("camera_offset", "wrist_wide", {"x": (0.015, 0.025), "ry": (0.03, 0.06)}),
    "friction": ("coulomb_friction", "joint4", {"torque": (5.0, 9.0)}),
    "load": ("payload", "flange", {"mass": (1.5, 3.0)}),
}
JUDGED = 20  # episodes of each policy in each world, the same seeds in all
SIGNED = ("camera",)
LEAST = 0.5  # success of the scripted teacher in the corrected world, under which a state policy is trained there
STEPS = 25_600  # of that training


def hidden(seed: int, cell: int) -> dict[str, Any]:
    """Draw the effect of a cell; every second one is a camera's."""
    rng = stream(seed, "cell", str(cell))
    kind = "camera" if cell % 2 == 0 else ("friction", "load")[int(rng.integers(2))]
    name, where, sizes = KINDS[kind]
    sign = rng.choice((-1.0, 1.0)) if kind in SIGNED else 1.0
    return {
        "effect": name,
        "where": where,
        "params": {k: round(float(sign * rng.uniform(*v)), 4) for k, v in sizes.items()},
    }


def command(*words: object) -> None:
    """Run a command of vispeg's. Raises RuntimeError where it fails."""
    argv = [str(w) for w in words]
    if vispeg([*argv, "--quiet"]) != 0:
        raise RuntimeError(f"vispeg {' '.join(argv)}")


def play(place: Path, world: Path, policy: object, name: str, episodes: int, robot: bool) -> list[bool]:
    """Play a policy in the cell from its seeds; its trials are in `place / name`."""
    trials = place / name
    if not trials.exists():
        if robot:
            command("run", policy, "--robot", f"sim:{world}", "--episodes", episodes, "--seed", 1, "--out", trials)
        else:
            out = place / f"{name}-played"
            argv = ("--episodes", episodes, "--videos", 0, "--keep-trials", trials, "--out", out)
            command("evaluate", policy, "--world", world, *argv)
    return [read_said(folder).outcome.success for folder in folders(trials)]


def diagnosed(place: Path, effect: dict[str, Any]) -> Path:
    """Record the arm and the camera, diagnose both, and write what was found into one model file."""
    model = place / "found.yaml"
    if model.exists():
        return model
    text = f"{effect['effect']}:{effect['where']}:" + ",".join(f"{k}={v}" for k, v in effect["params"].items())
    optical = effect["effect"].startswith("camera")
    arm = () if optical else ("--effects", text)
    for k, motion in enumerate(MOTIONS):
        if not (place / motion).exists():
            command("record", "peg-cell", "--motion", motion, "--seed", k, *arm, "--out", place / motion)
    for k in (1, 2):
        if not (place / f"look-{k}").exists():
            how = ("--seed", k, "--look", f"S/{k}", "--fps", 0.7, "--effects", text)
            command("record", "peg-cell", "--motion", "look", *how, "--out", place / f"look-{k}")
    first, second, third = (place / motion for motion in MOTIONS)
    looks = ("--recording", place / "look-1", "--validate", place / "look-2", "--channels", "pictures")
    for name, what in (("arm", ("--recording", first, second, "--validate", third)), ("camera", looks)):
        if not (place / name).exists():
            command("diagnose", "peg-cell", *what, "--out", place / name)
    found = [placed_dict(e) for name in ("arm", "camera") for e in load_model(place / name / "model.yaml").effects]
    values = {"format": "vispeg-model/1", "robot": "iiwa14", "tool": "meg50+peg16", "effects": found}
    model.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    return model


def success(place: Path, name: str, world: object) -> dict[str, float]:
    """Return the success of all policies in a world, by policy."""
    if not (place / name).exists():
        command(
            "evaluate", POLICY, *OTHERS, "--world", world, "--episodes", JUDGED, "--videos", 0, "--out", place / name
        )
    record = json.loads((place / name / "evaluate.json").read_text())
    return {row["policy"]: row["success"]["value"] for row in record["success"]}


def cured(place: Path, world: Path) -> tuple[Path, str]:
    """Fine-tune the policy in the corrected world; also return which policy demonstrated."""
    if not (place / "teaching").exists():
        argv = ("--world", world, "--episodes", 20, "--seed", 2, "--videos", 0, "--out", place / "teaching")
        command("evaluate", "expert", *argv)
    (scripted,) = json.loads((place / "teaching" / "evaluate.json").read_text())["success"]
    teacher: object = "expert"
    if scripted["success"]["value"] < LEAST:
        teacher = place / "teacher" / "checkpoints" / "best"
        if not (place / "teacher").exists():
            argv = ("--steps", STEPS, "--every", STEPS // 8, "--films", 0, "--out", place / "teacher")
            command("train", "peg-state", "--world", world, *argv)
    if not (place / "tuned").exists():
        argv = ("--demos", 60, "--updates", 1200, "--episodes", 10, "--out", place / "tuned")
        command("finetune", POLICY, "--world", world, "--teacher", teacher, *argv)
    return place / "tuned", "scripted" if teacher == "expert" else "trained there"


def cell(out: Path, number: int, seed: int, episodes: int, robot: bool) -> dict[str, Any]:
    """Run one cell, from its first trials to the success after fine-tuning."""
    place, begun = out / f"cell-{number}", time.process_time()
    place.mkdir(parents=True, exist_ok=True)
    if (place / "cell.json").exists():
        return json.loads((place / "cell.json").read_text())
    effect, world = hidden(seed, number), place / "hidden.yaml"
    sealed = {"format": "vispeg-world/1", "base": "nominal", "effects": [effect]}
    world.write_text(yaml.safe_dump(sealed, sort_keys=False), encoding="utf-8")
    before = play(place, world, POLICY, "trials", episodes, robot)
    model = diagnosed(place, effect)
    if not (place / "why").exists():
        argv = ("--model", model, "--replays", 5, "--apply", "--out", place / "why")
        command("explain", place / "trials", "--policy", POLICY, *argv)
    why = json.loads((place / "why" / "explain.json").read_text())
    ranked = [c["effect"] for c in why["causes"] if c["effect"] != "all together"]
    label, corrected = f"{effect['effect']}({effect['where']})", place / "why" / "world.yaml"
    row: dict[str, Any] = {
        "cell": number,
        "hidden": effect,
        "before": before,
        "verdict": why["verdict"],
        "named": ranked,
        "rank": 1 + ranked.index(label) if label in ranked else None,
        "sense": next((s["sense"] for s in why["senses"] if s["points_to"]), None),
        "teacher": None,
        "after": None,
    }
    if why["next"] and corrected.exists():
        tuned, row["teacher"] = cured(place, corrected)
        row["after"] = play(place, world, tuned, "again", episodes, robot)
    worlds = {"hidden": world, "nominal": "nominal", **({"corrected": corrected} if corrected.exists() else {})}
    row["success"] = {name: success(place, f"in-{name}", where) for name, where in worlds.items()}
    row["cpu_s"] = time.process_time() - begun
    (place / "cell.json").write_text(json.dumps(row, indent=1) + "\n", encoding="utf-8")
    return row


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the shares of successes by cell and way as a Markdown table."""

    def rate(ends: list[bool] | None) -> str:
        if ends is None:
            return "-"
        e = wilson(sum(ends), len(ends))
        return f"{100 * e.value:.0f} % ({100 * e.low:.0f} to {100 * e.high:.0f})"

    out = [
        "| cell | hidden | before | first sense | cause's rank | others named | teacher | after |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        h = r["hidden"]
        said = f"`{h['effect']}({h['where']})` " + ", ".join(f"{k} {v:g}" for k, v in h["params"].items())
        others = len(r["named"]) - (r["rank"] is not None)
        columns = (
            r["cell"],
            said,
            rate(r["before"]),
            r["sense"] or "-",
            r["rank"] or "-",
            others,
            r["teacher"] or "-",
            rate(r["after"]),
        )
        out.append("| " + " | ".join(str(c) for c in columns) + " |")
    ranked = sum(r["rank"] in (1, 2) for r in rows)
    out += ["", f"Cause ranked first or second: {ranked} of {len(rows)}."]
    corrected = [r["success"] for r in rows if "corrected" in r["success"]]  # where a cause was certain
    for name in ("nominal", "corrected"):
        pairs = [(s[name][p], s["hidden"][p]) for s in corrected for p in s["hidden"]]
        if len(pairs) > 2:
            x, y = np.array(pairs).T
            noise = [np.diag([p * (1 - p) / (JUDGED - 1) for p in pair]) for pair in pairs]
            r, most = measured_correlation(x, y), ceiling(x, y, noise)
            head = f"Success in the hidden cell against the {name} model's, {len(pairs)} pairs"
            out.append(f"{head}: r = {r:.2f}; {JUDGED} other episodes each would allow {most:.2f} at most.")
    return "\n".join(out)


def main(arguments: Sequence[str] | None = None) -> None:
    """Go through the cells and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=10)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--run", action="store_true", help="play on a robot in another process, in real time")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    rows = []
    for number in range(given.cells):
        rows.append(cell(given.out, number, given.seed, given.episodes, given.run))
        (given.out / "cells.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        print(table(rows), flush=True)


if __name__ == "__main__":
    main()
