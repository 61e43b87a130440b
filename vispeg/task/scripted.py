"""A task's scripted expert with the interface of a learned policy, as a baseline for evaluations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vispeg.task.config import TaskConfig
from vispeg.task.registry import task_of


class Scripted:
    """The scripted expert as a policy of modality `state`, which is told the goal."""

    modality = "state"
    meta: Mapping[str, Any] = {"name": "expert"}
    estimate: np.ndarray | None = None

    def __init__(self, config: TaskConfig):
        self.config, self.n = config, 0

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Begin `n` episodes, or those of them that `rows` (n,) bool selects."""
        if rows is None or n != self.n:
            self.n, self.expert = n, task_of(self.config).expert(self.config, n)
        else:
            self.expert.reset(np.flatnonzero(rows))

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, len(dof)) float32 within +-1."""
        n = len(obs["policy"])
        if n != self.n:
            self.reset(n)
        return self.expert.act(obs).astype(np.float32)
