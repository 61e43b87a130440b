"""Demonstrations from a folder in LeRobot's layout, as a replay to imitate or to reinforce from."""

from __future__ import annotations

from collections.abc import Callable, Container
from pathlib import Path

import numpy as np
import torch
from gymnasium import spaces

from vispeg.core.errors import UserError
from vispeg.datasets.layout import colour_of, depth_of, truth_of
from vispeg.datasets.read import Dataset
from vispeg.interface.actions import split
from vispeg.interface.observer import BEYOND
from vispeg.learn.experience.replay import Replay
from vispeg.learn.experience.theirs import ACTION, EXECUTED, Theirs
from vispeg.learn.layout import PRIVILEGED, Layout
from vispeg.learn.meta import Origin
from vispeg.learn.modalities import modality as modality_of
from vispeg.render.image_kinds import DEPTH, GOAL_TOLD, camera_of, kind_of
from vispeg.task.config import TaskConfig
from vispeg.task.interface import interface_in
from vispeg.task.terms import POLICY


def feature_of(key: str, features: Container[str]) -> str:
    """Give the feature that holds `depth_<camera>`, `rgb_<camera>`, `policy` or `privileged` of our observations."""
    if key == PRIVILEGED:
        return truth_of(features)
    kind = kind_of(key)
    if kind is None:
        return f"observation.{key}"
    return depth_of(camera_of(key), features) if kind is DEPTH else colour_of(camera_of(key))


def from_folder(
    folder: str | Path,
    modality: str,
    layout: Layout,
    seed: int,
    device: torch.device | str = "cpu",
    beside: spaces.Dict | None = None,
    config: TaskConfig | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Replay:
    """Give the folder's successful episodes; all of them where it does not say which succeeded.

    A folder without `observation.policy`, or one whose kind of actions is stated, is read as `Theirs` does.

    Args:
        folder: of a LeRobotDataset, with `?action=KIND` behind it where its actions are no offsets and do not say so.
        modality: of the policy that learns from it; not one that knows the goal.
        layout: what the policy sees; images must have its sizes.
        seed: of later draws from the replay.
        device: where batches go: the learning network's.
        beside: observation space of the replay beside which this one is reinforced from. Then all of that must be
            there, and rewards; an action is the one that was executed, in place of the one that was meant (`action`).
        config: of the policy's task.
        say: called where actions ask for more than the controller takes.

    Raises:
        UserError: not such a folder, no episode succeeded, a feature is missing, an observation or action of another
            shape, or a policy that would see something else than the folder holds.
    """
    if modality_of(modality).obs_mode in GOAL_TOLD:
        expected = "a policy that is not told where the goal is"
        raise UserError("a dataset shows what such a policy does not see", file=folder, expected=expected, got=modality)
    place, kind = split(str(folder))
    index = Dataset(place, theirs=True)
    theirs = None
    if config is not None and (kind is not None or feature_of(POLICY, ()) not in index.features):
        theirs = Theirs(index, interface_in(config, None, "proprio", modality=modality), kind)
    wanted = layout.shapes if beside is None else {key: box.shape or () for key, box in beside.spaces.items()}
    has_truth = truth_of(index.features) in index.features
    keys = list(wanted) if PRIVILEGED in wanted or not has_truth else [*wanted, PRIVILEGED]
    names = {key: feature_of(key, index.features) for key in keys if theirs is None or key != POLICY}
    act = EXECUTED if beside is not None and EXECUTED in index.features else ACTION
    gains = ["next.reward"] if beside is not None else []
    read_too = theirs.features if theirs is not None else []
    data = Dataset(place, [*names.values(), act, *gains, *read_too], theirs=True)
    numbers = successes(index)
    if not numbers:
        raise UserError("no episode of the dataset succeeded", file=place, got=f"{len(index.episodes)} that did not")

    def read(number: int) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
        """Return the observations in an episode's frames, the actions, and the rewards."""
        episode = data.episode(number)
        seen, action = {key: _channels_first(key, episode[name]) for key, name in names.items()}, episode[act]
        if theirs is not None:
            seen[POLICY], meant = theirs.read(episode)
            action = meant if act == ACTION else action
        gain = np.asarray(episode["next.reward"] if gains else np.zeros(len(action)), np.float32)
        return {key: seen[key] for key in keys}, action.reshape(len(action), -1), gain

    first, acted, _ = read(numbers[0])
    boxes: dict[str, spaces.Space] = {key: _box(key, first[key]) for key in keys}
    for key, shape in wanted.items():
        if boxes[key].shape != shape:
            raise UserError("made for another observation", file=place, key=key, expected=shape, got=boxes[key].shape)
    if acted.shape[-1] != layout.action:
        raise UserError("another action", file=place, key=act, expected=layout.action, got=acted.shape[-1])
    box = spaces.Box(-1, 1, (layout.action,), np.float32)
    frames = sum(int(data.episodes[number]["length"]) for number in numbers)
    ring = Replay(frames + len(numbers) + 1, spaces.Dict(boxes), box, device, seed=seed)
    clipped = 0
    for number in numbers:
        observations, actions, gain = read(number)
        steps = len(actions)
        clipped += int((np.abs(actions) > 1 + BEYOND).any(axis=1).sum())
        for t in range(steps):
            # A dataset has no frame after its last action; the last one stands for it, and no value is read from it.
            last, after = t == steps - 1, min(t + 1, steps - 1)
            ring.add(
                {key: value[t : t + 1] for key, value in observations.items()},
                {key: value[after : after + 1] for key, value in observations.items()},
                np.clip(actions[t : t + 1], -1, 1),
                gain[t : t + 1],
                np.array([last]),
                [{}],
            )
    if clipped:
        say(f"{clipped} of {frames} actions asked for more than the controller takes")
    return ring


def successes(data: Dataset) -> list[int]:
    """Give the numbers of the episodes that succeeded; all where the data set does not say."""
    ended = data.successes
    return [number for number in range(len(data.episodes)) if ended is None or ended[number]]


def made_in(folder: str | Path) -> Origin:
    """Give the dataset's world as a policy's record has it; empty entries where the dataset does not say."""
    plan = Dataset(split(str(folder))[0], theirs=True).made.get("plan") or {}
    return {"world": plan.get("world"), "world_hash": plan.get("world_hash")}


def _channels_first(key: str, value: np.ndarray) -> np.ndarray:
    """Images (T, H, W[, C]) -> (T, C, H, W); vectors (T, n), a lone number being one of them."""
    if kind_of(key) is None:
        return value.reshape(len(value), -1)
    return value[:, None] if value.ndim == 3 else np.moveaxis(value, -1, 1)


def _box(key: str, value: np.ndarray) -> spaces.Box:
    kind = kind_of(key)
    if kind is not None and not kind.gaps:
        return spaces.Box(0, kind.high, value.shape[1:], kind.dtype)
    return spaces.Box(-np.inf, np.inf, value.shape[1:], np.float32)
