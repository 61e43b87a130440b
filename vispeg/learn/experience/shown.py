"""Read demonstrations from a folder in LeRobot's layout into a replay, for imitation or reinforcement learning."""

from __future__ import annotations

from collections.abc import Callable, Container
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces

from vispeg.core.errors import UserError
from vispeg.datasets.layout import colour_of, depth_of, truth_of
from vispeg.datasets.read import Dataset
from vispeg.interface.actions import entries, split
from vispeg.interface.observer import BEYOND, DOF
from vispeg.interface.terms import POLICY, PRIVILEGED
from vispeg.learn.experience.replay import Replay
from vispeg.learn.experience.theirs import ACTION, EXECUTED, RATE, Theirs, finite
from vispeg.learn.layout import Layout
from vispeg.learn.meta import Origin, refuse_other_actions
from vispeg.learn.modalities import modality as modality_of
from vispeg.render.image_kinds import DEPTH, GOAL_TOLD, camera_of, kind_of
from vispeg.task.config import TaskConfig
from vispeg.task.interface import interface_in
from vispeg.task.registry import config_of
from vispeg.task.world_file import load_world, parts


def feature_of(key: str, features: Container[str]) -> str:
    """Return the dataset's feature for a key of our observations.

    Args:
        key: `depth_<camera>`, `rgb_<camera>`, `policy` or `privileged`.
        features: names of the dataset's features.
    """
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
    """Return the folder's successful episodes; all episodes where it does not record success.

    With `config`, a folder without `observation.policy`, or one with `?action=KIND`, is read by `Theirs`. Others must
    then have actions of the task's meaning, as far as their names, frame rate and world tell it.

    Args:
        folder: a LeRobotDataset's folder, followed by `?action=KIND` where its actions are not offsets and their names
            do not tell their kind.
        modality: name of the learning policy's modality; not one that is told the goal's place.
        layout: the policy's layout; images must have its sizes.
        seed: seed of later draws from the replay.
        device: torch device of the batches, that of the learning network.
        beside: None for imitation: actions are the intended ones (`action`), rewards are 0. For reinforcement
            learning, the observation space of the run's own replay: the folder must then hold all its parts and the
            rewards, and actions are those executed (`executed.action`), where the folder has them. An episode's last
            action is left out where the folder does not record success.
        config: the settings of the policy's task.
        say: called with a line if actions exceed what the controller accepts; they are clipped to +-1.

    Raises:
        UserError: not such a folder, no episode succeeded, a feature is missing, a number is not finite, an observation
            or action has another shape, an action or (beside a run's own) a reward another meaning, or the policy is
            told the goal's place.
    """
    if modality_of(modality).obs_mode in GOAL_TOLD:
        expected = "a policy that is not told where the goal is"
        raise UserError("does not hold what such a policy observes", file=folder, expected=expected, got=modality)
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
    rewards = ["next.reward"] if beside is not None else []
    converted = theirs.features if theirs is not None else []  # features from which `policy` and actions are made
    data = Dataset(place, [*names.values(), act, *rewards, *converted], theirs=True)
    if config is not None and theirs is None:
        _refuse_another_task(index, folder, config, act, beside is not None)
    numbers = successes(index)
    if not numbers:
        raise UserError("no episode of the dataset succeeded", file=place, got=f"{len(index.episodes)} that did not")

    def read(number: int) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
        """Return the observations in an episode's frames, the actions, and the rewards."""
        episode = data.episode(number)
        seen, action = {key: _channels_first(key, episode[name]) for key, name in names.items()}, episode[act]
        if theirs is not None:
            seen[POLICY], meant = theirs.read(number, episode)
            action = meant if act == ACTION else action
        reward = np.asarray(episode["next.reward"] if rewards else np.zeros(len(action)), np.float32)
        action = action.reshape(len(action), -1)
        vectors = {names.get(key, key): seen[key] for key in keys if kind_of(key) is None}
        for name, value in (vectors | {act: action, "next.reward": reward.reshape(-1, 1)}).items():
            finite(value, name, index.folder, number)
        return {key: seen[key] for key in keys}, action, reward

    first, acted, _ = read(numbers[0])
    boxes: dict[str, spaces.Space] = {key: _box(key, first[key]) for key in keys}
    for key, shape in wanted.items():
        if boxes[key].shape != shape:
            raise UserError("made for another observation", file=place, key=key, expected=shape, got=boxes[key].shape)
    if acted.shape[-1] != layout.action:
        got = acted.shape[-1]
        raise UserError("actions of another length", file=place, key=act, expected=layout.action, got=got)
    box = spaces.Box(-1, 1, (layout.action,), np.float32)
    frames = sum(int(data.episodes[number]["length"]) for number in numbers)
    ring = Replay(frames + len(numbers) + 1, spaces.Dict(boxes), box, device, seed=seed)
    clipped, success_known = 0, index.successes is not None
    for number in numbers:
        observations, actions, reward = read(number)
        # A folder has no frame after an episode's last action. Imitation needs none, nor does a success, after which no
        # reward follows. Where success is not recorded, time may have ended the episode: its value goes on from the
        # last frame.
        steps = len(actions) - (beside is not None and not success_known)
        clipped += int((np.abs(actions) > 1 + BEYOND).any(axis=1).sum())
        for t in range(steps):
            last, after = t == steps - 1, min(t + 1, len(actions) - 1)
            ring.add(
                {key: value[t : t + 1] for key, value in observations.items()},
                {key: value[after : after + 1] for key, value in observations.items()},
                np.clip(actions[t : t + 1], -1, 1),
                reward[t : t + 1],
                np.array([last]),
                [{"TimeLimit.truncated": not success_known}],
            )
    if clipped:
        say(f"{clipped} of {frames} actions asked for more than the controller takes")
    return ring


