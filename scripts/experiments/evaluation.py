"""Trained policies on the same held-out episodes in several worlds; what was played already is not played again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from vispeg.evaluation.entrants import entrant
from vispeg.evaluation.jobs import Setting, make_jobs, seeds_of
from vispeg.evaluation.records import Episode
from vispeg.evaluation.runner import run
from vispeg.task.world_file import load_world


def played(policies: Iterable[tuple[str, Path]], worlds: Sequence[str], episodes: int, out: Path) -> list[Episode]:
    """Play each (name, run folder)'s best policy in every world, and return the episodes.

    The best is by its own evaluations while training; the last one where none was evaluated at the last stage. The
    seeds are other ones than training and its evaluations had, the same for every policy and world.
    """
    who = [entrant(f"{name}={policy_of(folder / 'checkpoints')}") for name, folder in policies]
    settings = [Setting(world, load_world(world).name) for world in worlds]
    return run(make_jobs(who, settings, seeds_of(episodes), out / "worlds"), out)


def policy_of(checkpoints: Path) -> Path:
    """Return the best policy in a run's folder of checkpoints, or the last one where none is the best."""
    best = checkpoints / "best"
    return best if best.is_dir() else checkpoints / "last"
