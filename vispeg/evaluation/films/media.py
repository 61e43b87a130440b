"""Which episodes to film (failures of every kind, seeds that succeed in one world alone), and their films."""

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


@dataclass(frozen=True)
class Clip:
    """One episode.

    Attributes:
        frames: (T, H, W, 3) uint8 from outside, one a policy step; on them where the policy thinks the tip to be and
            where it is, if it says.
        views: (T, h, w, 3) uint8, what the policy's cameras saw, side by side; None for policies that see nothing.
        category: how it ended this time.
        time: s, how long it took.
    """

    frames: np.ndarray
    views: np.ndarray | None
    category: str
    time: float

    @property
    def together(self) -> np.ndarray:
        """Frames with the views below them, scaled to the same width (T, H', W, 3)."""
        if self.views is None:
            return self.frames
        import cv2

        width = self.frames.shape[2]
        size = (width, round(self.views.shape[1] * width / self.views.shape[2]))
        views = [cv2.resize(v, size, interpolation=cv2.INTER_NEAREST) for v in self.views]
        return np.concatenate([self.frames, np.stack(views)], axis=1)


def film(job: Job, seed: int) -> Clip:
    """Plays one seed of a job with a picture at every policy step.

    Raises:
        UserError: nothing renders on this machine.
    """
    from vispeg.learn.play import thoughts

    env = environment(replace(job, rows=1), render_mode="rgb_array")
    policy: Any = player(job.entrant, env.config)
    obs, _ = env.reset(seed=[seed])
    if job.pushes is not None:
        env.push([0], *job.pushes.draw(seed))
    policy.reset(1)
    frames, views = [], []
    record: EpisodeResult | None = None
    while True:
        action = policy.act(obs)  # also on the last observation, for what it thinks of it
        frames.append(thoughts(env.render()[0], obs, policy))
        views.append(_view(obs))
        if record:
            break
        obs, _, terminated, truncated, infos = env.step(action)
        if terminated[0] or truncated[0]:
            record = infos["record"][0]
    pictures = None if views[0] is None else np.stack(views)
    return Clip(np.stack(frames), pictures, record["category"], record["time"])


def _view(obs: dict[str, np.ndarray]) -> np.ndarray | None:
    """Give the images of row 0 side by side (h, w, 3) uint8, or None."""
    images = [picture_of(key, obs[key][0]) for key in sorted(obs) if kind_of(key) is not None]
    if not images:
        return None
    height = max(image.shape[0] for image in images)
    padded = [np.pad(i, ((0, height - i.shape[0]), (0, 0), (0, 0))) for i in images]
    return np.concatenate(padded, axis=1)
