"""What an episode leaves behind whose simulation stopped being finite: enough to play it again, bit for bit."""

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
LEFT = Format(FORMAT, "an episode that was left behind", language="json", most=64 * MB)
WORLD, EPISODE = "world.yaml", "episode.json"


def leave(folder: Path, sim: TaskSimulation, row: int, world: World, file: WorldFile | None) -> Path:
    """Write FOLDER/SEED with the row's present episode; return it.

    `world.yaml` is a world file in which nothing is drawn any more, with the task as it was; `episode.json` holds seed,
    observation mode, the push if there was one, and the actions so far, the last being the one that ended it.

    Args:
        folder: of all episodes that are left behind.
        sim: as it stands.
        row: of the episode.
        world: what that episode drew, of physics and looks.
        file: that the world comes from, or None.
    """
    push, seed = sim.push[row], int(sim.seeds[row])
    task: dict[str, Any] = json.loads(json.dumps(asdict(sim.config)))
    cameras, renderer = (dict(file.cameras), dict(file.renderer)) if file is not None else ({}, {})
    digest = world_hash(world, task, cameras, renderer)
    record = {
        "format": FORMAT,
        "seed": seed,
        "obs_mode": sim.obs_mode,
        "push": None if push is None else {**asdict(push), "force": np.asarray(push.force).tolist()},
        "actions": [action.tolist() for action in sim.acted[row]],
    }
    with new_folder(folder / str(seed), overwrite=True, holds=None) as place:
        fixed = RandomizedWorld(base=world)
        text = world_text(WorldFile(f"diverged-{seed}", fixed, task, cameras, renderer, digest, place / WORLD))
        (place / WORLD).write_text(text, encoding="utf-8")
        (place / EPISODE).write_text(json.dumps(record) + "\n", encoding="utf-8")
    return folder / str(seed)
