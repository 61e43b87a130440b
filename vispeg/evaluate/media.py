"""Which episodes to show: failures of every kind, and seeds that succeed in one world and fail in another."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vispeg.evaluate.film import Clip, film
from vispeg.evaluate.jobs import Job
from vispeg.evaluate.records import Episode
from vispeg.evaluate.runner import failures
from vispeg.evaluate.video import write_image, write_video


def film_pairs(
    jobs: Sequence[Job], episodes: Sequence[Episode], reference: str, target: str, folder: Path, most: int
) -> list[dict[str, Any]]:
    """Films up to `most` seeds a policy that succeed in `reference` and fail in `target`.

    The stills show both sides at the step at which the failing one ended, or the last step of one that was done before.
    """
    found = []
    by = {(e.policy, e.train_seed, e.world, e.seed): e for e in episodes if not e.control and not e.configuration}
    for job in _first(jobs, target):
        other = [j for j in jobs if j.entrant == job.entrant and j.world_name == reference and not j.control]
        if not other:
            continue
        who = (job.entrant.name, job.entrant.train_seed)
        lost = [by[*who, target, s] for s in job.seeds if _lost(by, who, s, reference, target)]
        for e in failures(lost, most):
            clips = [film(j, e.seed) for j in (other[0], job)]
            step = len(clips[1].frames) - 1
            stem = f"{e.policy}-{e.seed}"
            sides = [
                side(clip, world, folder, f"{stem}-{world}", step)
                for clip, world in zip(clips, (reference, target), strict=True)
            ]
            found.append({"policy": e.policy, "seed": e.seed, "sides": sides})
    return found


def film_failures(jobs: Sequence[Job], episodes: Sequence[Episode], folder: Path, most: int) -> list[dict[str, Any]]:
    """Films up to `most` failures a policy, every category in turn; for the page as `film_pairs`, with one side."""
    found = []
    for world in dict.fromkeys(j.world_name for j in jobs):
        for job in _first(jobs, world):
            own = [e for e in episodes if (e.policy, e.world) == (job.entrant.name, world) and not e.control]
            for e in failures([e for e in own if e.train_seed == job.entrant.train_seed], most):
                clip = film(job, e.seed)
                shown = side(clip, world, folder, f"{e.policy}-{world}-{e.seed}", len(clip.frames) - 1)
                found.append({"policy": e.policy, "seed": e.seed, "sides": [shown]})
    return found


def side(clip: Clip, world: str, folder: Path, stem: str, step: int) -> dict[str, str | None]:
    """Writes a clip's video and stills at `step` into `folder`; names relative to its parent."""
    step = min(step, len(clip.frames) - 1)
    names: dict[str, Path | None] = {
        "video": write_video(folder / stem, clip.together),
        "image": write_image(folder / f"{stem}.jpg", clip.frames[step]),
        "view": None if clip.views is None else write_image(folder / f"{stem}-view.png", clip.views[step]),
    }
    shown = {k: None if p is None else str(p.relative_to(folder.parent)) for k, p in names.items()}
    return {"world": world, "outcome": f"{clip.category} after {clip.time:.1f} s", **shown}


def _first(jobs: Sequence[Job], world: str) -> list[Job]:
    """One uncontrolled job a policy in `world`: its first training seed."""
    found: dict[str, Job] = {}
    for job in jobs:
        if job.world_name == world and not job.control and not job.configuration:
            found.setdefault(job.entrant.name, job)
    return list(found.values())


def _lost(by: dict[Any, Episode], who: tuple[str, int], seed: int, reference: str, target: str) -> bool:
    here, there = by.get((*who, reference, seed)), by.get((*who, target, seed))
    return here is not None and there is not None and here.success and not there.success
