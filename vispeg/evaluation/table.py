"""Episodes as matrices: the same training seeds and episode seeds in every cell that is compared."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.errors import UserError
from vispeg.evaluation.records import Episode

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

    def train_seeds(self, cells: Sequence[Cell]) -> list[int]:
        """Training seeds that every cell has."""
        return sorted(set.intersection(*(set(self.cells.get(c, {})) for c in cells)))

    def seeds(self, cells: Sequence[Cell]) -> list[tuple[int, str]]:
        """Episode seeds (with configuration) that every training seed of every cell has."""
        rows = [set(row) for cell in cells for row in self.cells.get(cell, {}).values()]
        return sorted(set.intersection(*rows)) if rows else []

    def outcomes(self, cell: Cell, seeds: Sequence[tuple[int, str]] | None = None) -> np.ndarray:
        """Successes (k, n) of one cell, training seeds by episodes, as float.

        Raises:
            UserError: the cell is empty, or its training seeds share no episode.
        """
        seeds = self.seeds([cell]) if seeds is None else seeds
        rows = [[float(row[s].success) for s in seeds] for _, row in sorted(self.cells.get(cell, {}).items())]
        return self._checked(rows, [cell])

    def aligned(self, policy: str, worlds: Sequence[str], control: str = "") -> dict[str, np.ndarray]:
        """World -> (k, n) successes of one policy, row i the same network and column j the same seed in all worlds.

        Raises:
            UserError: a world is missing, or nothing is shared.
        """
        cells = [Cell(policy, w, control) for w in worlds]
        for cell in cells:
            if cell not in self.cells:
                raise UserError(f"{policy} has no episodes there", got=cell.world, choices=self.worlds)
        networks = self.train_seeds(cells)
        shared = [set(self.cells[cell][t]) for cell in cells for t in networks]
        seeds = sorted(set.intersection(*shared)) if shared else []
        successes = {}
        for cell in cells:
            rows = [[float(self.cells[cell][t][s].success) for s in seeds] for t in networks]
            successes[cell.world] = self._checked(rows, cells)
        return successes

    def _checked(self, rows: list[list[float]], cells: Sequence[Cell]) -> np.ndarray:
        if not rows or not rows[0]:
            names = "; ".join(f"{c.policy} in {c.world}" for c in cells)
            raise UserError("no episodes with the same seeds, so nothing can be paired", got=names)
        return np.array(rows)
