"""Both engines of the physics: speed, success on the same seeds, and time to train by imitation.

    python scripts/bench/engines.py [--rows 16 1024 4096] [--engines c warp] [--imitation 1024] [--threads 1]

Episodes: the bundled policy `state-3mm-randomized` plays two episodes a row, resets included, after two first steps
that compile what it needs. Imitation: `vispeg train peg-state --world unknown_hole --recipe distill` of the same
policy, until two evaluations in a row reach 98 %; evaluations are on MuJoCo itself, and their time counts. The device
is the first GPU, or the CPU where there is none.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from vispeg.api.train import train
from vispeg.learn.evaluation import run_episodes
from vispeg.learn.policy import load
from vispeg.sim.engine import ENGINES
from vispeg.sim.warp import device
from vispeg.task.environments.vector import TaskVec

POLICY = Path(__file__).parents[2] / "assets" / "policies" / "state-3mm-randomized"
GOAL = 0.98


def played(world: str, engine: str, rows: int, threads: int) -> str:
    """Play two episodes a row; return the table's row."""
    policy = load(POLICY)
    env = TaskVec(rows, world, engine=engine, nthread=threads, autoreset_mode="Disabled", privileged=True)
    for _ in range(2):  # the second one captures the graphs of a GPU
        obs, _ = env.reset(seed=0)
        policy.reset(rows)
        env.step(policy.act(obs))
    begin = time.monotonic()
    ends = run_episodes(policy, env, range(1000, 1000 + 2 * rows))
    spent = time.monotonic() - begin
    simulated = sum(e.info["time"] for e in ends) / spent
    peak = np.median([e.info["peak_force"] for e in ends])
    success = f"{sum(e.success for e in ends)}/{len(ends)}"
    return f"| {world} | {rows} | {engine} | {len(ends) / spent:.2f} | {simulated:.1f} | {success} | {peak:.0f} |"


def imitated(engine: str, envs: int, steps: int, threads: int, folder: Path) -> str:
    """Train by imitation; return the table's row."""
    run = train(
        "peg-state",
        world="unknown_hole",
        recipe="distill",
        teacher=POLICY,
        engine=engine,
        envs=envs,
        threads=threads,
        target=GOAL,
        distill={"steps": steps},
        out=folder / engine,
    )
    reached = [row for row in run.history if float(row["success"]) >= GOAL]
    first = f"{float(reached[0]['seconds']):.0f}" if reached else "-"
    best = max(float(row["success"]) for row in run.history)
    return f"| {engine} | {envs} | {steps} | {first} | {best:.0%} | {float(run.history[-1]['seconds']):.0f} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="*", default=[16, 1024, 4096])
    parser.add_argument("--engines", nargs="+", choices=ENGINES, default=[*ENGINES])
    parser.add_argument("--worlds", nargs="+", default=["nominal", "randomized"])
    parser.add_argument("--imitation", type=int, default=1024, help="environments; 0 for none")
    parser.add_argument("--steps", type=int, default=20_000, help="environment steps of each of the five rounds")
    parser.add_argument("--threads", type=int, default=1)
    given = parser.parse_args()
    print(f"warp: {device()}\n")
    if given.rows:
        print("| world | rows | engine | episodes/s | simulated s/s | success | median peak, N |")
        print("|---|---|---|---|---|---|---|")
    for world in given.worlds:
        for rows in given.rows:
            for engine in given.engines:
                print(played(world, engine, rows, given.threads), flush=True)
    if not given.imitation:
        return
    print("\n| imitation | rows | steps a round | s to 98 % | best | s in all |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for engine in given.engines:
            print(imitated(engine, given.imitation, given.steps, given.threads, Path(folder)), flush=True)


if __name__ == "__main__":
    main()
