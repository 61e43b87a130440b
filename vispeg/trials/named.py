"""Find the driver that a text names."""

from __future__ import annotations

import importlib
from typing import Any

from vispeg.core.errors import UserError
from vispeg.interface.lerobot import PREFIX
from vispeg.trials.driver import Driver
from vispeg.trials.lerobot import LeRobotRobot
from vispeg.trials.logged import LoggedRobot
from vispeg.trials.ros2 import Ros2Robot
from vispeg.trials.socket_robot import SocketRobot

CALLS = ("connect", "read", "command", "stop")
SIMULATED, ROS2, LEROBOT, LOG, PYTHON = "sim", "ros2", PREFIX.rstrip(":"), "log", "python"


def driver(text: str) -> Driver:
    """Return the driver that `--robot` names: `sim:WORLD`, `ros2`, `ros2:FILE.yaml`, `lerobot:TYPE`,
    `lerobot:TYPE:FILE.yaml`, `log:FOLDER`, or `python:MODULE:CALLABLE`.

    Raises:
        UserError: unknown kind, module, file or world; no ROS 2 or LeRobot; or an object without the four methods.
    """
    kind, _, rest = text.partition(":")
    if kind == SIMULATED and rest:
        return SocketRobot(rest)
    if kind == ROS2 and (rest or text == ROS2):
        return Ros2Robot(rest)
    if kind == LEROBOT and rest:
        return LeRobotRobot(rest)
    if kind == LOG and rest:
        return LoggedRobot(rest)
    if kind == PYTHON and rest.count(":") == 1:
        return _imported(text, *rest.split(":"))
    expected = f"{SIMULATED}:WORLD, {ROS2}, {ROS2}:FILE.yaml, {LEROBOT}:TYPE, {LEROBOT}:TYPE:FILE.yaml, "
    expected += f"{LOG}:FOLDER, or {PYTHON}:MODULE:CALLABLE"
    raise UserError("no such robot", key="--robot", expected=expected, got=text)


def _imported(text: str, module: str, name: str) -> Any:
    try:
        target = getattr(importlib.import_module(module), name)()
    except UserError:
        raise
    except Exception as error:  # importing a module or making a driver may raise anything
        what = (str(error).splitlines() or [""])[0]
        expected = "a callable without arguments, in a module on PYTHONPATH or installed"
        raise UserError(
            f"no such driver ({type(error).__name__}: {what})", key="--robot", expected=expected, got=text
        ) from error
    lacking = [call for call in CALLS if not callable(getattr(target, call, None))]
    if lacking:
        raise UserError(f"a driver without {', '.join(lacking)}", key="--robot", expected=", ".join(CALLS), got=text)
    return target
