"""Edges in pictures as evidence: whitened misplacements of predicted borders, for many worlds without a render.

What no effect of a camera is counts as nuisance with a covariance: the robot's own errors in each frame (their size is
estimated from the pictures), how the fixture stands and the part sits in the gripper, and that a light or a shadow
shifts all edges between two parts a little.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.rules import RULES
from vispeg.identify.channels import shows
from vispeg.identify.evidence import Evidence
from vispeg.identify.pictures.nuisance import Whitener
from vispeg.identify.pictures.points import Points, misplacement
from vispeg.identify.pictures.posture import Postures
from vispeg.identify.pictures.scatter import Scatter, columns_of
from vispeg.identify.pictures.sight import Sight
from vispeg.identify.pictures.unknowns import nuisances
from vispeg.robots.scene import Scene
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

PENALTY = 1e3  # noise units of a point that a world puts behind the camera


@dataclass(frozen=True)
class Item:
    """One sight's readings as a column, with the surface of a joint channel's item.

    Attributes:
        sight, points, trust: what was photographed, the border points in it, and how far each is trusted.
        sigma: (1,) px.
        valid: (n, 1) bool.
    """

    sight: Sight
    points: Points
    trust: np.ndarray
    sigma: np.ndarray
    kind = "border"
    beside = None
    nj = 1

    @cached_property
    def measured(self) -> np.ndarray:
        """(n, 1) px, what was measured: each edge's distance from its border."""
        return np.nan_to_num(self.points.along)[:, None]

    @cached_property
    def valid(self) -> np.ndarray:
        """(n, 1) bool."""
        return (self.trust > 0.05)[:, None]

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.sight.name


