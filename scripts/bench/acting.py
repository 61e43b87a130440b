"""Measure the CPU time that a policy takes to act, row by row, and that of an environment step for comparison.

    python scripts/bench/acting.py --block 8

Columns: rows, ms that the policy takes for all of them, ms if rows are computed in blocks (not done in play, because on
some processors a row's result then depends on its place in the block), ms of one environment step in world S.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import torch

from vispeg.core.assets import assets
from vispeg.learn.modalities import modality
from vispeg.learn.policy import NetPolicy, load
from vispeg.task.peg.task import PegInHoleVec

POLICIES, ROWS, REPEATS = ("state-3mm", "depth-S", "rgbd-S"), (1, 16, 50), 5


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--block", type=int, default=8, help="rows in a block")
    block = parser.parse_args().block
    torch.set_num_threads(1)
    print(f"{'policy':<12}{'rows':>5}{'alone':>9}{'blocks':>9}{'environment':>13}")
    for name in POLICIES:
        policy = load(assets() / "policies" / name)
        for n in ROWS:
            env = PegInHoleVec(n, "S", modality(policy.modality).obs_mode, autoreset_mode="Disabled", privileged=True)
            obs, _ = env.reset(seed=0)
            policy.reset(n)
            parts = {key: torch.from_numpy(obs[key]) for key in policy.layout.keys}
            alone, together = cost(lambda p=policy, o=obs: p.act(o)), cost(lambda p=policy, o=parts: acted(p, o, block))
            step = cost(lambda e=env, k=n: e.step(np.zeros((k, 3))))
            env.close()
            print(f"{name:<12}{n:>5}{alone:>9.2f}{together:>9.2f}{step:>13.1f}", flush=True)


def acted(policy: NetPolicy, parts: dict[str, torch.Tensor], block: int) -> None:
    """Compute the actions of rows in blocks; the last block is filled up."""
    n = len(parts["policy"])
    with torch.inference_mode():
        for at in range(0, n, block):
            rows = torch.arange(at, at + block).clamp_max(n - 1)
            policy.actor.act({key: value[rows] for key, value in parts.items()})


def cost(call: Callable[[], object]) -> float:
    """Return the CPU time of a call in ms, the least of several tries."""
    call()
    found = []
    for _ in range(REPEATS):
        before = time.process_time()
        call()
        found.append(time.process_time() - before)
    return 1e3 * min(found)


if __name__ == "__main__":
    main()