def _refuse_another_task(data: Dataset, folder: str | Path, config: TaskConfig, act: str, rewarded: bool) -> None:
    """Raise UserError where the data set's actions, or the rewards if they are read, do not mean what the task's do.

    Args:
        data: of the folder.
        folder: as `from_folder` takes it.
        config: settings of the task.
        act: the feature of the actions.
        rewarded: whether rewards are compared.
    """
    task = asdict(config)
    stated: dict[str, Any] = {**made_in(folder).get("task", {})}
    named = entries(data.info["features"][act]["names"])
    if set(named) <= set(DOF) and named:
        stated["dof"] = named
    if abs(data.info["fps"] * config.policy_period - 1) > RATE:
        stated["policy_period"] = 1 / data.info["fps"]
    refuse_other_actions("was recorded with other actions", task, stated, data.folder)
    if rewarded and "reward" in stated:
        theirs, own = ((config.rewards.of(t["reward"]), t["reward_scale"]) for t in (stated, task))
        if theirs != own:
            expected, got = ((t["reward"], t["reward_scale"]) for t in (task, stated))
            raise UserError("was recorded with other rewards", file=data.folder, expected=expected, got=got)


def successes(data: Dataset) -> list[int]:
    """Return the numbers of the episodes that succeeded; all of them where the data set does not record success."""
    ended = data.successes
    return [number for number in range(len(data.episodes)) if ended is None or ended[number]]


def made_in(folder: str | Path) -> Origin:
    """Return the dataset's world in the form of a policy's record; its entries are None where they are unknown.

    The parts and the task of a world are known while its file is as it was.
    """
    plan = Dataset(split(str(folder))[0], theirs=True).made.get("plan") or {}
    world, known = plan.get("world"), plan.get("world_hash")
    origin: Origin = {"world": world, "world_hash": known}
    if world:
        with suppress(UserError):  # the file is elsewhere, or no world any more
            file = load_world(world)
            if file.hash == known:
                origin |= {"world_parts": parts(world), "task": asdict(config_of(file.task, str(file.path)))}
    return origin


def _channels_first(key: str, value: np.ndarray) -> np.ndarray:
    """Return images (T, H, W[, C]) as (T, C, H, W), and other values as vectors (T, n)."""
    if kind_of(key) is None:
        return value.reshape(len(value), -1)
    return value[:, None] if value.ndim == 3 else np.moveaxis(value, -1, 1)


def _box(key: str, value: np.ndarray) -> spaces.Box:
    kind = kind_of(key)
    if kind is not None and not kind.gaps:
        return spaces.Box(0, kind.high, value.shape[1:], kind.dtype)
    return spaces.Box(-np.inf, np.inf, value.shape[1:], np.float32)
