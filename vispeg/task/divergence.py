"""What an episode leaves behind whose simulation stopped being finite: enough to play it again, bit for bit."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.task.push import Push
from vispeg.task.world_file import WorldFile, world_hash, world_text

if TYPE_CHECKING:
    from vispeg.task.vector import PegInHoleVec

FORMAT = "vispeg-episode/1"
WORLD, EPISODE = "world.yaml", "episode.json"


def leave(folder: Path, env: PegInHoleVec, row: int) -> Path:
    """Writes FOLDER/SEED with the row's present episode; returns it.

    `world.yaml` is a world file in which nothing is drawn any more, with the task as it was; `episode.json` holds seed,
    observation mode, the push if there was one, and the actions so far, the last being the one that ended it.
    """
    sim, file = env.sim, env.file
    push, seed = sim.push[row], int(sim.seeds[row])
    task: dict[str, Any] = json.loads(json.dumps(asdict(env.config))) | {"start_radius": float(sim.radius)}
    cameras, renderer = (dict(file.cameras), dict(file.renderer)) if file is not None else ({}, {})
    world, digest = sim.drawn[row], world_hash(sim.drawn[row], task, cameras, renderer)
    told = {
        "format": FORMAT,
        "seed": seed,
        "obs_mode": env.obs_mode,
        "push": None if push is None else {**asdict(push), "force": np.asarray(push.force).tolist()},
        "actions": [action.tolist() for action in sim.acted[row]],
    }
    with new_folder(folder / str(seed), overwrite=True, holds=None) as place:
        text = world_text(WorldFile(f"diverged-{seed}", world, task, cameras, renderer, digest, place / WORLD))
        (place / WORLD).write_text(text, encoding="utf-8")
        (place / EPISODE).write_text(json.dumps(told) + "\n", encoding="utf-8")
    return folder / str(seed)


def replay(folder: str | Path) -> tuple[PegInHoleVec, np.ndarray]:
    """The episode again, up to just before the step that ended it.

    Returns:
        The environment, of one row, and the last action (1, d): `env.step` of it does what was seen.

    Raises:
        UserError: the folder holds no such episode.
    """
    from vispeg.task.vector import PegInHoleVec

    path = Path(folder) / EPISODE
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        if told["format"] != FORMAT:
            raise UserError("another format", file=path, key="format", expected=FORMAT, got=told["format"])
        actions = np.asarray(told["actions"], float)[:, None]
        seed, mode, push = int(told["seed"]), str(told["obs_mode"]), told["push"]
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise UserError("not an episode that was left behind", file=path) from error
    env = PegInHoleVec(1, Path(folder) / WORLD, mode, autoreset_mode="Disabled")
    env.reset(seed=[seed])
    if push is not None:
        env.sim.push[0] = Push(np.asarray(push["force"], float), push["start"], push["duration"])
    for action in actions[:-1]:
        env.step(action)
    return env, np.asarray(actions[-1])
