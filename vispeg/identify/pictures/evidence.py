"""Compare picture edges with predicted borders: whitened misplacements for many worlds without a render.

Errors that no camera effect describes are nuisances with a covariance: the robot's joint errors in each frame (their
size is estimated from the pictures), the pose of the fixture, the part's pose in the gripper, and a small common
shift of all edges between two parts due to light or shadow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.rules import RULES
from vispeg.identify.channels import shows
from vispeg.identify.evidence import Evidence
from vispeg.identify.pictures.points import Item
from vispeg.identify.pictures.posture import Postures
from vispeg.identify.pictures.scatter import Scatter, columns_of
from vispeg.identify.pictures.unknowns import nuisances
from vispeg.identify.whitener import Whitener
from vispeg.robots.scene import Scene
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

RECENT = 16  # worlds whose residuals are kept


class BorderEvidence(Evidence):
    """Pictures of one cell, aligned once; worlds are compared by how they move the borders.

    Args:
        geometry: the cell.
        items: sights with their points, trust and noise.
        settled: the aligned world, at which errors are linearised.
        scatter: standard deviations of the joint angles in each frame and of a shift that depends on image position;
            estimated if None.
        freed: effects that the alignment freed in addition to the usual ones.
    """

    floor_from = "scatter about the aligned model, and shifts of edges due to appearance"
    changes_in = "px"  # unit of `least_change`

    def __init__(
        self,
        geometry: Geometry,
        items: Sequence[Item],
        settled: World,
        scatter: Scatter | None = None,
        freed: tuple[str, ...] = (),
    ):
        self.geometry, self.items, self.settled, self.freed = geometry, list(items), settled, freed
        self.recordings = []  # of `Evidence`: no signal of the joints is compared
        self.notes: list[str] = []
        self._arms = [Postures.of(geometry, item.sight, settled, item.points) for item in items]
        self._columns = [nuisances(geometry, i, settled, arm) for i, arm in zip(items, self._arms, strict=True)]
        self.scatter = scatter or Scatter.of(columns_of(geometry, self.items, settled, freed, self._columns))
        self._whiten = [Whitener.of(np.column_stack([common, self.robot * js])) for common, js in self._columns]
        self._whitened: list[tuple[World, np.ndarray]] = []

    @property
    def robot(self) -> float:
        """Standard deviation of each joint's angle in each frame, rad."""
        return self.scatter.robot

    @property
    def unit(self) -> str:
        """Unit of a misplacement."""
        return "px"

    @property
    def least_change(self) -> float:
        """Smallest RMS shift of the borders, px, that counts as an effect: more than a change of appearance makes."""
        return RULES.shift_px

    def sees(self, kind: Effect) -> bool:
        """Return whether an effect moves borders."""
        return shows(kind, "border")

    def misplaced(self, world: World) -> list[np.ndarray]:
        """Return for each item (n,) px along the normals from a world's borders to the edges; NaN without an edge."""
        return [item.misplaced(self.geometry, world) for item in self.items]

    def each_residual(self, worlds: Sequence[World]) -> Iterator[np.ndarray]:
        """Yield for each world the whitened misplacements of all points, flat; recent answers are cached."""
        return map(self._residual, worlds)

    def _residual(self, world: World) -> np.ndarray:
        for earlier, residual in self._whitened:
            if earlier == world:
                return residual
        parts = []
        for item, away, whiten in zip(self.items, self.misplaced(world), self._whiten, strict=True):
            parts.append(whiten(item.weighted(away)))
        out = np.concatenate(parts)
        self._whitened = [(world, out), *self._whitened[: RECENT - 1]]
        return out

    @property
    def least_gain(self) -> float:
        """Share of the held-out squared error that an added effect must remove."""
        return RULES.gain

    @property
    def most_effects(self) -> int:
        """Largest number of effects that a search may add."""
        return RULES.effects_few

    def blocks(self, seconds: float | None = None) -> np.ndarray:
        """Return the block (n,) of each residual entry: its image, since errors within an image are correlated.

        With `seconds` (as the judge asks) each part in an image is a block of its own, whatever the value: a shift
        common to the whole image, as by a joint error, has been whitened out.
        """
        out, start = [], 0
        for item in self.items:
            part = item.points.parts[:, 0] if seconds else np.zeros(len(item.points.frame), int)
            out.append(np.column_stack([item.points.frame + start, part]))
            start += len(item.sight)
        _, numbered = np.unique(np.concatenate(out), axis=0, return_inverse=True)
        return numbered.ravel()

    def common_errors(self) -> np.ndarray:
        """Return no columns, (n, 0): errors common to all pictures have been whitened out."""
        return np.zeros((sum(len(i.points.frame) for i in self.items), 0))

    def tells(self, difference: np.ndarray) -> np.ndarray:
        """Return whether each block distinguishes two worlds, (n,) bool: the losses differ by over 1, one reading's."""
        return np.abs(difference) > 1.0

    @property
    def scene(self) -> Scene:
        """The cell."""
        return self.geometry.scene

    def change(self, first: World, other: World) -> float:
        """Return the RMS px along the normals between two worlds' borders, over trusted points."""
        square = weight = 0.0
        for item, a, b in zip(self.items, self.misplaced(first), self.misplaced(other), strict=True):
            good = item.valid[:, 0] & np.isfinite(a - b)
            square, weight = square + float(np.sum((a - b)[good] ** 2)), weight + float(good.sum())
        return float(np.sqrt(square / max(weight, 1.0)))

    def postures(self, world: World) -> list[np.ndarray]:
        """Return for each item the most likely joint errors in a world, (frames, nj) rad, to add to the angles.

        They maximise the posterior of all nuisances, each a standard normal variable in units of its deviation.
        """
        out, nj = [], len(self.scene.joints)
        for item, away, (common, joints) in zip(self.items, self.misplaced(world), self._columns, strict=True):
            columns = np.concatenate([common, max(self.robot, 1e-6) * joints], axis=1)
            r = item.weighted(away)
            unknown = np.linalg.solve(columns.T @ columns + np.eye(columns.shape[1]), columns.T @ r)
            frames, posture = np.unique(item.points.frame), np.zeros((len(item.sight), nj))
            posture[frames] = self.robot * unknown[common.shape[1] :].reshape(-1, nj)
            out.append(posture)
        return out

    def part(self, first: int, step: int) -> BorderEvidence:
        """Return the evidence of every `step`-th frame, starting at `first`."""
        items = []
        for item in self.items:
            rows = item.points.frame % step == first
            items.append(replace(item, points=item.points.only(rows), trust=item.trust[rows]))
        return BorderEvidence(self.geometry, items, self.settled, self.scatter, self.freed)

    def errors(self, worlds: Sequence[World]) -> list[float]:
        """Return the RMS misplacement of trusted points under each world, px, without the most likely joint errors."""
        return [self._error(w) for w in worlds]

    def _error(self, world: World) -> float:
        square = weight = 0.0
        for item, away in zip(self.items, self.steadied(world), strict=True):
            good = np.isfinite(away)
            square += float(np.sum((item.trust * away**2)[good]))
            weight += float(np.sum(item.trust[good]))
        return float(np.sqrt(square / max(weight, 1e-9)))

    def steadied(self, world: World) -> list[np.ndarray]:
        """Return `misplaced` minus the effect of the most likely joint errors in each frame, (n,) px for each item."""
        rows = zip(self.items, self.misplaced(world), self.postures(world), self._arms, strict=True)
        return [away - np.sum(arm.slopes * posture[item.points.frame], axis=1) for item, away, posture, arm in rows]

    @property
    def floor(self) -> float:
        """RMS expected of a correct model, px: edge noise and the common shift of edges due to appearance."""
        return float(np.sqrt(np.mean([i.sigma[0] ** 2 for i in self.items]) + RULES.edge_shift**2))

    @property
    def floors(self) -> np.ndarray:
        """RMS expected of a correct model, (1,) px."""
        return np.array([self.floor])
