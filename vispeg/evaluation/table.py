"""Arrange episodes by policy, world and control, with the same networks and seeds in cells that are compared."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics import Rows

BLIND = "proprio"  # modality of the policies without images, which serve as a control


@dataclass(frozen=True)
class Cell:
    """A policy in a world under a control ("" for none)."""

    policy: str
    world: str
    control: str = ""


class Table:
    """Episodes by (policy, world, control), then by training seed, then by (seed, configuration).

    Args:
        episodes: the records.

    Raises:
        UserError: no episode, or a policy with two modalities.
    """

    def __init__(self, episodes: Iterable[Episode]):
        self.cells: dict[Cell, dict[int, dict[tuple[int, str], Episode]]] = {}
        self.modality: dict[str, str] = {}
        self.hashes: dict[str, str] = {}
        episodes = list(episodes)
        for e in sorted(episodes, key=lambda e: e.control != ""):  # a control may have another world's hash
            self.hashes.setdefault(e.world, e.world_hash)
        for e in episodes:
            cell = self.cells.setdefault(Cell(e.policy, e.world, e.control), {})
            cell.setdefault(e.train_seed, {})[e.seed, e.configuration] = e
            modality = self.modality.setdefault(e.policy, e.modality)
            if e.modality and modality and e.modality != modality:
                raise UserError("one policy with two modalities", key=e.policy, expected=modality, got=e.modality)
            self.modality[e.policy] = modality or e.modality
        if not self.cells:
            raise UserError("no episodes")

    @property
    def policies(self) -> list[str]:
        """Names of policies, in the order of the episodes."""
        return list(dict.fromkeys(cell.policy for cell in self.cells))

    @property
    def worlds(self) -> list[str]:
        """Names of worlds, in the order of the episodes."""
        return list(dict.fromkeys(cell.world for cell in self.cells))

    @property
    def controls(self) -> list[str]:
        """Names of controls, in the order of the episodes, without the empty one."""
        return [c for c in dict.fromkeys(cell.control for cell in self.cells) if c]

    def has(self, *cells: Cell) -> bool:
        """Return whether all cells hold episodes."""
        return all(cell in self.cells for cell in cells)

    def all(self, cell: Cell) -> list[Episode]:
        """Return all episodes of a cell, ordered by training seed, then by seed."""
        return [e for _, row in sorted(self.cells.get(cell, {}).items()) for _, e in sorted(row.items())]

    def networks(self, cells: Sequence[Cell]) -> list[int]:
        """Return the training seeds that all cells have, sorted."""
        return sorted(set.intersection(*(set(self.cells.get(cell, {})) for cell in cells)))

    def rows(self, cell: Cell) -> Rows:
        """Return the outcomes of a cell for `vispeg.evaluation.statistics`; empty where nothing was played."""
        return rows(self.all(cell), lambda e: (e.seed, e.configuration))

    def aligned(self, policy: str, worlds: Sequence[str]) -> dict[str, np.ndarray] | None:
        """Return world -> successes (k, n) of one policy: row i is the same network, column j the same episode in all.

        None where the worlds share no network, or the networks share no episode.
        """
        sides = [self.rows(Cell(policy, w)) for w in worlds]
        networks = self.networks([Cell(policy, w) for w in worlds])
        played = [set(side[t]) for side in sides for t in networks]
        seeds = sorted(set.intersection(*played), key=repr) if played else []
        if not seeds:
            return None
        return {
            w: np.array([[side[t][s] for s in seeds] for t in networks]) for w, side in zip(worlds, sides, strict=True)
        }


def rows(
    episodes: Iterable[Episode],
    name: Callable[[Episode], Hashable] = lambda e: e.seed,
    value: Callable[[Episode], Any] = lambda e: float(e.success),
) -> dict[int, dict[Hashable, Any]]:
    """Return outcomes for `vispeg.evaluation.statistics`: training seed -> episode's key -> value.

    Args:
        episodes: episodes of one policy.
        name: the key of an episode; episodes with the same key pair across policies and worlds. A real robot's trial
            also gets its policy and training seed in the key, because equal numbers of trials are not equal starts.
        value: the value to compare; by default success, 0 or 1.
    """
    found: dict[int, dict[Hashable, Any]] = {}
    for e in episodes:
        key = name(e) if e.world_hash else (e.policy, e.train_seed, name(e))
        found.setdefault(e.train_seed, {})[key] = value(e)
    return found
