"""Demonstrations from a folder in LeRobot's layout, as a replay to imitate or to reinforce from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from vispeg.core.errors import UserError
from vispeg.learn.layout import PRIVILEGED, Layout
from vispeg.learn.replay import Replay

TRUTH = "observation.environment_state"  # LeRobot's name for what only a simulation knows


def feature_of(key: str) -> str:
    """The feature that holds a part of our observation: `depth_<camera>`, `rgb_<camera>`, `policy`, `privileged`."""
    if key == PRIVILEGED:
        return TRUTH
    if key.startswith("depth_"):
        return f"observation.images.{key.removeprefix('depth_')}_depth"
    return f"observation.images.{key.removeprefix('rgb_')}" if key.startswith("rgb_") else f"observation.{key}"


def from_folder(
    folder: str | Path, layout: Layout, seed: int, executed: bool = False, device: torch.device | str = "cpu"
) -> Replay:
    """Every episode of the folder.

    Args:
        folder: of a LeRobotDataset v3.0.
        layout: what the policy sees; images must have its sizes.
        seed: of later draws from the replay.
        executed: whether the action that was executed counts, in place of the one that was meant (`action`).
        device: where batches go: the learning network's.

    Raises:
        UserError: not such a folder, a feature is missing, or an observation or action of another shape.
    """
    from gymnasium import spaces

    from vispeg.datasets.read import Dataset

    known = Dataset(folder).features
    keys = [*layout.keys, *([PRIVILEGED] if TRUTH in known else [])]
    act = "executed.action" if executed and "executed.action" in known else "action"
    ends = [name for name in ("next.reward", "next.done") if name in known]
    data = Dataset(folder, [feature_of(key) for key in keys] + [act, *ends])
    first = data.episode(0)
    boxes: dict[str, Any] = {key: _box(key, _channels_first(key, first[feature_of(key)])) for key in keys}
    for key, shape in layout.shapes.items():
        if boxes[key].shape != shape:
            raise UserError("made for another observation", file=folder, key=key, expected=shape, got=boxes[key].shape)
    if first[act].shape[-1] != layout.action:
        raise UserError("another action", file=folder, key=act, expected=layout.action, got=first[act].shape[-1])
    count = len(data.episodes)
    box = spaces.Box(-1, 1, (layout.action,), np.float32)
    ring = Replay(len(data) + count + 1, spaces.Dict(boxes), box, device, seed=seed)
    for number in range(count):
        one = data.episode(number)
        seen = {key: _channels_first(key, one[feature_of(key)]) for key in keys}
        steps = len(one[act])
        for t in range(steps):
            # A dataset has no frame after its last action; the last one stands for it, and no value is read from it.
            last, after = t == steps - 1, min(t + 1, steps - 1)
            ring.add(
                {key: value[t : t + 1] for key, value in seen.items()},
                {key: value[after : after + 1] for key, value in seen.items()},
                np.clip(one[act][t : t + 1], -1, 1),
                np.asarray(one["next.reward"][t : t + 1] if "next.reward" in one else [0.0], np.float32),
                np.array([last]),
                [{}],
            )
    return ring


def _channels_first(key: str, value: np.ndarray) -> np.ndarray:
    """Images (T, H, W[, C]) -> (T, C, H, W); vectors as they are."""
    if not key.startswith(("depth_", "rgb_")):
        return value
    return value[:, None] if value.ndim == 3 else np.moveaxis(value, -1, 1)


def _box(key: str, value: np.ndarray) -> Any:
    from gymnasium import spaces

    if key.startswith("rgb_"):
        return spaces.Box(0, 255, value.shape[1:], np.uint8)
    return spaces.Box(-np.inf, np.inf, value.shape[1:], np.float32)
