"""The same states seen by the cameras of several worlds: one simulation, and a camera rig a world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np

from vispeg.core.seeds import stream
from vispeg.learn.experience.replay import Replay
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.teacher import teacher_of
from vispeg.task.environments.vector import TaskVec
from vispeg.task.eyes import rig_of
from vispeg.task.world_file import load_world

MODE = "rgbd"
NEW_LOOK = 8  # steps after which a row is seen in another look, so that few states are seen in many


def pictured(worlds: Mapping[str, str], teacher: str, seed: int, rows: int, steps: int, noise: float = 0.3) -> dict:
    """Return a disturbed teacher's states, with its own actions as labels, as every world's cameras see them.

    Args:
        worlds: name -> world; the first one's physics is played.
        teacher: a state policy.
        seed: of episodes, looks and disturbances. Effects of the same label draw alike in all worlds.
        rows: cells side by side.
        steps: policy steps of every row.
        noise: standard deviation of what is added to the executed actions, which are within +-1.

    Returns:
        Name -> Replay of `rows` environments: observations alike but for their pictures, and the teacher's actions.
    """
    names = list(worlds)
    vec = TaskVec(rows, worlds[names[0]], MODE, autoreset_mode="Disabled", privileged=True)
    vec.further = [_rig(vec, worlds[name]) for name in names[1:]]
    env, rng = Sb3Env(vec), stream(seed, "states")
    knows = teacher_of(teacher, vec.config)
    spaces = env.observation_space, env.action_space
    rings = {name: Replay(rows * (2 * steps + 2), *spaces, n_envs=rows, seed=seed) for name in names}
    env.seed(seed)
    env.reset()
    obs = _new_looks(vec, rng)
    knows.reset(rows)
    for step in range(steps):
        if step and step % NEW_LOOK == 0:
            obs = _new_looks(vec, rng)
        label = np.clip(np.asarray(knows.act(obs), np.float32), -1, 1)
        action = np.clip(label + noise * rng.standard_normal(label.shape), -1, 1).astype(np.float32)
        after, reward, done, infos = env.step(action)
        for k, ring in enumerate(rings.values()):
            now = _of(obs, k)
            ring.add(now, now, label, reward, done, infos)  # what comes after is not imitated
        obs = cast("dict[str, np.ndarray]", after)
        if done.any():
            knows.reset(rows, done)
    for ring in rings.values():
        ring.cut()
    env.close()
    return rings


def _rig(vec: TaskVec, world: str):
    file = load_world(world)
    return rig_of(vec.sim.scene, vec.config, file.world, MODE, vec.num_envs, file=file, backend=vec.eyes.backend)


def _new_looks(vec: TaskVec, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return the present observations of all rows in new looks, drawn alike in every world."""
    snapshots = vec._snapshots(range(vec.num_envs))
    seeds = {row: int(rng.integers(2**31)) for row in snapshots}
    for rig in (vec.eyes, *vec.further):
        rig.begin(snapshots, seeds, vec.sim.levels)
        rig.look(snapshots)
    return vec._observe()


def _of(obs: Mapping[str, np.ndarray], k: int) -> dict[str, np.ndarray]:
    """Return the observation as the k-th world's cameras have it."""
    return {key: obs.get(f"{key}@{k}", value) for key, value in obs.items() if "@" not in key}
