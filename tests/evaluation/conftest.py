"""Invented episodes with known success rates."""

from __future__ import annotations

import numpy as np
import pytest

from vispeg.core.seeds import stream
from vispeg.evaluation.records import Episode

FAILURES = ("search", "jam", "force limit")


def invent(
    rates: dict[tuple[str, str], float],
    worlds: dict[str, float],
    episodes: int = 100,
    train_seeds: int = 1,
    seed: int = 0,
) -> list[Episode]:
    """Episodes of (policy, modality) -> log-odds in worlds -> log-odds shift; hard seeds are hard for everybody."""
    rng = stream(seed, "invented episodes")
    hard = rng.standard_normal(episodes)
    found = []
    for (policy, modality), skill in rates.items():
        for train_seed in range(train_seeds):
            own = 0.3 * rng.standard_normal()
            luck = rng.logistic(size=episodes)
            for world, shift in worlds.items():
                ok = skill + own + shift + hard + 0.9 * luck > 0
                for s in range(episodes):
                    category = "success" if ok[s] else FAILURES[int(rng.choice(3, p=_mix(world)))]
                    found.append(
                        Episode(
                            policy,
                            modality,
                            train_seed,
                            world,
                            f"hash-{world}",
                            s,
                            bool(ok[s]),
                            category,
                            time=float(rng.uniform(2, 8)),
                            peak_force=float(rng.gamma(8, 3)),
                        )
                    )
    return found


def _mix(world: str) -> list[float]:
    return [0.2, 0.6, 0.2] if "P" in world else [0.7, 0.2, 0.1]


@pytest.fixture
def invented():
    """`invent`."""
    return invent


@pytest.fixture
def bernoulli():
    """A (k, n) matrix of successes with seed and episode effects on the log-odds."""

    def draw(rng: np.random.Generator, k: int, n: int, mean: float, seeds: float, episodes: float) -> np.ndarray:
        odds = mean + seeds * rng.standard_normal((k, 1)) + episodes * rng.standard_normal((1, n))
        return (rng.uniform(size=(k, n)) < 1 / (1 + np.exp(-odds))).astype(float)

    return draw
