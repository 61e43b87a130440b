"""Save an episode whose simulation diverged, so that it can be played again bit for bit (see `replay`)."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.files import new_folder
from vispeg.formats.format import Format
from vispeg.formats.guard import MB
from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.world_file import WorldFile, world_hash, world_text
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.world import World

FORMAT = "vispeg-episode/1"
SAVED = Format(FORMAT, "a saved episode", language="json", most=64 * MB)
WORLD, EPISODE = "world.yaml", "episode.json"


def leave(folder: Path, sim: TaskSimulation, row: int, world: World, file: WorldFile | None) -> Path:
    """Save a row's present episode in the folder FOLDER/SEED, and return that folder.

    `world.yaml` is a world file with the drawn values as fixed effects, and the task's settings. `episode.json` holds
    the seed, the observation mode, the stated start, push and disturbance if there were any, and all actions so far;
    the last one ended the episode.

    Args:
        folder: the parent folder of all saved episodes.
        sim: the simulation in its present state.
        row: of the episode.
        world: the values that the episode drew, of physics and looks.
        file: the world's file, for its cameras and renderer; or None.
    """
    push, start, torques, seed = sim.push[row], sim.starts[row], sim.disturbed[row], int(sim.seeds[row])
    task: dict[str, Any] = json.loads(json.dumps(asdict(sim.config)))
    cameras, renderer = (dict(file.cameras), dict(file.renderer)) if file is not None else ({}, {})
    digest = world_hash(world, task, cameras, renderer)
    record = {
        "format": FORMAT,
        "seed": seed,
        "obs_mode": sim.obs_mode,
        "engine": sim.engine,
        "push": None if push is None else {**asdict(push), "force": np.asarray(push.force).tolist()},
        "start": None if start is None else {"q": _numbers(start.q), "believed": _numbers(start.believed)},
        "disturbed": _numbers(torques),
        "actions": [action.tolist() for action in sim.acted[row]],
    }
    with new_folder(folder / str(seed), overwrite=True, holds=None) as place:
        fixed = RandomizedWorld(base=world)
        text = world_text(WorldFile(f"diverged-{seed}", fixed, task, cameras, renderer, digest, place / WORLD))
        (place / WORLD).write_text(text, encoding="utf-8")
        (place / EPISODE).write_text(json.dumps(record) + "\n", encoding="utf-8")
    return folder / str(seed)


def _numbers(values: np.ndarray | None) -> list[Any] | None:
    return None if values is None else np.asarray(values, float).tolist()
