"""An episode played again for people: pictures from outside and through the policy's own eyes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vispeg.evaluation.arena import environment
from vispeg.evaluation.jobs import Job
from vispeg.evaluation.players import player
from vispeg.render.image_kinds import kind_of, picture_of
from vispeg.task.result import EpisodeResult


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
