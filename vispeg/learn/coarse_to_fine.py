"""Combine two policies: a coarse one with images brings the tip to the goal, a fine contact policy takes over there.

The fine policy takes over for the rest of the episode once the coarse one estimates that the tip is near the goal's
axis. A fine `state` policy is given the goal's position as the coarse one estimated it.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.learn.layout import VECTOR
from vispeg.learn.meta import interface, observed, refuse_other_actions, worlds
from vispeg.learn.policy import NetPolicy, Policy, load
from vispeg.learn.record import COARSE, FINE, PAIR, read_record
from vispeg.learn.shipped import META, policy_folder

NEWEST = 0.5  # weight of the newest estimate of the goal in a running average


class CoarseToFine:
    """Act as one policy made of a coarse and a fine one.

    Args:
        coarse: acts until the takeover.
        fine: acts after it.
        within: lateral distance of the tip from the estimated goal at which the fine policy takes over, m.
        meta: the pair's record; None for the coarse policy's.

    Attributes:
        estimate: (n, 3) m, the tip in the goal's frame as the coarse policy estimates it; None without an estimate.
        fine_has: (n,) bool, the rows in which the fine policy acts.

    Raises:
        UserError: the fine policy reads something that the coarse one's observation lacks, their actions differ in
            length or meaning, or `within` is not above 0 and at most 1.
    """

    def __init__(self, coarse: NetPolicy, fine: NetPolicy, within: float, meta: Mapping[str, Any] | None = None):
        shapes, read = coarse.layout.shapes, fine.layout.shapes
        lacking = sorted(key for key, shape in read.items() if shapes.get(key) != shape)
        if lacking or coarse.layout.action != fine.layout.action:
            raise UserError("the fine policy was made for another observation", expected=shapes, got=read)
        made_for = interface(coarse.meta), interface(fine.meta)
        refuse_other_actions("the fine policy was made for other actions", *made_for)
        if not 0 < within <= 1:
            raise UserError("not a distance", key="within", expected="metres, above 0 and at most 1", got=within)
        self.coarse, self.fine, self.within = coarse, fine, within
        self.modality = coarse.modality
        self.meta: Mapping[str, Any] = dict(meta or coarse.meta)
        self.layout, self.recurrent = coarse.layout, coarse.recurrent
        self.observed = observed(coarse.meta)
        self.tip, self.unit = self.observed["tip"], self.observed.term("tip").scale
        self.estimate: np.ndarray | None = None

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """See Policy."""
        self.coarse.reset(n, rows)
        self.fine.reset(n, rows)
        if rows is None:
            self.fine_has, self.sights = np.zeros(n, bool), np.zeros(n, int)  # sights: number of estimates so far
            self.goal = np.zeros((n, 2))  # m, in the plane, from the place to which tip positions are relative
        else:
            self.fine_has[rows], self.sights[rows], self.goal[rows] = False, 0, 0.0

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """See Policy."""
        action = self.coarse.act(obs)
        self.estimate = self.coarse.estimate
        # m, from the goal's nominal place; from its believed place for a coarse policy of modality `state`
        measured = self.unit * obs[VECTOR][:, self.tip][:, :2]
        # m, in the goal's frame; without an estimate the believed place is the goal
        offset = measured if self.estimate is None else self.estimate[:, :2]
        weight = np.where(self.sights == 0, 1.0, NEWEST) * ~self.fine_has
        self.goal += weight[:, None] * (measured - offset - self.goal)
        self.sights += ~self.fine_has
        self.fine_has |= np.linalg.norm(measured - self.goal, axis=1) < self.within
        observation = {**obs, VECTOR: self._relative_to_goal(obs[VECTOR])} if self.fine.modality == "state" else obs
        return np.where(self.fine_has[:, None], self.fine.act(observation), action)

    def _relative_to_goal(self, vector: np.ndarray) -> np.ndarray:
        """Return the stacked observations (n, stack d) with tip positions relative to the estimated goal."""
        out = vector.reshape(len(vector), -1, self.observed.policy_size).copy()
        out[:, :, self.tip][:, :, :2] -= (self.goal / self.unit)[:, None]
        return out.reshape(vector.shape)


def combine(coarse: Path, fine: Path, within: float, out: Path, overwrite: bool = False) -> None:
    """Write both policies' files and the distance of takeover into one folder, which `open_policy` reads.

    Args:
        coarse, fine: the policies' folders, or names of shipped policies.
        within: see `CoarseToFine`.
        out: the new folder.
        overwrite: whether `out` may be replaced.

    Raises:
        UserError: a folder holds no policy, the two policies do not fit, or `out` exists and may not be replaced.
    """
    both = CoarseToFine(load(coarse), load(fine), within)
    meta = {**both.meta, **worlds(both.coarse.meta, both.fine.meta)}
    record = {"format": PAIR.name, "modality": both.modality, "within": within, "meta": meta}
    with new_folder(out, overwrite, holds="policy", inputs=(coarse, fine)) as place:
        for name, folder in ((COARSE, coarse), (FINE, fine)):
            shutil.copytree(policy_folder(folder), place / name)
        (place / META).write_text(json.dumps(record, indent=2) + "\n")


def open_policy(folder: str | Path) -> Policy:
    """Load the policy in a folder: one network, or a coarse and a fine one. Raises UserError as `load` does."""
    path = policy_folder(folder)
    record = read_record(path)
    if "within" not in record:
        return load(path)
    return CoarseToFine(load(path / COARSE), load(path / FINE), float(record["within"]), record["meta"])
