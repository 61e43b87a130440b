"""What a policy's record (`meta` in policy.json) says of where it was made and for which task; without torch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypedDict

from vispeg.task.registry import config_of, kind_of, task_of
from vispeg.task.terms import Observation
from vispeg.task.world_file import built_in, parts

INTERFACE = ("name", "stack", "dof", "offset", "turn", "policy_period", "cameras", "image_size")
# of the task: what a policy sees and what its actions mean, kept in every world


def interface(meta: Mapping[str, Any]) -> Mapping[str, Any]:
    """Give the part of the task (TaskConfig's fields) that a policy was made for, as far as its record has it."""
    task = meta.get("task") or {}
    stated = {key: task[key] for key in INTERFACE if task.get(key) is not None}
    return {key: tuple(value) if isinstance(value, list) else value for key, value in stated.items()}


def observed(meta: Mapping[str, Any]) -> Observation:
    """Give the observation terms of the task that a policy was made for; those of the task's defaults as far as not
    said.
    """
    config = config_of(interface(meta))
    return Observation(task_of(config).terms, config)


def tolerance_of(meta: Mapping[str, Any]) -> float | None:
    """Give the tolerance (`TaskConfig.tolerance`) that a policy was made for; None where its record does not say."""
    return next(iter(made_for(meta).values()), None)


def made_for(meta: Mapping[str, Any]) -> Mapping[str, float]:
    """Give the settings of the task that a policy was made for, where they may differ from those of its world."""
    task = meta.get("task") or {}
    tolerance = kind_of(task).tolerance if task else None
    stated = None if tolerance is None else task.get(tolerance.setting)
    return {} if tolerance is None or not isinstance(stated, (int, float)) else {tolerance.setting: float(stated)}


class Origin(TypedDict, total=False):
    """World and task of an environment or a dataset, as a policy's record has them; empty where nothing is said.

    Keys:
        world: its name, or None.
        world_hash: its hash, or None.
        world_parts: hash -> name of what it is put together from.
        task: settings.
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
    """Give the worlds that policies of these records were trained or fine-tuned in, ready for a record.

    Records that do not say what their worlds are put together from are taken to mean the built-in world that they name.

    Returns:
        `world_hashes`: of the worlds; `world_parts`: what they are put together from, see `world_file.parts`.
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
