"""Episodes of a policy on given seeds, as many at a time as the environment has rows."""

# gymnasium's vector environments take a seed a row; their types do not say so.
# pyright: reportArgumentType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np
from gymnasium.vector import VectorEnv

from vispeg.learn.infos import row_info
from vispeg.task.result import EpisodeResult

SPARE = 2**30  # from the first seed to those of rows that have none to play


class Acts(Protocol):
    """What can be evaluated: something with a memory of n rows that may be cleared row by row."""

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Forgets the episodes so far, of `rows` (bool mask) or of all."""
        ...

    def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        """Observation arrays (n, ...) -> actions (n, action) float32 within +-1."""
        ...


@dataclass(frozen=True)
class Outcome:
    """How one episode ended; `info` is the environment's record of it, or its values if there is none."""

    seed: int
    success: bool
    category: str
    reward: float
    steps: int
    info: EpisodeResult


def run_episodes(policy: Acts, env: VectorEnv, seeds: Sequence[int]) -> list[Outcome]:
    """One episode for every seed, in the order of `seeds`.

    A row that ends begins the next seed; every episode is waited for, so that short ones are not over-represented.
    Rows that are left over play episodes that do not count, and are nobody else's: a control may show them to others.

    Args:
        policy: acts on all rows at once.
        env: takes `reset(seed=[...], options={"reset_mask": ...})`; its own way of resetting must be `DISABLED`.
        seeds: of the episodes.
    """
    n, todo = env.num_envs, list(enumerate(seeds))
    number = np.full(n, -1)  # which episode each row plays, -1 for none
    out: list[Outcome | None] = [None] * len(todo)
    row_seeds: list[int] = [0] * n
    for row in range(n):
        number[row], row_seeds[row] = todo.pop(0) if todo else (-1, int(seeds[0]) + SPARE + row)
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
            number[row], row_seeds[row] = todo.pop(0) if todo else (-1, row_seeds[row])
            total[row], steps[row] = 0.0, 0
        if ended.any() and (number >= 0).any():
            obs, _ = env.reset(seed=row_seeds, options={"reset_mask": ended})
            policy.reset(n, ended)
    return [outcome for outcome in out if outcome is not None]


def success_rate(outcomes: Sequence[Outcome]) -> float:
    """Share of successes, 0 to 1."""
    return float(np.mean([outcome.success for outcome in outcomes])) if outcomes else 0.0
