"""Jobs of an evaluation: one policy in one world on some seeds, the unit of work of a worker process."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.seeds import LAST_SEED, stream
from vispeg.evaluation.controls import ON_IMAGES, at_nominal
from vispeg.evaluation.entrants import Entrant
from vispeg.evaluation.overlay import Change, overlay
from vispeg.evaluation.remainder import Remainder
from vispeg.evaluation.replay import Replays
from vispeg.render.image_kinds import MODES
from vispeg.task.registry import scene_of
from vispeg.task.world_file import load_world

# First seed of an evaluation. Training draws its seeds at random below 2^31: one training in two thousand, of two
# thousand episodes each, meets any of 500 evaluation seeds.
FIRST_SEED = 1_000_000
SEEDS_APART = 100_000  # between the first seeds of two evaluations
STATE_ROWS, IMAGE_ROWS = 50, 20  # episodes side by side, without and with images


@dataclass(frozen=True)
class Pushes:
    """A push in every episode, drawn from the episode's seed.

    Attributes:
        force: range of the force, N.
        duration: duration of the push, s.
        start: range of the push's beginning, s after that of the episode.
    """

    force: tuple[float, float] = (20.0, 60.0)
    duration: float = 0.2
    start: tuple[float, float] = (0.3, 3.0)

    def draw(self, seed: int) -> tuple[list[float], float, float]:
        """Return the force (3,) N, horizontal in any direction, and the push's beginning and duration, s."""
        rng = stream(seed, "push")
        size, angle = rng.uniform(*self.force), rng.uniform(-math.pi, math.pi)
        return [size * math.cos(angle), size * math.sin(angle), 0.0], float(rng.uniform(*self.start)), self.duration


@dataclass(frozen=True)
class Job:
    """One policy in one world on some seeds.

    Attributes:
        entrant: the policy.
        world: the world file's path or built-in name.
        world_name, world_hash: the world's name and hash in the episodes' records.
        seeds: seeds of the episodes.
        control, configuration: as in Episode.
        pushes: pushes in the episodes, or None.
        profile: whether to record force profiles.
        rows: number of episodes side by side.
        dump: folder for episodes that diverge, to be replayed; None to keep none.
        trials: folder in which each episode is kept as a trial, or None.
        replays: starts and actions of trials to replay, or None.
        remainder: torques that disturb the arm in every episode, or None.
    """

    entrant: Entrant
    world: str
    world_name: str
    world_hash: str
    seeds: tuple[int, ...]
    control: str = ""
    configuration: str = ""
    pushes: Pushes | None = None
    profile: bool = False
    rows: int = STATE_ROWS
    dump: Path | None = None
    trials: Path | None = None
    replays: Replays | None = None
    remainder: Remainder | None = None

    def keys(self) -> list[tuple[str, int, str, str, str, int]]:
        """Return the keys of the job's episodes, see Episode."""
        e = self.entrant
        return [(e.name, e.train_seed, self.world_name, self.control, self.configuration, s) for s in self.seeds]

    def split(self, size: int) -> list[Job]:
        """Split the job into jobs of up to `size` seeds."""
        pieces = [self.seeds[i : i + size] for i in range(0, len(self.seeds), size)]
        # two rows even for one seed, so that shuffled images come from another episode
        return [replace(self, seeds=piece, rows=min(self.rows, max(2, len(piece)))) for piece in pieces]


@dataclass(frozen=True)
class Setting:
    """A world with changes, before it is written as a file.

    Attributes:
        world: built-in name or path.
        name: the world's name in the episodes' records.
        configuration: as in Episode.
        changes, task: changed effects and task settings, see `overlay`.
        pushes: as in Job.
        control: as in Job; `GOAL_fixed` adds its change to the world.
    """

    world: str
    name: str
    configuration: str = ""
    changes: tuple[Change, ...] = ()
    task: Mapping[str, Any] = field(default_factory=dict)
    pushes: Pushes | None = None
    control: str = ""


def make_jobs(
    who: Sequence[Entrant], settings: Sequence[Setting], seeds: Sequence[int], folder: Path, profile: bool = False
) -> list[Job]:
    """Return a job for every policy in every setting; write changed worlds into `folder`.

    Controls on images are left out for policies without images.

    Raises:
        UserError: a modality that this installation does not have, or an invalid world.
    """
    jobs, seeing = [], {e.modality: has_eyes(e) for e in who}
    for s in settings:
        changes = s.changes
        if s.control and s.control not in ON_IMAGES:
            changes = (*changes, at_nominal(scene_of(load_world(s.world).task)))
        label = "-".join(part for part in (s.name, s.configuration, s.control) if part)
        made = overlay(s.world, label, folder, changes, s.task)
        for e in who:
            sees = seeing[e.modality]
            if s.control in ON_IMAGES and not sees:
                continue
            rows = 1 if e.alone else IMAGE_ROWS if sees else STATE_ROWS
            job = Job(e, str(made.path), s.name, made.hash, tuple(seeds), s.control, s.configuration, s.pushes, profile)
            jobs.append(replace(job, rows=rows))
    return jobs


def has_eyes(who: Entrant) -> bool:
    """Return whether a policy sees images.

    Raises:
        UserError: a modality that this installation does not have.
    """
    if who.modality in MODES:  # only other modalities need an import of `vispeg.learn`
        return bool(MODES[who.modality])
    from vispeg.learn.modalities import modality

    return bool(modality(who.modality).kinds)


def seeds_of(episodes: int, seed: int = 0) -> list[int]:
    """Return the held-out seeds of an evaluation; another `seed` gives other ones, if `episodes` is below SEEDS_APART.

    Raises:
        UserError: a negative `seed`, or one whose episodes would have seeds above LAST_SEED.
    """
    most = (LAST_SEED - FIRST_SEED - episodes) // SEEDS_APART
    if not 0 <= seed <= most:
        raise UserError("not a seed of an evaluation", key="--seed", expected=f"0 to {most}", got=seed)
    start = FIRST_SEED + SEEDS_APART * seed
    return list(range(start, start + episodes))
