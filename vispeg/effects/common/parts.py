"""The cell's parts that can touch, and their collision shapes in a compiled model.

For two touching shapes of equal priority, MuJoCo takes the greater friction of the two and the mean of their solver
parameters. If one has a higher priority, its values alone count (MuJoCo 4.0 manual, Modeling, Contact parameters). In
the cell that is the held part, or a free object. So a contact effect at the held part acts wherever that touches; a
contact effect at another part acts only where that part touches anything else, such as the gripper.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

HAND, TABLE = "gripper", "table"


def assembles(model: Any) -> bool:
    """Return whether a model is a Scene with a task: a held part and a goal for it."""
    return bool(getattr(model, "goal", ""))


def touching(model: Any) -> list[str]:
    """Return the parts of a Scene with a task that have collision shapes, and its free objects; [] without a task."""
    there = (model.held, model.fixture, HAND, TABLE) if assembles(model) else ()
    return [*(part for part in there if part in model.parts), *getattr(model, "free", ())]


def held(model: Any) -> list[str]:
    """Return the body that the gripper of a Scene holds, as a list; [] if it holds none."""
    return [model.held] if assembles(model) else []


def fixture(model: Any) -> list[str]:
    """Return the body that the goal of a Scene belongs to, as a list; [] without a goal."""
    return [model.fixture] if assembles(model) else []


def goal(model: Any) -> list[str]:
    """Return the goal of a Scene, as a list; [] without one."""
    return [model.goal] if assembles(model) else []


def body_of(part: str) -> str:
    """Return the name of a part's body. The table has no body: its shape belongs to the world."""
    return "tool" if part == HAND else part


def in_scene(model: Any, *places: str) -> list[str]:
    """Return `places` for a Scene with a task, else []."""
    return list(places) if assembles(model) else []


def named(model: Any, name: str) -> list[str]:
    """Return [name] if the held part, the fixture or the goal of a Scene has that name, else []."""
    return [name] if assembles(model) and name in (model.held, model.fixture, model.goal) else []


def shapes(model: mujoco.MjModel, part: str) -> np.ndarray:
    """Return the ids (n,) of a part's geoms that can touch something."""
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    if part == TABLE:
        geom = model.geom(part).id
        return np.array([geom]) if collides[geom] else np.empty(0, int)
    return np.flatnonzero(collides & (model.geom_bodyid == model.body(body_of(part)).id))


def changed(fields: Any, p: np.ndarray, null: float) -> list[tuple[tuple[np.ndarray, ...], np.ndarray]]:
    """Return an index (rows, geoms) and values (rows, 1) for each part of `touching` with values other than null.

    Args:
        fields: the model fields of the batch.
        p: (nsim, npart) the parameter's values.
        null: the value without the effect.
    """
    out, parts = [], touching(fields.robot)
    for column, part in enumerate(parts):
        rows = np.flatnonzero(p[:, column] != null)
        if len(rows):
            out.append((np.ix_(rows, shapes(fields.model, part)), p[rows, column][:, None]))
    return out
