"""Episodes as matrices: the same training seeds and episode seeds in every cell that is compared."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics import Rows

BLIND = "proprio"  # the modality that is a control by itself


@dataclass(frozen=True)
class Cell:
    """Whose success, where, and under which control ("" for none)."""

    policy: str
    world: str
    control: str = ""


class Table:
    """Episodes by (policy, world, control), then by training seed and episode seed.

    Args:
        episodes: the records; configurations are identified by the episode's seed and configuration together.

    Raises:
        UserError: no episode; a policy with two modalities.
    """

    def __init__(self, episodes: Iterable[Episode]):
        self.cells: dict[Cell, dict[int, dict[tuple[int, str], Episode]]] = {}
        self.modality: dict[str, str] = {}
        self.hashes: dict[str, str] = {}
        episodes = list(episodes)
        for e in sorted(episodes, key=lambda e: e.control != ""):  # a control may be a world of its own
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
        """Policies in the order in which they came."""
        return list(dict.fromkeys(cell.policy for cell in self.cells))

    @property
    def worlds(self) -> list[str]:
        """Worlds in the order in which they came."""
        return list(dict.fromkeys(cell.world for cell in self.cells))

    @property
    def controls(self) -> list[str]:
        """Controls in the order in which they came, without the empty one."""
        return [c for c in dict.fromkeys(cell.control for cell in self.cells) if c]

    def has(self, *cells: Cell) -> bool:
        """Whether all cells hold episodes."""
        return all(cell in self.cells for cell in cells)

    def all(self, cell: Cell) -> list[Episode]:
        """Every episode of a cell, by training seed, then seed."""
        return [e for _, row in sorted(self.cells.get(cell, {}).items()) for _, e in sorted(row.items())]

    def networks(self, cells: Sequence[Cell]) -> list[int]:
        """Training seeds that every cell has."""
        return sorted(set.intersection(*(set(self.cells.get(cell, {})) for cell in cells)))

    def rows(self, cell: Cell) -> Rows:
        """Outcomes of a cell as `vispeg.evaluation.statistics` compares them; none where nothing was played."""
        return rows(self.all(cell), lambda e: (e.seed, e.configuration))

    def aligned(self, policy: str, worlds: Sequence[str]) -> dict[str, np.ndarray] | None:
        """World -> (k, n) successes of one policy, row i the same network and column j the same seed in all worlds.

        None where the worlds share no network, or the networks no episode.
        """
        sides = [self.rows(Cell(policy, w)) for w in worlds]
        networks = self.networks([Cell(policy, w) for w in worlds])
        shared = [set(side[t]) for side in sides for t in networks]
        seeds = sorted(set.intersection(*shared), key=repr) if shared else []
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
    """Outcomes as `vispeg.evaluation.statistics` compares them: training seed -> episode -> 0 or 1.

    Args:
        episodes: of one policy.
        name: what an episode is known by; the same seed is the same start and draw for everybody. A real robot's trial
            is known by its policy and training seed too, for its number is no start.
        value: what is compared of an episode.
    """
    found: dict[int, dict[Hashable, Any]] = {}
    for e in episodes:
        known = name(e) if e.world_hash else (e.policy, e.train_seed, name(e))
        found.setdefault(e.train_seed, {})[known] = value(e)
    return found
