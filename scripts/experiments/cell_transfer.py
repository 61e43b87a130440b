"""Insertion policies in a hidden cell, in the nominal model of it, and in the model that its recordings correct.

    python scripts/experiments/cell_transfer.py rough-and-springy tight --policies expert state-3mm --episodes 50

Each case hides effects of contact in the cell. `vispeg record` writes a press, a slide and two insertions of it,
`vispeg diagnose peg-cell` (or with --by fit, `vispeg fit` of the hidden effects' names) makes a model of them, and a
world with `model:` makes that the cell of the corrected episodes. The same policies play the same seeds in all. `again`
is the hidden cell once more with its peg gripped 1 um aside: what a model cannot be expected to undercut, since
contact is sensitive. What is in the folder of runs is not made again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import arguments
import yaml
from model_errors import errors, markdown

from vispeg.core.effect import EffectInstance
from vispeg.core.files import write_text_atomic
from vispeg.core.provenance import provenance
from vispeg.evaluation.jobs import Job, Setting, make_jobs, seeds_of
from vispeg.evaluation.players import ready
from vispeg.evaluation.runner import run
from vispeg.recordings.cell import OPEN_CELL
from vispeg.task.world_file import FORMAT, load_world
from vispeg.worlds.model_file import load_model

CASES = {
    "rough-and-springy": ("contact_friction:peg:scale=1.7", "fixture_compliance:fixture:z=3e-5"),
    "tight": ("hole_clearance:fixture:width=-0.001",),
    "tilted": ("hole_tilt:fixture:roll=0.03",),
    "askew": ("grip_pose:peg:x=0.001",),
}
BASE = "searching"
MOTIONS = ("press", "slide", "insert", "insert-turned")
FITTED, JUDGED = 1, 2  # seeds of the motions
NOMINAL, CORRECTED, HIDDEN, AGAIN = "nominal", "corrected", "hidden", "again"
ASIDE = 1e-6  # m


def placed(text: str) -> EffectInstance:
    """Return an effect as the command line writes it, EFFECT:WHERE:param=value,.."""
    name, where, params = text.split(":")
    return EffectInstance.of(name, where, **{k: float(v) for k, v in (p.split("=") for p in params.split(","))})


def corrected(case: Sequence[str], by: str, folder: Path) -> Path:
    """Return the model.yaml of a case's recordings, by `diagnose` or `fit`; made where it is not there yet."""
    found = folder / by / "model.yaml"
    if found.is_file():
        return found
    folder.mkdir(parents=True, exist_ok=True)
    words: list[str] = []
    for seed, flag in ((FITTED, "--recording"), (JUDGED, "--validate")):
        for motion in MOTIONS:
            out = folder / f"{motion}-{seed}"
            if not out.is_dir():
                _vispeg(
                    "record", OPEN_CELL, "--motion", motion, "--effects", *case, "--seed", str(seed), "--out", str(out)
                )
            words += [flag, str(out)]
    names = ("--effects", *(text.rpartition(":")[0] for text in case)) if by == "fit" else ()
    _vispeg(by, OPEN_CELL, *words, *names, "--out", str(found.parent), "--threads", "1", "--quiet", "--overwrite")
    return found


def worlds(case: Sequence[str], model: Path, base: str, folder: Path) -> dict[str, Path]:
    """Return the world files of a case: nominal, corrected by `model:` at its values, hidden, and the hidden one
    again.
    """
    hidden = {(e.effect, e.where): _values(e) for e in map(placed, case)}
    grip = hidden.get(("grip_pose", "peg"), {})
    aside = {**hidden, ("grip_pose", "peg"): {**grip, "x": grip.get("x", 0.0) + ASIDE}}
    said: dict[str, dict[str, Any]] = {
        NOMINAL: {},
        CORRECTED: {"model": {"file": str(model.resolve()), "widen": 0.0, "sd": 0.0}},
        HIDDEN: {"effects": _entries(hidden)},
        AGAIN: {"effects": _entries(aside)},
    }
    out = {}
    for name, what in said.items():
        text = yaml.safe_dump({"format": FORMAT, "name": name, "base": base, **what}, sort_keys=False)
        out[name] = write_text_atomic(folder / f"{name}.yaml", text, overwrite=True)
    return out


def _entries(effects: Mapping[tuple[str, str], Mapping[str, float]]) -> list[dict[str, Any]]:
    return [{"effect": name, "where": at, "params": dict(params)} for (name, at), params in effects.items()]


def _values(e: EffectInstance) -> dict[str, float]:
    return {name: v.value for name, v in e.params.items()}


def played(policies: Sequence[str], files: dict[str, Path], episodes: int, out: Path) -> dict[str, Any]:
    """Return {policy: errors of nominal, corrected and again} on the same held-out seeds."""
    settings = [Setting(str(path), name) for name, path in files.items()]
    jobs: list[Job] = make_jobs(ready(policies), settings, seeds_of(episodes), out / "worlds", profile=True)
    everything = run(jobs, out)
    found = {}
    for policy in dict.fromkeys(e.policy for e in everything):
        by = {name: [e for e in everything if e.policy == policy and e.world == name] for name in files}
        hidden = by.pop(HIDDEN)
        found[policy] = errors(hidden, by, NOMINAL)
    return found


def _vispeg(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "vispeg", *words], check=True)


def main() -> None:
    """Record, correct, play; write cell_transfer.json and print its tables after each case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=list(CASES), help=f"of {', '.join(CASES)}")
    parser.add_argument("--by", choices=["diagnose", "fit"], default="diagnose", help="what makes the model")
    parser.add_argument("--policies", nargs="+", default=["expert", "state-3mm"], help="shipped names, folders, expert")
    parser.add_argument("--episodes", type=int, default=50, help="of every policy in every cell")
    parser.add_argument("--base", default=BASE, help="the world that a case is hidden in")
    parser.add_argument("--runs", type=Path, default=Path("runs/cell_transfer"), help="kept for next time")
    parser.add_argument("--out", type=Path, default=None, help="JSON file of the results")
    given = parser.parse_args()
    results = {}
    for name in given.cases:
        if name not in CASES:
            parser.error(f"no case {name}: one of {', '.join(CASES)}")
        folder = given.runs / name
        model = corrected(CASES[name], given.by, folder)
        files = worlds(CASES[name], model, given.base, folder / f"worlds-{given.by}")
        found = played(given.policies, files, given.episodes, folder / f"episodes-{given.by}")
        effects = [{"effect": e.effect, "where": e.where, "params": _values(e)} for e in load_model(model).effects]
        results[name] = {"hidden": list(CASES[name]), "model": effects, "by": given.by, "policies": found}
        said = ", ".join(e.label for e in load_model(model).effects) or "nothing"
        print(f"### {name}: {' '.join(CASES[name])}\n\n{given.by}: {said}\n\n{markdown(found, NOMINAL)}", flush=True)
        if given.out is not None:
            hashes = {world: load_world(path).hash for world, path in files.items()}
            results[name]["worlds"] = hashes
            record = {
                "experiment": "cell_transfer",
                "cases": results,
                "provenance": provenance(["python", *sys.argv], None),
            }
            write_text_atomic(given.out, json.dumps(record, indent=1, allow_nan=False) + "\n", overwrite=True)


if __name__ == "__main__":
    arguments.told(main)
