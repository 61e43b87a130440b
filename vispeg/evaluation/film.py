"""An episode played again for people: pictures from outside and through the policy's own eyes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vispeg.evaluation.arena import environment
from vispeg.evaluation.jobs import Job
from vispeg.evaluation.players import player

NEAR, FAR = 0.02, 0.40  # m, depths between which a depth image is shown from white to black


@dataclass(frozen=True)
class Clip:
    """One episode.

    Attributes:
        frames: (T, H, W, 3) uint8 from outside, one a policy step; on them where the policy thinks the peg to be and
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
    told: dict[str, Any] = {}
    while True:
        action = policy.act(obs)  # also on the last observation, for what it thinks of it
        frames.append(thoughts(env.render()[0], obs, policy))
        views.append(_view(obs))
        if told:
            break
        obs, _, terminated, truncated, infos = env.step(action)
        if terminated[0] or truncated[0]:
            told = infos["record"][0]
    seen = None if views[0] is None else np.stack(views)
    return Clip(np.stack(frames), seen, str(told["category"]), float(told["time"]))


def _view(obs: dict[str, np.ndarray]) -> np.ndarray | None:
    """The images of row 0 side by side (h, w, 3) uint8, or None."""
    found = []
    for key in sorted(obs):
        if key.startswith("rgb_"):
            found.append(np.moveaxis(obs[key][0], 0, -1))
        elif key.startswith("depth_"):
            found.append(depth_picture(obs[key][0, 0]))
    if not found:
        return None
    height = max(image.shape[0] for image in found)
    padded = [np.pad(i, ((0, height - i.shape[0]), (0, 0), (0, 0))) for i in found]
    return np.concatenate(padded, axis=1)


def depth_picture(depth: np.ndarray) -> np.ndarray:
    """Depth (H, W) m as grey (H, W, 3) uint8: near is bright; no reading (0) is dark red."""
    grey = 255 * (1 - np.clip((depth - NEAR) / (FAR - NEAR), 0, 1))
    image = np.repeat(grey[..., None], 3, axis=-1).astype(np.uint8)
    image[~(depth > 0)] = (90, 0, 0)
    return image
