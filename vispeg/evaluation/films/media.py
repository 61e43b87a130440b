"""Which episodes to show: failures of every kind, and seeds that succeed in one world and fail in another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from vispeg.evaluation.films.film import Clip, film
from vispeg.evaluation.films.video import write_image, write_video
from vispeg.evaluation.jobs import Job
from vispeg.evaluation.records import Episode
from vispeg.evaluation.runner import failures
from vispeg.evaluation.schema.gap import Film, Side


def film_seeds(
    jobs: Sequence[Job], episodes: Sequence[Episode], worlds: Sequence[str], folder: Path, most: int
) -> list[Film]:
    """Films `most` seeds a policy (its first training seed), each in all of `worlds`, the first and the last of a gap.

    Seeds that succeed in the first world and fail in the last come first, then those that fail in the last, in the
    first, and in neither; of failures every category in turn. The stills show all sides at the step at which the last
    one ended, or at the last step of one that was done before.
    """
    films: list[Film] = []
    by = {(e.policy, e.train_seed, e.world, e.seed): e for e in episodes if not e.control and not e.configuration}
    for job in _first(jobs, worlds[-1]):
        name, network = job.entrant.name, job.entrant.train_seed
        played = {s: [by[name, network, w, s] for w in worlds] for s in job.seeds}
        for seed in _worth_seeing(played)[:most]:
            clips = [film(_like(job, w, jobs), seed) for w in worlds]
            step = len(clips[-1].frames) - 1
            named = zip(clips, worlds, strict=True)
            sides = [side(clip, world, folder, f"{name}-{seed}-{world}", step) for clip, world in named]
            films.append({"policy": name, "seed": seed, "sides": sides})
    return films


def _like(job: Job, world: str, jobs: Sequence[Job]) -> Job:
    """Give the job of the same network in another world."""
    return next(j for j in jobs if j.entrant == job.entrant and j.world_name == world and not j.control)


def _worth_seeing(played: Mapping[int, Sequence[Episode]]) -> list[int]:
    """All seeds, in the order of `film_seeds`."""
    groups = (
        [row[-1] for row in played.values() if row[0].success],
        [row[-1] for row in played.values()],
        [row[0] for row in played.values()],
    )
    order = [e.seed for group in groups for e in failures(group, len(group))]
    return list(dict.fromkeys([*order, *played]))


def film_failures(jobs: Sequence[Job], episodes: Sequence[Episode], folder: Path, most: int) -> list[Film]:
    """Films up to `most` failures a policy, every category in turn; for the page as `film_seeds`, with one side."""
    films: list[Film] = []
    for world in dict.fromkeys(j.world_name for j in jobs):
        for job in _first(jobs, world):
            of_policy = [e for e in episodes if (e.policy, e.world) == (job.entrant.name, world) and not e.control]
            for e in failures([e for e in of_policy if e.train_seed == job.entrant.train_seed], most):
                clip = film(job, e.seed)
                entry = side(clip, world, folder, f"{e.policy}-{world}-{e.seed}", len(clip.frames) - 1)
                films.append({"policy": e.policy, "seed": e.seed, "sides": [entry]})
    return films


def side(clip: Clip, world: str, folder: Path, stem: str, step: int) -> Side:
    """Write a clip's video and stills at `step` into `folder`; name relative to its parent."""
    step = min(step, len(clip.frames) - 1)
    view = None if clip.views is None else write_image(folder / f"{stem}-view.png", clip.views[step])
    return {
        "world": world,
        "outcome": f"{clip.category} after {clip.time:.1f} s",
        "video": _relative(write_video(folder / stem, clip.together), folder),
        "image": _relative(write_image(folder / f"{stem}.jpg", clip.frames[step]), folder),
        "view": _relative(view, folder),
    }


def _relative(path: Path | None, folder: Path) -> str | None:
    return None if path is None else str(path.relative_to(folder.parent))


def _first(jobs: Sequence[Job], world: str) -> list[Job]:
    """One uncontrolled job a policy in `world`: its first training seed."""
    chosen: dict[str, Job] = {}
    for job in jobs:
        if job.world_name == world and not job.control and not job.configuration:
            chosen.setdefault(job.entrant.name, job)
    return list(chosen.values())