class BorderEvidence(Evidence):
    """Pictures of one cell, aligned once; worlds are compared by what they do to the borders.

    Args:
        geometry: the cell.
        items: sights with their points.
        settled: the world that the points were aligned with, at which errors are linearised.
        scatter: of each joint's angle in each frame, and of what hangs on the place in the image; estimated where None.
        freed: effects that the alignment freed beside the usual ones.
    """

    held: frozenset[tuple[str, str]] = frozenset()  # parameters that a fit leaves: none
    floor_from = "scatter about the freest model, and what a look shifts edges by"

    def __init__(
        self,
        geometry: Geometry,
        items: Sequence[Item],
        settled: World,
        scatter: Scatter | None = None,
        freed: tuple[str, ...] = (),
    ):
        self.geometry, self.items, self.settled, self.freed = geometry, list(items), settled, freed
        self.recordings = []
        self.notes: list[str] = []
        self._arms = [Postures.of(geometry, item.sight, settled, item.points) for item in items]
        self._columns = [nuisances(geometry, i, settled, arm) for i, arm in zip(items, self._arms, strict=True)]
        self.scatter = scatter or Scatter.of(columns_of(self, self._columns))
        self._whiten = [Whitener.of(np.column_stack([common, self.robot * js])) for common, js in self._columns]
        self._whitened: list[tuple[World, np.ndarray]] = []

    @property
    def robot(self) -> float:
        """Standard deviation of each joint's angle in each frame, rad."""
        return self.scatter.robot

    @property
    def unit(self) -> str:
        """Pixels."""
        return "px"

    changes_in = "px"

    @property
    def least_change(self) -> float:
        """How many px an effect has to move the borders by: more than looks shift them."""
        return RULES.shift_px

    def sees(self, kind: Effect) -> bool:
        """Whether an effect moves borders."""
        return shows(kind, "border")

    def misplaced(self, world: World) -> list[np.ndarray]:
        """Per item, (n,) px along the normals from a world's borders to the edges; NaN where there is none."""
        return [misplacement(self.geometry, item.sight, world, item.points) for item in self.items]

    def each_residual(self, worlds: Sequence[World]) -> Iterator[np.ndarray]:
        """Per world, the whitened misplacement of all points, flat."""
        return map(self._residual, worlds)

    def _residual(self, world: World) -> np.ndarray:
        for earlier, answer in self._whitened:
            if earlier == world:
                return answer
        parts = []
        for item, away, whiten in zip(self.items, self.misplaced(world), self._whiten, strict=True):
            parts.append(whiten(self.weighted(item, away)))
        out = np.concatenate(parts)
        self._whitened = [(world, out), *self._whitened[:15]]
        return out

    @staticmethod
    def weighted(item: Item, away: np.ndarray) -> np.ndarray:
        """Misplacements (n,) in units of the noise, those that are not trusted 0."""
        r = np.where(np.isnan(away) & np.isfinite(item.points.along), PENALTY, np.nan_to_num(away))
        return np.clip(r / item.sigma[0], -PENALTY, PENALTY) * np.sqrt(item.trust) * item.valid[:, 0]

    @property
    def least_gain(self) -> float:
        """Share of the held-out squared error that a step must remove."""
        return RULES.gain

    @property
    def most_effects(self) -> int:
        """Effects that a search may add."""
        return RULES.effects_few

    def blocks(self, seconds: float | None = None) -> np.ndarray:
        """Give the image of every residual entry, in the order of `residuals`: errors within an image hang together.

        Whatever the `seconds`, a test of single moments (above 0) takes each part in an image by itself: what moves all
        of an image alike, the robot's error, is whitened.
        """
        out, start = [], 0
        for item in self.items:
            part = item.points.parts[:, 0] if seconds else np.zeros(len(item.points.frame), int)
            out.append(np.column_stack([item.points.frame + start, part]))
            start += len(item.sight)
        _, numbered = np.unique(np.concatenate(out), axis=0, return_inverse=True)
        return numbered.ravel()

    def common_errors(self) -> np.ndarray:
        """(n, 0): what is off in all pictures alike is whitened."""
        return np.zeros((sum(len(i.points.frame) for i in self.items), 0))

    def tells(self, difference: np.ndarray) -> np.ndarray:
        """(n,) bool: a block whose squared residuals differ by less than one reading's tells nothing."""
        return np.abs(difference) > 1.0

    @property
    def scene(self) -> Scene:
        """The cell."""
        return self.geometry.scene

    def change(self, first: World, other: World) -> float:
        """RMS px along the normals between two worlds' borders, over trusted points."""
        square = weight = 0.0
        for item, a, b in zip(self.items, self.misplaced(first), self.misplaced(other), strict=True):
            good = item.valid[:, 0] & np.isfinite(a - b)
            square, weight = square + float(np.sum((a - b)[good] ** 2)), weight + float(good.sum())
        return float(np.sqrt(square / max(weight, 1.0)))

    def postures(self, world: World) -> list[np.ndarray]:
        """Per item, (frames, nj) rad to add to the measured angles: the robot's most likely errors in a world."""
        out, nj = [], len(self.scene.joints)
        for item, away, (common, joints) in zip(self.items, self.misplaced(world), self._columns, strict=True):
            columns = np.concatenate([common, max(self.robot, 1e-6) * joints], axis=1)
            r = self.weighted(item, away)
            unknown = np.linalg.solve(columns.T @ columns + np.eye(columns.shape[1]), columns.T @ r)
            frames, posture = np.unique(item.points.frame), np.zeros((len(item.sight), nj))
            posture[frames] = self.robot * unknown[common.shape[1] :].reshape(-1, nj)
            out.append(posture)
        return out

    def part(self, first: int, step: int) -> BorderEvidence:
        """Give the evidence of every `step`-th frame from `first` on."""
        items = []
        for item in self.items:
            rows = item.points.frame % step == first
            items.append(replace(item, points=item.points.only(rows), trust=item.trust[rows]))
        return BorderEvidence(self.geometry, items, self.settled, self.scatter, self.freed)

    def error(self, world: World) -> float:
        """RMS misplacement in px over trusted points, less what the robot's most likely errors make of it."""
        square = weight = 0.0
        for item, away in zip(self.items, self.steadied(world), strict=True):
            good = np.isfinite(away)
            square += float(np.sum((item.trust * away**2)[good]))
            weight += float(np.sum(item.trust[good]))
        return float(np.sqrt(square / max(weight, 1e-9)))

    def errors(self, worlds: Sequence[World]) -> list[float]:
        """`error` of each world."""
        return [self.error(w) for w in worlds]

    def steadied(self, world: World) -> list[np.ndarray]:
        """As `misplaced`, less what the robot's most likely errors in each frame make of it."""
        every = zip(self.items, self.misplaced(world), self.postures(world), self._arms, strict=True)
        return [away - np.sum(arm.slopes * posture[item.points.frame], axis=1) for item, away, posture, arm in every]

    @property
    def floor(self) -> float:
        """RMS in px of what a right model leaves: its edges' scatter, and what a look shifts all that face one way."""
        return float(np.sqrt(np.mean([i.sigma[0] ** 2 for i in self.items]) + RULES.edge_shift**2))

    @property
    def floors(self) -> np.ndarray:
        """(1,) the same."""
        return np.array([self.floor])
