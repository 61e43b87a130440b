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
from vispeg.task.environments.divergence import EPISODE, FORMAT, SAVED, WORLD
from vispeg.task.environments.simulation import Push
from vispeg.task.environments.vector import TaskVec
from vispeg.task.start import Start
from vispeg.task.world_file import load_world, world_text


class _Push(BaseModel):
    force: Annotated[list[float], Field(min_length=3, max_length=3)]
    start: float
    duration: float


class _Start(BaseModel):
    q: list[float] | None = None
    believed: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None


class _Episode(BaseModel):
    seed: Annotated[int, Field(ge=0)]
    obs_mode: str
    engine: str = "c"
    push: _Push | None = None
    start: _Start | None = None
    disturbed: Annotated[list[list[float]], Field(min_length=1)] | None = None
    actions: Annotated[list[list[float]], Field(min_length=1)]

    @field_validator("actions", "disturbed")
    @classmethod
    def _equally_long(cls, rows: list[list[float]] | None) -> list[list[float]] | None:
        if len({len(row) for row in rows or ()}) > 1:
            raise ValueError("rows of different lengths")
        return rows


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
    record = typed(_Episode, SAVED.read(path), path)
    env = TaskVec(1, Path(folder) / WORLD, record.obs_mode, autoreset_mode="Disabled", engine=record.engine)
    for key, rows, size in (
        ("actions", record.actions, len(env.config.dof)),
        ("disturbed", record.disturbed, len(env.sim.scene.joints)),
    ):
        if rows and len(rows[0]) != size:
            expected = f"{size} numbers each, as the world's task and robot say"
            raise UserError(f"{key} of another task", file=path, key=key, expected=expected, got=len(rows[0]))
    actions = np.asarray(record.actions, float)[:, None]
    start = None if record.start is None else Start(q=_array(record.start.q), believed=_array(record.start.believed))
    env.reset(seed=[record.seed], options={"start": start})
    if record.disturbed is not None:
        env.disturb(0, np.asarray(record.disturbed))
    if record.push is not None:
        env.sim.push[0] = Push(np.asarray(record.push.force, float), record.push.start, record.push.duration)
    for action in actions[:-1]:
        env.step(action)
    return env, np.asarray(actions[-1])


def _array(values: list[float] | None) -> np.ndarray | None:
    return None if values is None else np.asarray(values, float)
