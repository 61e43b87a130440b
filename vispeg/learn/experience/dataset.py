"""Rendered datasets as PyTorch datasets: one frame per item, channels first."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import torch

from vispeg.datasets.layout import COLOUR, is_depth, is_picture, short_of, truth_of
from vispeg.datasets.read import Dataset

OBSERVED = (COLOUR, "observation.depth.")


class Frames(torch.utils.data.Dataset[dict[str, torch.Tensor]]):
    """The frames of a dataset's folder, for a DataLoader; each worker opens the files for itself.

    An item maps feature names to tensors: colour (3, H, W) uint8, depth (1, H, W) float32 in m with 0 = no reading,
    part labels (1, H, W) uint8, numbers as stored. With `task_names`, images, the policy's vector and the ground truth
    are named as in the task's observations (`rgb_wrist_wide`, `depth_wrist_wide`, `policy`, `privileged`), so that an
    item can be given to a policy.

    Args:
        folder: the dataset's folder.
        features: names of the features to read; None for all.
        task_names: whether items use the names of the task's observations.

    Raises:
        UserError: as `vispeg.datasets.read.Dataset`.
    """

    def __init__(self, folder: str | Path, features: Iterable[str] | None = None, *, task_names: bool = False):
        self.folder, self.task_names = Path(folder), task_names
        self.wanted = None if features is None else tuple(features)
        self._data: Dataset | None = Dataset(self.folder, self.wanted)
        self.features, self._length = self._data.features, len(self._data)

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        self._data = self._data or Dataset(self.folder, self.wanted)
        frame = self._data[index]
        return {self._name(k): torch.from_numpy(self._channels_first(k, v)) for k, v in frame.items()}

    def _channels_first(self, name: str, value: np.ndarray) -> np.ndarray:
        if not is_picture(self.features[name]):
            return np.array(value)
        return np.ascontiguousarray(np.moveaxis(value, -1, 0)) if value.ndim == 3 else value[None].copy()

    def _name(self, name: str) -> str:
        if not self.task_names:
            return name
        if name.startswith(OBSERVED):
            camera = short_of(name)
            return f"depth_{camera.removesuffix('_depth')}" if is_depth(self.features[name]) else f"rgb_{camera}"
        return {"observation.policy": "policy", truth_of(self.features): "privileged"}.get(name, name)

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_data": None}  # open files cannot be sent to the loader's workers
