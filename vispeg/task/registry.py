"""Tasks by name: this package's own, those of other installed packages, and any class of an importable module.

Another package offers a task in the entry point group `vispeg.tasks`. A class of a module is named `MODULE:CLASS`, as
in gymnasium. Naming it imports the module and so runs its code: only use world files whose modules you trust.
"""

from __future__ import annotations

import hashlib
import inspect
import pkgutil
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
(FIRST,) = (name for name, room in ROOMS.items() if room.UNNAMED)  # the task of a world that names no task


@cache
def task(name: str) -> Task:
    """Return the task of that name.

    Raises:
        UserError: no such task, a module that cannot be imported, or a class that is not a task.
    """
    offered = {**{e.name: e.value for e in entry_points(group=GROUP)}, **OURS}
    where = offered.get(name, name)
    module, _, attribute = where.partition(":")
    if not module or not attribute:
        expected = "a task's name, or MODULE:CLASS of one that Python can import"
        raise UserError("no such task", key="task.name", expected=expected, got=name, choices=offered)
    try:
        target = pkgutil.resolve_name(where)
    except (ImportError, AttributeError, SyntaxError, ValueError) as error:
        expected = "a module on PYTHONPATH or installed, and a class in it"
        raise UserError(f"no such task ({error})", key="task.name", expected=expected, got=name) from error
    if not (inspect.isclass(target) and issubclass(target, Task) and not inspect.isabstract(target)):
        expected = "a class that implements vispeg.task.contract.Task"
        raise UserError("not a task", key="task.name", expected=expected, got=name)
    return target()


def task_of(config: TaskConfig) -> Task:
    """Return the task to which these settings belong."""
    return task(config.name)


def kind_of(settings: Mapping[str, Any], file: str | None = None) -> type[TaskConfig]:
    """Return the settings class for a mapping (`task:` of a world file). Raises UserError: no such task."""
    name = settings.get("name", FIRST)
    if not isinstance(name, str):
        raise UserError("wrong type", file=file, key="task.name", expected="a text", got=name)
    try:
        return task(name).Config
    except UserError as error:
        raise UserError(str(error), file=file) from error


def config_of(settings: Mapping[str, Any], file: str | None = None) -> TaskConfig:
    """Return the settings that a mapping (`task:` of a world file) states.

    Raises:
        UserError: no such task, an unknown key, a wrong type or value.
    """
    return kind_of(settings, file).of({"name": FIRST, **settings}, file)


def with_tolerance(settings: Mapping[str, Any], value: float | None) -> Mapping[str, float]:
    """Return the setting that changes a task's tolerance, as {field: value}; {} if `value` is None.

    Args:
        settings: the task's settings, `task:` of a world file.
        value: tolerance, in the unit of `TaskConfig.tolerance`.

    Raises:
        UserError: the task has no tolerance.
    """
    if value is None:
        return {}
    tolerance = kind_of(settings).tolerance
    if tolerance is None:
        raise UserError("this task has no tolerance", key="tolerance", expected="a world of another task", got=value)
    return {tolerance.setting: value}


def scene_of(settings: Mapping[str, Any]) -> Scene:
    """Return the cell for the settings of a world's task. Raises UserError as `config_of` does."""
    config = config_of(settings)
    return task_of(config).cell(config)


def digest_of(name: str) -> str | None:
    """Return the SHA-256 (hex) of the source file that defines a task from outside; None for this package's tasks."""
    if name in OURS:
        return None
    return hashlib.sha256(Path(inspect.getfile(type(task(name)))).read_bytes()).hexdigest()
