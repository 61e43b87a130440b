"""Policies that LeRobot saved, played by LeRobot itself in a process of its own.

LeRobot asks for other versions of packages than this project does, so the process may run in another environment: the
interpreter that LEROBOT_PYTHON names, else the present one. A policy sees what a rendered dataset calls
`observation.state` (or of it the joints alone) and `observation.images.CAMERA` (docs/datasets.md). What its action
means is told by the names that the dataset of its training gives the action, see `vispeg.interface.actions`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.extras import there
from vispeg.datasets.describe import INFO
from vispeg.datasets.layout import COLOUR, colour_of
from vispeg.evaluation import lerobot_process
from vispeg.evaluation.lerobot_process import read, write
from vispeg.formats.guard import is_file
from vispeg.formats.json_data import read_json
from vispeg.interface.actions import entries
from vispeg.interface.terms import MEASURED
from vispeg.render.image_kinds import RGB

PREFIX = "lerobot:"
PYTHON = "LEROBOT_PYTHON"
STATE, ACTION = "observation.state", "action"
READ = 12  # readings behind the joints': tip, velocity, force, torque
WITHIN = ("pretrained_model", "last", "checkpoints", "")  # folders in a training's own


def folder_of(text: str) -> Path:
    """Return the folder in `lerobot:FOLDER`."""
    return Path(text.removeprefix(PREFIX)).expanduser()


def run_of(folder: Path) -> str:
    """Return the name of the training that wrote a folder: `act` of act/checkpoints/last/pretrained_model."""
    above = (p.name for p in (folder, *folder.absolute().parents))
    return next((n for n in above if n not in WITHIN and not n.isdecimal()), PREFIX.rstrip(":"))


class LeRobot:
    """A policy's folder, as `lerobot-train` writes it (`checkpoints/last/pretrained_model`).

    Args:
        folder: with config.json and model.safetensors.

    Attributes:
        obs_mode: `rgb`, or `proprio` of a policy without pictures.
        measured: it asks for readings in SI units.
        task: the cameras that it sees, and their size.
        action_names, action_width: of the numbers of an action; () and None where the folder does not say.

    Raises:
        UserError: not such a folder; pictures of several sizes; nothing that runs LeRobot.
    """

    measured = True

    def __init__(self, folder: Path):
        file = folder / "config.json"
        config = read_json(file)
        try:
            seen = config["input_features"]
            shapes = {key: tuple(map(int, feature["shape"])) for key, feature in seen.items()}
            images = [key for key, feature in seen.items() if feature["type"] == "VISUAL"]
            acts = config.get("output_features", {}).get(ACTION)
            self.action_width = None if acts is None else int(np.prod(acts["shape"]))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            what = "not a policy that LeRobot saved"
            expected = "a folder with config.json and model.safetensors, such as checkpoints/last/pretrained_model"
            raise UserError(what, file=file, expected=expected) from error
        self.folder = folder
        self.cameras = [key.removeprefix(COLOUR) for key in images]
        self.state, self.action_names = shapes.get(STATE), _action_names(folder)
        self.task: dict[str, Any] = {}
        self.obs_mode = "rgb" if images else "proprio"
        if images:
            sizes = {shapes[key][1:] for key in images}
            if len(sizes) > 1:
                raise UserError("pictures of several sizes", file=file, key="input_features", got=sorted(sizes))
            self.task = {"cameras": tuple(self.cameras), "image_size": min(sizes.pop())}
        self._python = os.environ.get(PYTHON) or (sys.executable if there("lerobot") else "")
        if not self._python:
            expected = f"{PYTHON} set to the python of an environment that has it, see docs/learning.md"
            raise UserError(f"{PREFIX}{folder} needs lerobot", expected=expected)
        self._process: subprocess.Popen | None = None

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Episodes begin in `rows` (n,) bool, None: in all."""
        for row in range(n) if rows is None else np.flatnonzero(rows).tolist():
            self._ask({"row": row})

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, k) for n episodes."""
        state = obs[MEASURED]
        if self.state == (state.shape[1] - READ,):
            state = state[:, :-READ]
        elif self.state is not None and self.state != state.shape[1:]:
            what, key = "was trained with another state than this robot has", f"input_features.{STATE}"
            raise UserError(f"{self.folder} {what}", key=key, expected=state.shape[1:], got=self.state)
        return np.stack([self._ask(self._seen(obs, state, row))["action"] for row in range(len(state))])

    def _seen(self, obs: Mapping[str, np.ndarray], state: np.ndarray, row: int) -> dict[str, Any]:
        images = {colour_of(name): obs[f"{RGB.name}_{name}"][row] for name in self.cameras}
        scaled = {key: np.ascontiguousarray(image, np.float32) / np.float32(255) for key, image in images.items()}
        return {"row": row, STATE: state[row], "task": "", **scaled}

    def _ask(self, message: dict[str, Any]) -> dict[str, np.ndarray]:
        if self._process is None:
            self._process = self._begun()
        try:
            write(self._process.stdin, message)  # type: ignore[arg-type]  # it has pipes
            return self._answer(self._process)
        except OSError as error:
            raise UserError(f"{self.folder}: the process of LeRobot has ended: {error}") from error

    def _answer(self, process: subprocess.Popen) -> dict[str, np.ndarray]:
        answer = read(process.stdout)  # type: ignore[arg-type]
        if answer is None or "error" in answer:
            said = "the process of LeRobot has ended" if answer is None else str(answer["error"])
            raise UserError(f"{self.folder}: {said.splitlines()[0]}", expected=f"lerobot in {self._python}")
        return answer

    def _begun(self) -> subprocess.Popen:
        environment = {**os.environ, "HF_HUB_OFFLINE": "1"}
        # isolated: neither this package's folder nor PYTHONPATH puts modules before those of that environment
        command = [self._python, "-I", str(Path(lerobot_process.__file__)), str(self.folder.resolve())]
        pipes: Any = dict.fromkeys(("stdin", "stdout"), subprocess.PIPE)
        try:
            process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL, **pipes)
        except OSError as error:
            raise UserError(f"cannot be run: {error.strerror}", key=PYTHON, got=self._python) from error
        weakref.finalize(self, _end, process)
        self._answer(process)
        return process

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_process": None}


def _action_names(folder: Path) -> tuple[str, ...]:
    """Names that the dataset of a policy's training gives the numbers of an action; () where it is not there."""
    root = _stated(folder / "train_config.json", "dataset", "root")
    return entries(_stated(Path(root) / INFO, "features", ACTION, "names")) if isinstance(root, str) else ()


def _stated(file: Path, *keys: str) -> Any:
    """Give what a JSON file states under keys in each other; None where it does not, or is not there."""
    value = read_json(file) if is_file(file) else None
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _end(process: subprocess.Popen) -> None:
    """End a process; it has nothing to save."""
    process.kill()
    process.wait()
