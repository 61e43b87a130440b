"""Run LeRobot's policies and robots in a separate process.

LeRobot needs other versions of packages than this project. Therefore the process may run in another environment: it
uses the interpreter that LEROBOT_PYTHON names, else the present one.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.extras import there
from vispeg.interface import lerobot_process
from vispeg.interface.lerobot_process import read, write

PREFIX = "lerobot:"
PYTHON = "LEROBOT_PYTHON"
INSTALL = "pip install lerobot"
ENDED = "the process of LeRobot has ended"


class LeRobotProcess:
    """A process of LeRobot with a policy or a robot, which answers one message after the other.

    Args:
        name: of the policy or robot, for errors.
        *args: of the process, see `vispeg.interface.lerobot_process`.

    Attributes:
        python: path of the interpreter.

    Raises:
        UserError: LeRobot is not installed here, and LEROBOT_PYTHON is not set.
    """

    def __init__(self, name: str, *args: str):
        self.name, self.args = name, args
        self.python = os.environ.get(PYTHON) or (sys.executable if there("lerobot") else "")
        if not self.python:
            expected = f"{INSTALL}, in an environment of its own, and {PYTHON} set to the python there"
            raise UserError(f"{name} needs lerobot", expected=expected)
        self._process: subprocess.Popen | None = None

    def begin(self) -> dict[str, np.ndarray]:
        """Start the process and return its first message.

        Raises:
            UserError: it cannot be started, or it reports an error.
        """
        # -I: neither this package's folder nor PYTHONPATH may hide modules of that environment
        command = [self.python, "-I", str(Path(lerobot_process.__file__)), *self.args]
        pipes: Any = dict.fromkeys(("stdin", "stdout"), subprocess.PIPE)
        environment = {**os.environ, "HF_HUB_OFFLINE": "1"}
        try:
            process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL, **pipes)
        except OSError as error:
            raise UserError(f"cannot be run: {error.strerror}", key=PYTHON, got=self.python) from error
        weakref.finalize(self, _end, process)
        self._process = process
        return self._answer()

    def ask(self, message: Mapping[str, Any], wait: float | None = None) -> dict[str, np.ndarray]:
        """Send a message and return the answer; start the process first if it does not run.

        Args:
            message: arrays by name, see `vispeg.interface.lerobot_process`.
            wait: s, timeout; None for no limit.

        Raises:
            UserError: the process reports an error, or has ended.
            TimeoutError: no answer within `wait` s.
        """
        if self._process is None:
            self.begin()
        assert self._process is not None and self._process.stdin is not None  # it was given pipes
        try:
            write(self._process.stdin, dict(message))
        except OSError as error:
            raise UserError(f"{self.name}: {ENDED}: {error}") from error
        return self._answer(wait)

    def _answer(self, wait: float | None = None) -> dict[str, np.ndarray]:
        assert self._process is not None
        stream: Any = self._process.stdout
        if wait is not None and not select.select([stream], [], [], wait)[0]:
            raise TimeoutError(f"{self.name}: no answer for {wait:g} s")
        answer = read(stream)
        if answer is not None and "refused" in answer:
            raise UserError(f"{self.name}: {answer['refused']}")
        if answer is None or "error" in answer:
            reason = ENDED if answer is None else str(answer["error"])
            raise UserError(f"{self.name}: {reason.splitlines()[0]}", expected=f"lerobot in {self.python}")
        return answer

    def close(self, wait: float) -> None:
        """End the process; it has `wait` s to disconnect from its robot before it is killed."""
        if self._process is not None:
            assert self._process.stdin is not None  # it was given pipes
            self._process.stdin.close()
            try:
                self._process.wait(wait)
            except subprocess.TimeoutExpired:
                _end(self._process)
            self._process = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_process": None}


def _end(process: subprocess.Popen) -> None:
    """Kill a process and wait for its end."""
    process.kill()
    process.wait()
