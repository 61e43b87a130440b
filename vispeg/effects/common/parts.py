"""The cell's parts that touch: their collision shapes in a compiled model.

Two touching shapes of equal priority share one contact: MuJoCo takes the greater friction of the two and the mean of
their solver parameters. A shape of higher priority has its own way in both (MuJoCo 4.0 manual, Modeling, Contact
parameters). In the cell that is what the gripper holds, so an effect at it is felt wherever it touches, one at another
part where the gripper touches that.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

HAND, TABLE = "gripper", "table"


def assembles(model: Any) -> bool:
    """Whether a model is a Scene with a task: something is held, and a goal for it."""
    return bool(getattr(model, "goal", ""))


def touching(model: Any) -> list[str]:
    """Parts of a Scene with a task that have collision shapes, a free object by its name; [] where nothing touches."""
    there = (model.held, model.fixture, HAND, TABLE) if assembles(model) else ()
    return [*(part for part in there if part in model.parts), *getattr(model, "free", ())]


def held(model: Any) -> list[str]:
    """Return the bodies that the gripper of a Scene holds; [] if it holds none."""
    return [model.held] if assembles(model) else []


def fixture(model: Any) -> list[str]:
    """Return the bodies that the goal of a Scene is part of; [] without a goal."""
    return [model.fixture] if assembles(model) else []


def goal(model: Any) -> list[str]:
    """Give the goal of a Scene; [] without one."""
    return [model.goal] if assembles(model) else []


def body_of(part: str) -> str:
    """Give the body of a part; the table is no body, it stands in the world itself."""
    return "tool" if part == HAND else part


def in_scene(model: Any, *places: str) -> list[str]:
    """`places` for a Scene with a task, else []."""
    return list(places) if assembles(model) else []


def named(model: Any, name: str) -> list[str]:
    """Give the part or site of that name where a Scene has it for what is held, what it goes into, or the goal; else
    [].
    """
    return [name] if assembles(model) and name in (model.held, model.fixture, model.goal) else []


def shapes(model: mujoco.MjModel, part: str) -> np.ndarray:
    """Ids (n,) of a part's geoms that can touch something; the table is a shape of the world itself."""
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    if part == TABLE:
        geom = model.geom(part).id
        return np.array([geom]) if collides[geom] else np.empty(0, int)
    return np.flatnonzero(collides & (model.geom_bodyid == model.body(body_of(part)).id))


def changed(fields: Any, p: np.ndarray, null: float) -> list[tuple[tuple[np.ndarray, ...], np.ndarray]]:
    """Index of (rows, geoms) and value (rows, 1) for each touching part whose `p` (nsim, npart) differs from null."""
    out, parts = [], touching(fields.robot)
    for column, part in enumerate(parts):
        rows = np.flatnonzero(p[:, column] != null)
        if len(rows):
            out.append((np.ix_(rows, shapes(fields.model, part)), p[rows, column][:, None]))
    return out
