"""Success in a target world against the number of demonstrations there, for three ways to use them.

    python scripts/experiments/finetune_curves.py --policy depth-S --world VNP --seeds 1 2 --runs runs/finetune

`anywhere`: `vispeg finetune` on demonstrations that begin as the world draws them. `where it fails`: on demonstrations
that begin as failed trials of the policy began. `alone`: a network that has seen nothing else, from the demonstrations
of `anywhere` and as many updates, at the rate of imitation. All are judged on the same held-out episodes, and so is the
policy before. A stopped command goes on with the first run that has no result.

Writes RUNS/curves.json, and prints the successes as a Markdown table.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import arguments
import torch

from vispeg.api.learning.finetune import failed_starts
from vispeg.cli.main import main as vispeg
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.core.provenance import provenance
from vispeg.core.seeds import stream
from vispeg.evaluation.statistics import wilson
from vispeg.learn.envs import HELD_OUT, home, of_policy
from vispeg.learn.evaluation import run_episodes
from vispeg.learn.methods.clone import CloneSettings, clone
from vispeg.learn.methods.distill import demonstrations
from vispeg.learn.methods.finetune import FinetuneSettings, finetune
from vispeg.learn.modalities import modality
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import NetPolicy, load
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.teacher import teacher_of

SIZES = (10, 25, 50, 100, 200)
WAYS = ("anywhere", "where it fails", "alone")
JUDGED = HELD_OUT + 100_000  # the first seed of the episodes that judge; no evaluation of a fine-tuning plays them


def judged(policy: NetPolicy, world: str, episodes: int) -> list[bool]:
    """Play the held-out episodes of a world."""
    env = of_policy(policy, world)(8, {})
    ends = run_episodes(policy, env, range(JUDGED, JUDGED + episodes))
    env.close()
    return [end.success for end in ends]


def alone(policy: NetPolicy, world: str, teacher: str, demos: int, updates: int, seed: int) -> NetPolicy:
    """Train a network of the policy's form on demonstrations and nothing else."""
    torch.manual_seed(seed)
    old = policy.actor
    actor = Actor(old.layout, modality(policy.modality), old.hidden, old.recurrent)
    env: Any = Sb3Env(of_policy(policy, world)(8, {}))
    ring, _ = demonstrations(env, teacher_of(teacher, env.env.config), demos, seed)
    clone(actor, [(ring, 1.0)], updates, CloneSettings(), stream(seed, "finetune"))
    env.close()
    return NetPolicy(actor.eval(), policy.modality, policy.meta)


def trials_of(given: argparse.Namespace) -> Path:
    """Play the policy in the target world on seeds of its own, and keep how each episode began."""
    trials = given.runs / "trials"
    if not trials.exists():
        argv = ("--episodes", "100", "--seed", "77", "--videos", "0", "--quiet", "--overwrite")
        where = ("--world", given.world, "--keep-trials", str(trials), "--out", str(given.runs / "before"))
        if vispeg(["evaluate", given.policy, *where, *argv]) != 0:
            raise UserError("cannot be played", key="--policy", got=given.policy)
    return trials


def one(given: argparse.Namespace, way: str, demos: int, seed: int) -> list[bool]:
    """Train one policy and judge it."""
    before, training = load(given.policy), of_policy(load(given.policy), home(load(given.policy)))
    if way == "alone":
        policy = alone(before, given.world, given.teacher, demos, given.updates, seed)
        return judged(policy, given.world, given.episodes)
    starts = failed_starts(trials_of(given)) if way == "where it fails" else ()
    settings = FinetuneSettings(demos, given.updates, episodes=1)
    target, out = of_policy(before, given.world), given.runs / f"{way.replace(' ', '-')}-{demos}-{seed}"

    def teach(env: Any) -> Any:
        return teacher_of(given.teacher, env.config)

    finetune(Path(given.policy), out, target, training, teach, settings, seed, starts=starts, overwrite=True, say=quiet)
    return judged(load(out), given.world, given.episodes)


def quiet(text: str) -> None:
    """Say nothing."""


def table(record: Mapping[str, Any]) -> str:
    """Return the table: a row a number of demonstrations, a column a way, each seed's share in brackets."""

    def cell(ends: Sequence[Sequence[bool]]) -> str:
        if not ends:
            return "-"
        total = wilson(sum(map(sum, ends)), sum(map(len, ends)))
        each = ", ".join(f"{100 * sum(e) / len(e):.0f}" for e in ends)
        return f"{100 * total.value:.0f} % ({100 * total.low:.0f} to {100 * total.high:.0f}) [{each}]"

    lines = ["| demonstrations | " + " | ".join(WAYS) + " |", "|---|" + "---|" * len(WAYS)]
    lines.append(f"| 0 | {cell([record['before']])} | | |" if record["before"] else "")
    for demos in sorted({row["demos"] for row in record["rows"]}):
        found = [[r["ends"] for r in record["rows"] if (r["demos"], r["way"]) == (demos, way)] for way in WAYS]
        lines.append(f"| {demos} | " + " | ".join(map(cell, found)) + " |")
    return "\n".join(lines)


def main(say: Callable[[str], None] = print) -> None:
    """Go through sizes, ways and seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", default="depth-S")
    parser.add_argument("--world", default="VNP", help="the target")
    parser.add_argument("--teacher", default="state-3mm-randomized")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--seeds", type=int, nargs="+", default=(1, 2))
    parser.add_argument("--updates", type=int, default=2000)
    parser.add_argument("--episodes", type=int, default=100, help="held-out episodes that judge")
    parser.add_argument("--runs", type=Path, required=True, help="folder of runs, kept for next time")
    given = parser.parse_args()
    torch.set_num_threads(1)
    given.runs.mkdir(parents=True, exist_ok=True)
    file = given.runs / "curves.json"
    budget = {key: getattr(given, key) for key in ("policy", "world", "teacher", "updates", "episodes")}
    record: dict[str, Any] = {"budget": budget, "before": [], "rows": []}
    if file.exists():
        record = json.loads(file.read_text(encoding="utf-8"))
        if record["budget"] != budget:
            raise UserError("holds other runs", file=file, expected=budget, got=record["budget"])
    if not record["before"]:
        record["before"] = judged(load(given.policy), given.world, given.episodes)
    there = {(row["demos"], row["way"], row["seed"]) for row in record["rows"]}
    for seed in given.seeds:
        for demos in given.sizes:
            for way in WAYS:
                if (demos, way, seed) in there:
                    continue
                begun = time.process_time()
                ends = one(given, way, demos, seed)
                cpu = round(time.process_time() - begun, 1)
                record["rows"].append({"demos": demos, "way": way, "seed": seed, "ends": ends, "cpu_s": cpu})
                record["provenance"] = provenance(sys.argv, None)
                write_text_atomic(file, json.dumps(record, indent=1) + "\n", overwrite=True)
                say(f"{demos} {way} {seed}: {sum(ends)} of {len(ends)}, {cpu:.0f} s")
    say(table(record))


if __name__ == "__main__":
    arguments.told(main)
