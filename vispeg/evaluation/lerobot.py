"""Policies that LeRobot saved, played by LeRobot itself in a process of its own (`vispeg.interface.lerobot`).

A policy sees what a rendered dataset calls `observation.state` (or of it the joints alone) and
`observation.images.CAMERA` (docs/datasets.md). What its action means is told by the names that the dataset of its
training gives the action, see `vispeg.interface.actions`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.datasets.describe import INFO
from vispeg.datasets.layout import COLOUR, colour_of
from vispeg.formats.guard import is_file
from vispeg.formats.json_data import read_json
from vispeg.interface.actions import entries
from vispeg.interface.lerobot import PREFIX, LeRobotProcess
from vispeg.interface.terms import MEASURED
from vispeg.render.image_kinds import RGB

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
        self._process = LeRobotProcess(f"{PREFIX}{folder}", "policy", str(folder.resolve()))

    def feels(self, joints: int) -> bool:
        """Whether it asks for more of the robot's state than the angles of its joints."""
        return self.state not in (None, (joints,))

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Episodes begin in `rows` (n,) bool, None: in all."""
        for row in range(n) if rows is None else np.flatnonzero(rows).tolist():
            self._process.ask({"row": row})

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, k) for n episodes."""
        state = obs[MEASURED]
        if self.state == (state.shape[1] - READ,):
            state = state[:, :-READ]
        elif self.state is not None and self.state != state.shape[1:]:
            what, key = "was trained with another state than this robot has", f"input_features.{STATE}"
            raise UserError(f"{self.folder} {what}", key=key, expected=state.shape[1:], got=self.state)
        return np.stack([self._process.ask(self._seen(obs, state, row))["action"] for row in range(len(state))])

    def _seen(self, obs: Mapping[str, np.ndarray], state: np.ndarray, row: int) -> dict[str, Any]:
        images = {colour_of(name): obs[f"{RGB.name}_{name}"][row] for name in self.cameras}
        scaled = {key: np.ascontiguousarray(image, np.float32) / np.float32(255) for key, image in images.items()}
        return {"row": row, STATE: state[row], "task": "", **scaled}


def _action_names(folder: Path) -> tuple[str, ...]:
    """Names that the dataset of a policy's training gives the numbers of an action; () where it is not there."""
    root = _stated(folder / "train_config.json", "dataset", "root")
    return entries(_stated(Path(root) / INFO, "features", ACTION, "names")) if isinstance(root, str) else ()


def _stated(file: Path, *keys: str) -> Any:
    """Return the value at nested keys of a JSON file; None if the key or the file is missing."""
    value = read_json(file) if is_file(file) else None
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value
