"""Read a policy's origin from its record (`meta` in policy.json): its worlds and its task. Without torch."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypedDict

from vispeg.core.errors import UserError
from vispeg.task.registry import config_of, kind_of, task_of
from vispeg.task.terms import Observation
from vispeg.task.world_file import built_in, parts

# the task's settings that define what a policy sees and what its actions mean: the same in every world
INTERFACE = ("name", "stack", "dof", "offset", "turn", "policy_period", "cameras", "image_size")

ACTIONS = ("dof", "policy_period", "offset", "turn")  # those that define what its actions mean


def refuse_other_actions(
    what: str, task: Mapping[str, Any], other: Mapping[str, Any], file: str | Path | None = None
) -> None:
    """Raise UserError, which begins with `what`, where actions mean something else in the other task.

    Args:
        what: the error.
        task, other: settings (TaskConfig's fields); what only one of them states is not compared, nor `turn` where
            nothing turns.
        file: where the other task's settings come from, for the error.
    """
    # directions of `dof` are x, y, z and the rotations rx, ry, rz
    still = not any(d.startswith("r") for d in task.get("dof", ()))
    for key in ACTIONS:
        if key in task and key in other and task[key] != other[key] and not (key == "turn" and still):
            raise UserError(what, file=file, key=key, expected=task[key], got=other[key])


def interface(meta: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the INTERFACE settings (TaskConfig's fields) that a policy was made for, those that its record states."""
    task = meta.get("task") or {}
    stated = {key: task[key] for key in INTERFACE if task.get(key) is not None}
    return {key: tuple(value) if isinstance(value, list) else value for key, value in stated.items()}


def observed(meta: Mapping[str, Any]) -> Observation:
    """Return the observation terms of the task that a policy was made for.

    The task's defaults stand for settings that the record does not state.
    """
    config = config_of(interface(meta))
    return Observation(task_of(config).terms, config)


def tolerance_of(meta: Mapping[str, Any]) -> float | None:
    """Return the tolerance (`TaskConfig.tolerance`) that a policy was made for; None where its record has none."""
    return next(iter(made_for(meta).values()), None)


def made_for(meta: Mapping[str, Any]) -> Mapping[str, float]:
    """Return the tolerance that a policy was made for as {setting: value}; empty where its record states none.

    A training run's settings may replace the world's, so it may differ from the value in the world's file.
    """
    task = meta.get("task") or {}
    tolerance = kind_of(task).tolerance if task else None
    stated = None if tolerance is None else task.get(tolerance.setting)
    return {} if tolerance is None or not isinstance(stated, (int, float)) else {tolerance.setting: float(stated)}


class Origin(TypedDict, total=False):
    """World and task of an environment or a dataset, in the form of a policy's record; empty where unknown.

    Keys:
        world: the world's name, or None.
        world_hash: the world's hash, or None.
        world_parts: hash -> file name of each part that the world is composed of, see `world_file.parts`.
        task: the task's settings.
    """

    world: str | None
    world_hash: str | None
    world_parts: Mapping[str, str]
    task: Mapping[str, Any]


class MadeIn(TypedDict):
    """The worlds that a policy was trained or fine-tuned in: their hashes, and hash -> name of their parts."""

    world_hashes: list[str]
    world_parts: dict[str, str]


def worlds(*metas: Mapping[str, Any]) -> MadeIn:
    """Return the worlds that policies with these records were trained or fine-tuned in, as entries of a record.

    A record without `world_parts` gets the parts of the built-in world that it names, if it names one.
    """
    hashes: list[Any] = []
    made_of: dict[str, str] = {}
    for meta in metas:
        tuned = meta.get("finetuned")
        for record in (meta, tuned if isinstance(tuned, Mapping) else {}):
            hashes += [record.get("world_hash"), *(record.get("world_hashes") or ())]
            if isinstance(record.get("world_parts"), Mapping):
                made_of |= record["world_parts"]
            else:
                names = [name for name in (record.get("world_file"), record.get("world")) if name in built_in()]
                made_of |= parts(names[0]) if names else {}
    return {"world_hashes": list(dict.fromkeys(str(h) for h in hashes if h)), "world_parts": made_of}
