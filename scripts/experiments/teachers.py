"""Measure the success of a teacher on its students' readings, which `vispeg evaluate` cannot do.

    python scripts/experiments/teachers.py state-3mm-randomized state-3mm-readings --worlds randomized-readings P

A teacher is shown the true hole and a wrist sensor that is tared; the students' readings are otherwise its own.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np
from arguments import told

from vispeg.evaluation.statistics import wilson
from vispeg.learn.shipped import policy_folder
from vispeg.learn.teacher import teacher_of
from vispeg.task.peg.task import PegInHoleVec


def judged(name: str, world: str, episodes: int, seed: int, rows: int = 20) -> list[str]:
    """Return the categories of the episodes of the seeds from `seed` on, played in blocks of `rows`."""
    ends: list[str] = []
    while len(ends) < episodes:
        seeds = list(range(seed + len(ends), seed + min(len(ends) + rows, episodes)))
        env = PegInHoleVec(len(seeds), world, "proprio", autoreset_mode="Disabled", privileged=True)
        teacher = teacher_of(name if name == "expert" else policy_folder(name), env.config)
        obs, _ = env.reset(seed=seeds)
        teacher.reset(len(seeds))
        categories: list[str | None] = [None] * len(seeds)
        while None in categories:
            obs, _, terminated, truncated, info = env.step(teacher.act(obs))
            for row in np.flatnonzero(terminated | truncated):
                categories[row] = categories[row] or info["record"][row]["category"]
        ends += [category for category in categories if category is not None]
    return ends


def main() -> None:
    """Print a line for each teacher and world."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("teachers", nargs="+", help="names or folders of policies that know the state, or expert")
    made.add_argument("--worlds", nargs="+", default=["randomized", "randomized-readings"])
    made.add_argument("--episodes", type=int, default=200)
    made.add_argument("--seed", type=int, default=500, help="of the first episode")
    asked = made.parse_args()
    for world in asked.worlds:
        for name in asked.teachers:
            ends = Counter(judged(name, world, asked.episodes, asked.seed))
            rate = wilson(ends.pop("success", 0), asked.episodes)
            others = ", ".join(f"{category} {count}" for category, count in ends.most_common())
            print(
                f"{world}  {name}  {100 * rate.value:.1f} % ({100 * rate.low:.1f} to {100 * rate.high:.1f})  {others}"
            )


if __name__ == "__main__":
    told(main)
