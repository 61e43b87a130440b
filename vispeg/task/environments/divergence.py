"""What an episode leaves behind whose simulation stopped being finite: enough to play it again, bit for bit."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BaseModel, Field, field_validator

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.formats.format import Format, enrol
from vispeg.formats.guard import MB
from vispeg.formats.typed import typed
from vispeg.task.push import Push
from vispeg.task.world_file import WorldFile, load_world, world_hash, world_text
from vispeg.worlds.randomized import RandomizedWorld

if TYPE_CHECKING:
    from vispeg.task.environments.vector import TaskVec

FORMAT = "vispeg-episode/1"
LEFT = Format(FORMAT, "an episode that was left behind", language="json", most=64 * MB)
WORLD, EPISODE = "world.yaml", "episode.json"


class _Pushed(BaseModel):
    force: Annotated[list[float], Field(min_length=3, max_length=3)]
    start: float
    duration: float


class _Told(BaseModel):
    seed: Annotated[int, Field(ge=0)]
    obs_mode: str
    push: _Pushed | None = None
    actions: Annotated[list[list[float]], Field(min_length=1)]

    @field_validator("actions")
    @classmethod
    def _even(cls, actions: list[list[float]]) -> list[list[float]]:
        if len({len(action) for action in actions}) > 1:
            raise ValueError("actions of different lengths")
        return actions


def leave(folder: Path, env: TaskVec, row: int) -> Path:
    """Writes FOLDER/SEED with the row's present episode; returns it.

    `world.yaml` is a world file in which nothing is drawn any more, with the task as it was; `episode.json` holds seed,
    observation mode, the push if there was one, and the actions so far, the last being the one that ended it.
    """
    sim, file = env.sim, env.file
    push, seed = sim.push[row], int(sim.seeds[row])
    task: dict[str, Any] = json.loads(json.dumps(asdict(env.config))) | {"start_radius": float(sim.radius)}
    cameras, renderer = (dict(file.cameras), dict(file.renderer)) if file is not None else ({}, {})
    world = env.drawn(row)
    digest = world_hash(world, task, cameras, renderer)
    record = {
        "format": FORMAT,
        "seed": seed,
        "obs_mode": env.obs_mode,
        "push": None if push is None else {**asdict(push), "force": np.asarray(push.force).tolist()},
        "actions": [action.tolist() for action in sim.acted[row]],
    }
    with new_folder(folder / str(seed), overwrite=True, holds=None) as place:
        fixed = RandomizedWorld(base=world)
        text = world_text(WorldFile(f"diverged-{seed}", fixed, task, cameras, renderer, digest, place / WORLD))
        (place / WORLD).write_text(text, encoding="utf-8")
        (place / EPISODE).write_text(json.dumps(record) + "\n", encoding="utf-8")
    return folder / str(seed)


def _example(folder: Path) -> Path:
    push = {"force": [20.0, 0.0, 0.0], "start": 0.5, "duration": 0.2}
    record = {"format": FORMAT, "seed": 7, "obs_mode": "state", "push": push, "actions": [[0.1, 0.0, -0.5]] * 3}
    (folder / EPISODE).write_text(json.dumps(record), encoding="utf-8")
    (folder / WORLD).write_text(world_text(load_world("nominal")), encoding="utf-8")
    return folder


@enrol(FORMAT, _example, slow=True)
def replay(folder: str | Path) -> tuple[TaskVec, np.ndarray]:
    """The episode again, up to just before the step that ended it.

    Returns:
        The environment, of one row, and the last action (1, d): `env.step` of it does what was seen.

    Raises:
        UserError: the folder holds no such episode.
    """
    from vispeg.task.environments.vector import TaskVec

    path = Path(folder) / EPISODE
    record = typed(_Told, LEFT.read(path), path)
    env = TaskVec(1, Path(folder) / WORLD, record.obs_mode, autoreset_mode="Disabled")
    actions = np.asarray(record.actions, float)[:, None]
    if actions.shape[2] != len(env.config.dof):
        expected = f"{len(env.config.dof)} numbers each, as the world's task says"
        raise UserError("actions of another task", file=path, key="actions", expected=expected, got=actions.shape[2])
    env.reset(seed=[record.seed])
    if record.push is not None:
        env.sim.push[0] = Push(np.asarray(record.push.force, float), record.push.start, record.push.duration)
    for action in actions[:-1]:
        env.step(action)
    return env, np.asarray(actions[-1])
