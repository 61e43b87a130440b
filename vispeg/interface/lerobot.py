"""LeRobot in a process of its own: its policies, and its robots.

LeRobot asks for other versions of packages than this project does, so the process may run in another environment: the
interpreter that LEROBOT_PYTHON names, else the present one.
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
    """LeRobot, asked one thing after the other.

    Args:
        name: of what it holds, for errors.
        *args: of the process, see `vispeg.interface.lerobot_process`.

    Attributes:
        python: the interpreter.

    Raises:
        UserError: nothing that runs LeRobot.
    """

    def __init__(self, name: str, *args: str):
        self.name, self.args = name, args
        self.python = os.environ.get(PYTHON) or (sys.executable if there("lerobot") else "")
        if not self.python:
            expected = f"{INSTALL}, in an environment of its own, and {PYTHON} set to the python there"
            raise UserError(f"{name} needs lerobot", expected=expected)
        self._process: subprocess.Popen | None = None

    def begin(self) -> dict[str, np.ndarray]:
        """Start the process; return what it says of itself. Raises UserError: it cannot be started, or refuses."""
        # isolated: neither this package's folder nor PYTHONPATH puts modules before those of that environment
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
        """Return the answer to a message, which starts the process where it does not run.

        Raises:
            UserError: it refuses, or is not there any more.
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
            said = ENDED if answer is None else str(answer["error"])
            raise UserError(f"{self.name}: {said.splitlines()[0]}", expected=f"lerobot in {self.python}")
        return answer

    def close(self, wait: float) -> None:
        """End the process, which has `wait` s to take leave of what it holds."""
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
    """End a process."""
    process.kill()
    process.wait()
