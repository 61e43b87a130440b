"""Choose the episodes to film (failures of every kind, seeds that succeed in one world only), and film them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.evaluation.arena import environment
from vispeg.evaluation.films.video import write_image, write_video
from vispeg.evaluation.jobs import Job
from vispeg.evaluation.players import player
from vispeg.evaluation.records import Episode
from vispeg.evaluation.runner import failures
from vispeg.evaluation.schema.gap import Film, Side
from vispeg.render.image_kinds import kind_of, picture_of
from vispeg.task.result import EpisodeResult


def film_seeds(
    jobs: Sequence[Job], episodes: Sequence[Episode], worlds: Sequence[str], folder: Path, most: int
) -> list[Film]:
    """Film up to `most` seeds of each policy (its first training seed), each seed in all of `worlds`.

    Seeds that succeed in the first world and fail in the last come first, then the others that fail in the last, then
    those that fail in the first, then the rest. Failures take turns over the categories. The stills of all sides are
    of the step at which the side in the last world ended; a side that ended before is shown at its end.

    Args:
        jobs: the jobs that were played.
        episodes: their episodes.
        worlds: names of the worlds; usually the reference and the target of a gap.
        folder: for the files.
        most: largest number of seeds per policy.
    """
    films: list[Film] = []
    by = {(e.policy, e.train_seed, e.world, e.seed): e for e in episodes if not e.control and not e.configuration}
    for job in _first(jobs, worlds[-1]):
        name, network = job.entrant.name, job.entrant.train_seed
        played = {s: [by[name, network, w, s] for w in worlds] for s in job.seeds}
        for seed in _worth_seeing(played)[:most]:
            clips = [film(_like(job, w, jobs), seed) for w in worlds]
            step = len(clips[-1].frames) - 1
            sides = [
                side(clip, world, folder, f"{name}-{seed}-{world}", step)
                for clip, world in zip(clips, worlds, strict=True)
            ]
            films.append({"policy": name, "train_seed": network, "seed": seed, "sides": sides})
    return films


def _like(job: Job, world: str, jobs: Sequence[Job]) -> Job:
    """Return the job of the same network in another world, without a control."""
    return next(j for j in jobs if j.entrant == job.entrant and j.world_name == world and not j.control)


def _worth_seeing(played: Mapping[int, Sequence[Episode]]) -> list[int]:
    """Return all seeds in the order of `film_seeds`."""
    groups = (
        [row[-1] for row in played.values() if row[0].success],
        [row[-1] for row in played.values()],
        [row[0] for row in played.values()],
    )
    order = [e.seed for group in groups for e in failures(group, len(group))]
    return list(dict.fromkeys([*order, *played]))


def film_failures(jobs: Sequence[Job], episodes: Sequence[Episode], folder: Path, most: int) -> list[Film]:
    """Film up to `most` failures of each policy in each world, taking turns over the categories.

    The result is as that of `film_seeds`, with one side per film.
    """
    films: list[Film] = []
    for world in dict.fromkeys(j.world_name for j in jobs):
        for job in _first(jobs, world):
            of_policy = [e for e in episodes if (e.policy, e.world) == (job.entrant.name, world) and not e.control]
            for e in failures([e for e in of_policy if e.train_seed == job.entrant.train_seed], most):
                clip = film(job, e.seed)
                entry = side(clip, world, folder, f"{e.policy}-{world}-{e.seed}", len(clip.frames) - 1)
                films.append({"policy": e.policy, "train_seed": e.train_seed, "seed": e.seed, "sides": [entry]})
    return films


def side(clip: Clip, world: str, folder: Path, stem: str, step: int) -> Side:
    """Write a clip's video and its stills at `step` into `folder`; return the record, with paths from its parent."""
    step = min(step, len(clip.frames) - 1)
    view = None if clip.views is None else write_image(folder / f"{stem}-view.png", clip.views[step])
    return {
        "world": world,
        "outcome": f"{clip.category} after {clip.time:.1f} s",
        "video": _relative(write_video(folder / stem, clip.together, (len(clip.frames) - 1) / clip.time), folder),
        "image": _relative(write_image(folder / f"{stem}.jpg", clip.frames[step]), folder),
        "view": _relative(view, folder),
    }


def _relative(path: Path | None, folder: Path) -> str | None:
    return None if path is None else str(path.relative_to(folder.parent))


def _first(jobs: Sequence[Job], world: str) -> list[Job]:
    """Return for each policy its first job in `world` without a control or a configuration."""
    chosen: dict[str, Job] = {}
    for job in jobs:
        if job.world_name == world and not job.control and not job.configuration:
            chosen.setdefault(job.entrant.name, job)
    return list(chosen.values())


@dataclass(frozen=True)
class Clip:
    """One filmed episode.

    Attributes:
        frames: (T, H, W, 3) uint8, outside views, one per policy step and one at the end. If the policy estimates the
            tip's position, the estimate and the truth are written on them.
        views: (T, h, w, 3) uint8, the images of the policy's cameras side by side; None for policies without images.
        category: how the episode ended when it was filmed.
        time: duration of the episode, s.
    """

    frames: np.ndarray
    views: np.ndarray | None
    category: str
    time: float

    @property
    def together(self) -> np.ndarray:
        """Frames with the views below them, scaled to the same width, (T, H', W, 3)."""
        if self.views is None:
            return self.frames
        import cv2

        width = self.frames.shape[2]
        size = (width, round(self.views.shape[1] * width / self.views.shape[2]))
        views = [cv2.resize(v, size, interpolation=cv2.INTER_NEAREST) for v in self.views]
        return np.concatenate([self.frames, np.stack(views)], axis=1)


def film(job: Job, seed: int) -> Clip:
    """Play one seed of a job and film it, one frame per policy step.

    Raises:
        UserError: nothing on this machine can render.
    """
    from vispeg.learn.play import with_estimate

    env = environment(replace(job, rows=1), render_mode="rgb_array")
    policy: Any = player(job.entrant, env.config)
    obs, _ = env.reset(seed=[seed])
    if job.pushes is not None:
        env.push([0], *job.pushes.draw(seed))
    policy.reset(1)
    frames, views = [], []
    record: EpisodeResult | None = None
    while True:
        action = policy.act(obs)  # also on the last observation, for the policy's estimate
        frames.append(with_estimate(env.render()[0], obs, policy))
        views.append(_view(obs))
        if record:
            break
        obs, _, terminated, truncated, infos = env.step(action)
        if terminated[0] or truncated[0]:
            record = infos["record"][0]
    pictures = None if views[0] is None else np.stack(views)
    return Clip(np.stack(frames), pictures, record["category"], record["time"])


def _view(obs: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return the images of row 0 side by side, (h, w, 3) uint8; None without images."""
    images = [picture_of(key, obs[key][0]) for key in sorted(obs) if kind_of(key) is not None]
    if not images:
        return None
    height = max(image.shape[0] for image in images)
    padded = [np.pad(i, ((0, height - i.shape[0]), (0, 0), (0, 0))) for i in images]
    return np.concatenate(padded, axis=1)
