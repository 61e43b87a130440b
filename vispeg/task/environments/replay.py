"""Play an episode again that diverged and that `divergence.leave` saved."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field, field_validator

from vispeg.core.errors import UserError
from vispeg.formats.format import enrol
from vispeg.formats.typed import typed
from vispeg.task.environments.divergence import EPISODE, FORMAT, LEFT, WORLD
from vispeg.task.environments.simulation import Push
from vispeg.task.environments.vector import TaskVec
from vispeg.task.world_file import load_world, world_text


class _Pushed(BaseModel):
    force: Annotated[list[float], Field(min_length=3, max_length=3)]
    start: float
    duration: float


class _Told(BaseModel):
    seed: Annotated[int, Field(ge=0)]
    obs_mode: str
    engine: str = "c"
    push: _Pushed | None = None
    actions: Annotated[list[list[float]], Field(min_length=1)]

    @field_validator("actions")
    @classmethod
    def _even(cls, actions: list[list[float]]) -> list[list[float]]:
        if len({len(action) for action in actions}) > 1:
            raise ValueError("actions of different lengths")
        return actions


def _example(folder: Path) -> Path:
    push = {"force": [20.0, 0.0, 0.0], "start": 0.5, "duration": 0.2}
    record = {"format": FORMAT, "seed": 7, "obs_mode": "state", "push": push, "actions": [[0.1, 0.0, -0.5]] * 3}
    (folder / EPISODE).write_text(json.dumps(record), encoding="utf-8")
    (folder / WORLD).write_text(world_text(load_world("nominal")), encoding="utf-8")
    return folder


@enrol(FORMAT, _example, slow=True)
def replay(folder: str | Path) -> tuple[TaskVec, np.ndarray]:
    """Play a saved episode again, up to just before the step that ended it.

    Returns:
        The environment, with one row, and the last action (1, d): `env.step(action)` repeats the divergence.

    Raises:
        UserError: the folder holds no saved episode, or its actions do not fit the world's task.
    """
    path = Path(folder) / EPISODE
    record = typed(_Told, LEFT.read(path), path)
    env = TaskVec(1, Path(folder) / WORLD, record.obs_mode, autoreset_mode="Disabled", engine=record.engine)
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
