"""Run a policy's episodes on given seeds, as many at a time as the environment has rows."""

# gymnasium's vector environments accept one seed per row, but their type annotations do not.
# pyright: reportArgumentType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, count
from typing import Protocol, cast

import numpy as np
from gymnasium.vector import VectorEnv

from vispeg.learn.infos import row_info
from vispeg.task.result import EpisodeResult

SPARE = 2**30  # added to the seeds for episodes that do not count


class Acts(Protocol):
    """The interface of what can be evaluated: it acts on n rows, and its memory can be cleared row by row."""

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Clear the memory of `rows` (n,) bool, or of all n rows."""
        ...

    def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, action) float32 within +-1 for observation arrays (n, ...)."""
        ...


@dataclass(frozen=True)
class Outcome:
    """How one episode ended.

    Attributes:
        seed: seed of the episode.
        success: whether it succeeded.
        category: what ended it, `timeout` where the environment does not say.
        reward: sum of the rewards.
        steps: number of policy steps.
        info: the environment's record of the episode, or its last info if it has no record.
    """

    seed: int
    success: bool
    category: str
    reward: float
    steps: int
    info: EpisodeResult


def run_episodes(policy: Acts, env: VectorEnv, seeds: Sequence[int]) -> list[Outcome]:
    """Play one episode per seed; return the outcomes in the order of `seeds`.

    A row whose episode ended begins the next seed. Every episode is played to its end, so short ones are not
    over-represented. Rows without a seed play episodes that do not count, on seeds of their own (`SPARE`), so that a
    control that shows one row's observations to another never repeats an episode.

    Args:
        policy: acts on all rows at once.
        env: takes `reset(seed=[...], options={"reset_mask": ...})`; its autoreset mode must be `DISABLED`.
        seeds: seeds of the episodes.
    """
    n = env.num_envs
    todo = chain(enumerate(seeds), ((-1, int(seeds[0]) + SPARE + k) for k in count(len(seeds))))
    number = np.full(n, -1)  # which episode each row plays, -1 for none
    out: list[Outcome | None] = [None] * len(seeds)
    row_seeds: list[int] = [0] * n
    for row in range(n):
        number[row], row_seeds[row] = next(todo)
    obs, _ = env.reset(seed=row_seeds)
    policy.reset(n)
    total, steps = np.zeros(n), np.zeros(n, int)
    while (number >= 0).any():
        obs, reward, terminated, truncated, info = env.step(policy.act(obs))
        ended = terminated | truncated
        total, steps = total + reward, steps + 1
        for row in np.flatnonzero(ended).tolist():
            if number[row] >= 0:
                final = row_info(info, row)
                record = cast(EpisodeResult, final.get("record") or final)
                out[number[row]] = Outcome(
                    int(row_seeds[row]),
                    bool(final.get("success", False)),
                    str(final.get("category", "timeout")),
                    float(total[row]),
                    int(steps[row]),
                    record,
                )
            number[row], row_seeds[row] = next(todo)
            total[row], steps[row] = 0.0, 0
        if ended.any() and (number >= 0).any():
            obs, _ = env.reset(seed=row_seeds, options={"reset_mask": ended})
            policy.reset(n, ended)
    return [outcome for outcome in out if outcome is not None]


def success_rate(outcomes: Sequence[Outcome]) -> float:
    """Return the share of successes, 0 to 1; 0 without outcomes."""
    return float(np.mean([outcome.success for outcome in outcomes])) if outcomes else 0.0
