"""The robot that a world file declares, and its identity in a world's hash."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from vispeg.core.paths import expanded
from vispeg.robots.declare import RobotConfig
from vispeg.robots.model import is_path
from vispeg.robots.resources import digest


def declared(stated: Any, file: Path, base: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return `robot` of a world file as the mapping `task["robot"]`, without the fields that have their defaults.

    Args:
        stated: a name or path, which replaces the robot of `base`; or a mapping, each key of which replaces that of
            `base`. Paths are relative to the world file's folder.
        file: the world file.
        base: the same setting of the file's bases; empty if they have none.

    Raises:
        UserError: as `RobotConfig.of`.
    """
    if isinstance(stated, Mapping):
        placed = {k: _beside(stated[k], file) for k in ("model", "tool") if isinstance(stated.get(k), str)}
        robot = RobotConfig.of({**base, **stated, **placed}, str(file))
    else:
        robot = RobotConfig.of(stated, str(file))
        robot = replace(robot, model=_beside(robot.model, file))
    defaults = asdict(RobotConfig())
    return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(robot).items() if v != defaults[k]}


def _beside(model: str, file: Path) -> str:
    return str((file.parent / expanded(model, file, "robot")).absolute()) if is_path(model) else model


def identity(model: str) -> str:
    """Return a robot's name, or the SHA-256 (hex) of its file with all that it names, in any folder."""
    return digest(model) if is_path(model) else model
