"""Play policies that LeRobot saved, with LeRobot itself in a separate process (`vispeg.interface.lerobot`).

A policy sees the values that a rendered dataset calls `observation.state`, or only the joint angles among them, and
`observation.images.CAMERA` (docs/datasets.md). The meaning of its action follows from the names that its training's
dataset gives the action's entries, see `vispeg.interface.actions`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.datasets.describe import INFO
from vispeg.datasets.layout import COLOUR, colour_of
from vispeg.formats.guard import is_file
from vispeg.formats.json_data import read_json
from vispeg.interface.actions import entries
from vispeg.interface.lerobot import PREFIX, LeRobotProcess
from vispeg.interface.terms import MEASURED
from vispeg.render.image_kinds import RGB

STATE, ACTION = "observation.state", "action"
FURTHER = 12  # entries of the state after the joint angles: tip, velocity, force, torque, 3 each
WITHIN = ("pretrained_model", "last", "checkpoints", "")  # names of folders inside a training's folder


def folder_of(text: str) -> Path:
    """Return the folder in `lerobot:FOLDER`."""
    return expanded(text.removeprefix(PREFIX))


def run_of(folder: Path) -> str:
    """Return the name of the training that wrote a folder: `act` of act/checkpoints/last/pretrained_model."""
    names = (p.name for p in (folder, *folder.absolute().parents))
    return next((n for n in names if n not in WITHIN and not n.isdecimal()), PREFIX.rstrip(":"))


class LeRobot:
    """A policy from a folder that `lerobot-train` wrote (`checkpoints/last/pretrained_model`).

    Args:
        folder: folder with config.json and model.safetensors.

    Attributes:
        obs_mode: `rgb`, or `proprio` for a policy without images.
        measured: True, since it asks for readings in SI units.
        task: the cameras that it sees, and the size of their images.
        action_names: names of an action's entries; () where the folder does not state them.
        action_width: length of an action; None where the folder does not state it.

    Raises:
        UserError: not such a folder, images of several sizes or that are not square, or no way to run LeRobot.
    """

    measured = True

    def __init__(self, folder: Path):
        file = folder / "config.json"
        config = read_json(file)
        try:
            seen = config["input_features"]
            shapes = {key: tuple(map(int, feature["shape"])) for key, feature in seen.items()}
            images = [key for key, feature in seen.items() if feature["type"] == "VISUAL"]
            action = config.get("output_features", {}).get(ACTION)
            self.action_width = None if action is None else int(np.prod(action["shape"]))
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
            (size,) = sizes
            if len(size) != 2 or size[0] != size[1]:  # the task's pictures are square; a network would accept them
                expected = "as high as wide, like those of `vispeg render`"
                raise UserError(
                    "pictures that are not square", file=file, key="input_features", expected=expected, got=size
                )
            self.task = {"cameras": tuple(self.cameras), "image_size": size[0]}
        self._process = LeRobotProcess(f"{PREFIX}{folder}", "policy", str(folder.resolve()))

    def feels(self, joints: int) -> bool:
        """Return whether it reads more of the robot's state than the joint angles."""
        return self.state not in (None, (joints,))

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Begin new episodes in all n rows, or only in those where `rows` (n,) is True."""
        for row in range(n) if rows is None else np.flatnonzero(rows).tolist():
            self._process.ask({"row": row})

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, k) for n episodes.

        Raises:
            UserError: the policy was trained with another state than this robot has.
        """
        state = obs[MEASURED]
        if self.state == (state.shape[1] - FURTHER,):
            state = state[:, :-FURTHER]
        elif self.state is not None and self.state != state.shape[1:]:
            what, key = "was trained with another state than this robot has", f"input_features.{STATE}"
            raise UserError(f"{self.folder} {what}", key=key, expected=state.shape[1:], got=self.state)
        return np.stack([self._process.ask(self._seen(obs, state, row))["action"] for row in range(len(state))])

    def _seen(self, obs: Mapping[str, np.ndarray], state: np.ndarray, row: int) -> dict[str, Any]:
        images = {colour_of(name): obs[f"{RGB.name}_{name}"][row] for name in self.cameras}
        scaled = {key: np.ascontiguousarray(image, np.float32) / np.float32(255) for key, image in images.items()}
        return {"row": row, STATE: state[row], "task": "", **scaled}


def _action_names(folder: Path) -> tuple[str, ...]:
    """Return the names of an action's entries in the dataset of a policy's training; () if that is not there."""
    root = _stated(folder / "train_config.json", "dataset", "root")
    return entries(_stated(Path(root) / INFO, "features", ACTION, "names")) if isinstance(root, str) else ()


def _stated(file: Path, *keys: str) -> Any:
    """Return the value at nested keys of a JSON file; None if the key or the file is missing."""
    value = read_json(file) if is_file(file) else None
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value
