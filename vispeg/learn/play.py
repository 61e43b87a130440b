"""Episodes of a policy as frames for a video: the cell, what the policy sees, where it thinks the tip is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.learn.layout import ESTIMATE, OFFSET_M, PRIVILEGED
from vispeg.render.image_kinds import picture_of

if TYPE_CHECKING:
    from vispeg.learn.policy import Policy

WHITE, GREEN, RED = (255, 255, 255), (90, 220, 120), (255, 110, 90)


@dataclass(frozen=True)
class Played:
    """One episode: frames (T, H, W, 3) uint8 and the environment's record of how it ended."""

    seed: int
    frames: np.ndarray
    record: Mapping[str, Any]


def play(policy: Policy, env: Any, seeds: list[int]) -> Iterator[Played]:
    """Plays one episode a seed.

    Args:
        policy: to play.
        env: a vector environment of one row with `render_mode="rgb_array"` without autoreset.
        seeds: of the episodes.
    """
    from vispeg.learn.infos import row_info

    for seed in seeds:
        obs, _ = env.reset(seed=[seed])
        policy.reset(1)
        frames, over, info = [], False, {}
        while not over:
            action = policy.act(obs)
            frames.append(compose(env.render()[0], obs, policy, action))
            obs, _, terminated, truncated, info = env.step(action)
            over = bool(terminated[0] or truncated[0])
        record = row_info(info, 0)
        policy.act(obs)
        last = compose(env.render()[0], obs, policy, np.zeros_like(action))
        word = str(record.get("category", ""))
        write(last, word, (8, 20), GREEN if record.get("success") else RED)
        yield Played(seed, np.stack([*frames, *[last] * 6]), record)


def compose(outside: np.ndarray, obs: Mapping[str, np.ndarray], policy: Policy, action: np.ndarray) -> np.ndarray:
    """Give the outside view (H, W, 3) with the policy's images in a column beside it, and its estimate in words.

    Args:
        outside: (H, W, 3) uint8.
        obs: of one row.
        policy: after it acted on `obs`.
        action: (1, action) that it chose.
    """
    picture = thoughts(outside, obs, policy)
    height = picture.shape[0]
    views = [picture_of(key, obs[key][0]) for key in policy.layout.images]
    if not views:
        return picture
    size = height // max(len(views), 2)
    column = np.zeros((height, size, 3), np.uint8)
    for k, image in enumerate(views):
        column[k * size : (k + 1) * size] = enlarged(image, size)
    return np.concatenate([picture, column], axis=1)


def thoughts(outside: np.ndarray, obs: Mapping[str, np.ndarray], policy: Policy) -> np.ndarray:
    """Give the outside view with where the policy thinks the tip to be in the goal's frame, and where it is, in words.

    Args:
        outside: (H, W, 3) uint8.
        obs: of one row.
        policy: after it acted on `obs`; nothing is written where it has no estimate.
    """
    picture, height = outside.copy(), outside.shape[0]
    if policy.estimate is not None and PRIVILEGED in obs:
        estimate, true = 1e3 * policy.estimate[0], 1e3 * OFFSET_M * obs[PRIVILEGED][0, ESTIMATE]
        write(picture, "thinks " + " ".join(f"{v:+6.1f}" for v in estimate) + " mm", (8, height - 22), WHITE)
        write(picture, "is     " + " ".join(f"{v:+6.1f}" for v in true) + " mm", (8, height - 8), WHITE)
    return picture


def enlarged(image: np.ndarray, size: int) -> np.ndarray:
    """(H, W, 3) -> (size, size, 3), each pixel a block."""
    rows = np.arange(size) * image.shape[0] // size
    columns = np.arange(size) * image.shape[1] // size
    return image[rows][:, columns]


def write(picture: np.ndarray, text: str, at: tuple[int, int], colour: tuple[int, int, int]) -> None:
    """Write a line of text into the picture, its lower left corner at (x, y)."""
    import cv2

    font = cv2.FONT_HERSHEY_PLAIN
    cv2.putText(picture, text, at, font, 0.9, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, text, at, font, 0.9, colour, 1, cv2.LINE_AA)
