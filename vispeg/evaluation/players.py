"""Policies ready to play: from their folder, or the scripted expert behind the same interface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vispeg.evaluation.entrants import EXPERT, Entrant, entrants
from vispeg.task.registry import task_of


def player(who: Entrant, config: Any) -> Any:
    """The policy of an entrant (see `vispeg.learn.policy.Policy`) for an environment of TaskConfig `config`."""
    if str(who.path) == EXPERT:
        return ScriptedPolicy(config)
    from vispeg.learn.coarse_to_fine import open_policy

    return open_policy(who.path)


def ready(texts: Sequence[str]) -> list[Entrant]:
    """The entrants of these texts, each policy opened once, before anything is written.

    Raises:
        UserError: as `entrants`; a policy that cannot be played.
    """
    who = entrants(texts)
    for e in who:
        if not e.scripted:
            from vispeg.learn.coarse_to_fine import open_policy

            open_policy(e.path)
    return who


class ScriptedPolicy:
    """The scripted expert as a policy: what success the task allows to one that acts on the same observation."""

    modality = "state"
    meta: Mapping[str, Any] = {}
    estimate: np.ndarray | None = None

    def __init__(self, config: Any):
        self.config = config

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """All rows, or those of the mask (n,), begin a new episode."""
        if rows is None:
            self.expert = task_of(self.config).expert(self.config, n)
        else:
            self.expert.reset(rows)

    def act(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        """Actions (n, 3) float32."""
        return self.expert.act(obs).astype(np.float32)
