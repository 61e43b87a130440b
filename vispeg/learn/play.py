"""Play a policy's episodes as video frames: the cell, the policy's images, and its estimate of the tip's position."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.interface.terms import PRIVILEGED
from vispeg.learn.layout import ESTIMATE, OFFSET_M
from vispeg.render.image_kinds import picture_of

if TYPE_CHECKING:
    from vispeg.learn.policy import Policy

WHITE, GREEN, RED = (255, 255, 255), (90, 220, 120), (255, 110, 90)
HELD = 6  # frames for which the last one, with the category of the end, is shown


@dataclass(frozen=True)
class Played:
    """One episode: its seed, its frames (T, H, W, 3) uint8, and the environment's info at its end."""

    seed: int
    frames: np.ndarray
    record: Mapping[str, Any]


def play(policy: Policy, env: Any, seeds: list[int]) -> Iterator[Played]:
    """Play one episode per seed; yield each with its frames, the last of which is repeated.

    Args:
        policy: the policy to play.
        env: a vector environment of one row with `render_mode="rgb_array"` and without autoreset.
        seeds: seeds of the episodes.
    """
    from vispeg.learn.infos import row_info

    for seed in seeds:
        obs, _ = env.reset(seed=[seed])
        policy.reset(1)
        frames, over, info = [], False, {}
        while not over:
            action = policy.act(obs)
            frames.append(compose(env.render()[0], obs, policy))
            obs, _, terminated, truncated, info = env.step(action)
            over = bool(terminated[0] or truncated[0])
        record = row_info(info, 0)
        policy.act(obs)  # for the estimate in the last frame
        last = compose(env.render()[0], obs, policy)
        write(last, str(record.get("category", "")), (8, 20), GREEN if record.get("success") else RED)
        yield Played(seed, np.stack([*frames, *[last] * HELD]), record)


def compose(outside: np.ndarray, obs: Mapping[str, np.ndarray], policy: Policy) -> np.ndarray:
    """Return the outside view with the policy's estimate written on it and its images in a column to the right.

    Args:
        outside: the outside view, (H, W, 3) uint8.
        obs: observation of one row, arrays (1, ...).
        policy: the policy, after it acted on `obs`.
    """
    picture = with_estimate(outside, obs, policy)
    height = picture.shape[0]
    views = [picture_of(key, obs[key][0]) for key in policy.layout.images]
    if not views:
        return picture
    size = height // max(len(views), 2)  # a single image has half the height
    column = np.zeros((height, size, 3), np.uint8)
    for k, image in enumerate(views):
        column[k * size : (k + 1) * size] = enlarged(image, size)
    return np.concatenate([picture, column], axis=1)


def with_estimate(outside: np.ndarray, obs: Mapping[str, np.ndarray], policy: Policy) -> np.ndarray:
    """Return a copy of the outside view with `positions` written on it; arguments as for `compose`."""
    picture = outside.copy()
    for k, line in enumerate(positions(obs, policy)[::-1]):
        write(picture, line, (8, outside.shape[0] - 8 - 14 * k), WHITE)
    return picture


def positions(obs: Mapping[str, np.ndarray], policy: Policy) -> list[str]:
    """Return two lines of text, the tip's estimated and true position in the goal's frame, in mm.

    The list is empty if the policy has no estimate, or if the observation lacks the truth.
    """
    if policy.estimate is None or PRIVILEGED not in obs:
        return []
    estimate, true = 1e3 * policy.estimate[0], 1e3 * OFFSET_M * obs[PRIVILEGED][0, ESTIMATE]
    both = {"thinks ": estimate, "is     ": true}
    return [head + " ".join(f"{v:+6.1f}" for v in place) + " mm" for head, place in both.items()]


def enlarged(image: np.ndarray, size: int) -> np.ndarray:
    """Return an image (H, W, 3) resized to (size, size, 3) by repeating or leaving out pixels."""
    rows = np.arange(size) * image.shape[0] // size
    columns = np.arange(size) * image.shape[1] // size
    return image[rows][:, columns]


def write(picture: np.ndarray, text: str, at: tuple[int, int], colour: tuple[int, int, int]) -> None:
    """Write a line of text into the picture, its lower left corner at pixel (x, y)."""
    import cv2

    font = cv2.FONT_HERSHEY_PLAIN
    cv2.putText(picture, text, at, font, 0.9, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, text, at, font, 0.9, colour, 1, cv2.LINE_AA)
