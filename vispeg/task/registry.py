"""Tasks by name: the package's own, those that an installed package offers, and any class of an importable module.

An installed package offers one under the entry point group `vispeg.tasks`. A module is named as `MODULE:CLASS`, as
gymnasium names environments; naming it runs its code, so a world file that names a module deserves the trust that the
module does.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.robots.scene import Scene
from vispeg.task import ROOMS
from vispeg.task.config import TaskConfig
from vispeg.task.contract import Task

GROUP = "vispeg.tasks"
OURS: dict[str, str] = {name: room.TASK for name, room in ROOMS.items()}
(FIRST,) = (name for name, room in ROOMS.items() if room.UNNAMED)  # the task of a world that names none


@cache
def task(name: str) -> Task:
    """Give the task of that name.

    Raises:
        UserError: no such task, a module that cannot be imported, or a class that is no task.
    """
    offered = {**{e.name: e.value for e in entry_points(group=GROUP)}, **OURS}
    where = offered.get(name, name)
    module, _, attribute = where.partition(":")
    if not module or not attribute:
        expected = "a task's name, or MODULE:CLASS of one that Python can import"
        raise UserError("no such task", key="task.name", expected=expected, got=name, choices=offered)
    try:
        target = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, SyntaxError, ValueError) as error:
        expected = "a module on PYTHONPATH or installed, and a class in it"
        raise UserError(f"no such task ({error})", key="task.name", expected=expected, got=name) from error
    if not (inspect.isclass(target) and issubclass(target, Task) and not inspect.isabstract(target)):
        expected = "a class that implements vispeg.task.contract.Task"
        raise UserError("not a task", key="task.name", expected=expected, got=name)
    return target()


def task_of(config: TaskConfig) -> Task:
    """Give the task that these settings are of."""
    return task(config.name)


def kind_of(settings: Mapping[str, Any], file: str | None = None) -> type[TaskConfig]:
    """Give the class of the settings that a mapping (a world file's `task:`) states. Raises UserError: no such task."""
    name = settings.get("name", FIRST)
    if not isinstance(name, str):
        raise UserError("wrong type", file=file, key="task.name", expected="a text", got=name)
    try:
        return task(name).Config
    except UserError as error:
        raise UserError(str(error), file=file) from error


def config_of(settings: Mapping[str, Any], file: str | None = None) -> TaskConfig:
    """Give the settings that a mapping states.

    Raises:
        UserError: no such task, an unknown key, a wrong type or value.
    """
    return kind_of(settings, file).of({"name": FIRST, **settings}, file)


def with_tolerance(settings: Mapping[str, Any], value: float | None) -> Mapping[str, float]:
    """Give the setting that gives a world's task another tolerance; none for None. Raises UserError: it has no
    tolerance.
    """
    if value is None:
        return {}
    tolerance = kind_of(settings).tolerance
    if tolerance is None:
        raise UserError("this task has none to set", key="tolerance", expected="a world of another task", got=value)
    return {tolerance.setting: value}


def scene_of(settings: Mapping[str, Any]) -> Scene:
    """Give the cell that the settings of a world's task ask for. Raises UserError as `config_of`."""
    config = config_of(settings)
    return task_of(config).cell(config)


def digest_of(name: str) -> str | None:
    """SHA-256 (hex) of the file that a task of the user's own is written in; None for the package's."""
    if name in OURS:
        return None
    return hashlib.sha256(Path(inspect.getfile(type(task(name)))).read_bytes()).hexdigest()
