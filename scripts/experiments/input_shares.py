"""Print the share of each group of inputs in the variance of a policy's first layer, in contact and in free air.

    python scripts/experiments/input_shares.py runs/experiments/ff-randomized_s1/checkpoints/best --world randomized

Of input i, scaled as the network has it: E[x_i^2] |w_i|^2 over the sum of all. A layer normalisation follows, so that
inputs with a small share have little influence.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from arguments import told

from vispeg.core.errors import UserError
from vispeg.interface.terms import PRIVILEGED
from vispeg.learn.policy import NetPolicy, load
from vispeg.task.peg.task import PegInHoleVec

GROUPS = {"position": range(0, 3), "velocity": range(3, 6), "wrench": range(6, 12), "action": range(12, 15)}


def inputs(policy: NetPolicy, world: str, steps: int, seed: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return scaled inputs (n, k) of played steps, whether there was contact (n,), and the size of one observation."""
    env = PegInHoleVec(16, world=world, stack=policy.meta["task"]["stack"], privileged=True)
    obs, _ = env.reset(seed=seed)
    policy.reset(16)
    scaled, touch = [], []
    for _ in range(steps):
        with torch.no_grad():
            known = policy.actor.vector({key: torch.as_tensor(value) for key, value in obs.items()})
            scaled.append(policy.actor.scale(known).numpy())
        touch.append((obs[PRIVILEGED][:, 12:15] != 0).any(axis=1))
        obs, _, terminated, truncated, _ = env.step(policy.act(obs))
        policy.reset(16, terminated | truncated)
    return np.concatenate(scaled), np.concatenate(touch), env.sim.observed.policy_size


def main() -> None:
    """Print a line for each policy, in contact and in free air."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("policies", type=Path, nargs="+", help="folders of policies without images or memory")
    made.add_argument("--world", default="randomized")
    made.add_argument("--steps", type=int, default=60)
    made.add_argument("--seed", type=int, default=77)
    asked = made.parse_args()
    for folder in asked.policies:
        policy = load(folder)
        if policy.actor.encoders or policy.actor.recurrent:
            raise UserError("has images or a memory", file=folder)
        scaled, touch, size = inputs(policy, asked.world, asked.steps, asked.seed)
        weights = policy.actor.body[0].weight.detach().numpy()
        length = policy.actor.layout.vector
        of = {name: [i for i in range(length) if i % size in group] for name, group in GROUPS.items()}
        of |= {"ground truth": list(range(length, scaled.shape[1]))}
        for words, rows in (("in contact", touch), ("in free air", ~touch)):
            power = (scaled[rows] ** 2).mean(axis=0) * (weights**2).sum(axis=0)
            shares = ", ".join(f"{name} {power[i].sum() / power.sum():.0%}" for name, i in of.items() if i)
            print(f"{folder}  {words} ({rows.mean():.0%} of steps)  {shares}")


if __name__ == "__main__":
    told(main)
