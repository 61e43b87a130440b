"""Estimate two variances: of joint errors in each frame, and of a shift that depends on image position.

A smear on the lens shifts edges by their position in the image, in all frames of a camera alike; joint errors shift
them by frame. Without the second variance the likelihood would attribute a smear to the joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from vispeg.core.rules import RULES
from vispeg.identify.pictures.align import LOOSE as PRIOR
from vispeg.identify.pictures.align import free_world
from vispeg.identify.pictures.points import Item
from vispeg.identify.space import Space
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

# px RMS over the image: a smaller shift is not visible, a larger one is outside the window in which edges are searched
FIELD = (0.0, *np.geomspace(0.05, 2.0, 8).tolist())
CELLS = (6, 5)  # of the image, across and down: correlation length of a smear, finer than lens distortion


@dataclass(frozen=True)
class Scatter:
    """Standard deviations of errors that the aligned model does not describe.

    Attributes:
        robot: of each joint's angle in each frame, rad.
        field: of the shift that depends on image position, px.
    """

    robot: float
    field: float

    @classmethod
    def of(cls, parts: Sequence[Columns]) -> Scatter:
        """Estimate by restricted likelihood from recordings, each with a shift field of its own.

        The fixed effects are the parameters that the alignment freed. Source of the criterion: Patterson and
        Thompson, Biometrika 58(3), 1971.
        """
        sizes = [(robot, field) for field in FIELD for robot in robots()]
        fits = dict(zip(sizes, likelihoods(parts, sizes), strict=True))
        best = max(fits, key=lambda sizes: fits[sizes])
        alone = max(robots(), key=lambda robot: fits[robot, 0.0])
        return cls(*best) if fits[best] > fits[alone, 0.0] + RULES.field_gain else cls(alone, 0.0)


@dataclass(frozen=True)
class Columns:
    """Effects of the unknowns on the readings (n) of a recording, in noise units.

    Attributes:
        common: (n, k) per standard deviation of each unknown shared by all frames.
        joints: (n, k) per rad of each joint in each frame.
        field: (n, k) per px of shift at each image position.
        fixed: (n, k) per typical size of each parameter that the alignment freed.
        readings: (n,).
    """

    common: np.ndarray
    joints: np.ndarray
    field: np.ndarray
    fixed: np.ndarray
    readings: np.ndarray


def robots() -> tuple[float, ...]:
    """Return the candidate standard deviations of a joint error in each frame, rad."""
    return 0.0, *np.geomspace(3e-5, RULES.posture_frame, 12).tolist()


def columns_of(
    geometry: Geometry,
    items: Sequence[Item],
    settled: World,
    freed: tuple[str, ...],
    known: Sequence[tuple[np.ndarray, np.ndarray]],
) -> list[Columns]:
    """Return the columns for each item, linearised at the aligned world; `known` are common unknowns and joints."""
    parts = zip(items, known, slopes(geometry, items, settled, freed), strict=True)
    return [Columns(*c, fields(i), fixed, i.weighted(i.misplaced(geometry, settled))) for i, c, fixed in parts]


def slopes(geometry: Geometry, items: Sequence[Item], settled: World, freed: tuple[str, ...]) -> list[np.ndarray]:
    """Return for each item the derivatives (n, k) of the weighted misplacement per typical size of each parameter.

    They are taken at the aligned world `settled`; `freed` are effects that the alignment freed beside the usual ones.
    """
    cameras = list(dict.fromkeys(i.sight.camera.name for i in items))
    world, free = free_world(settled, geometry.scene.joints, cameras, freed)
    space = Space(world, free)
    u = np.clip(space.start, *space.bounds)
    here, columns = _misplaced(geometry, items, space.at(u)), []
    for step, axis in zip(space.steps(u), np.eye(len(u)), strict=True):
        moved = _misplaced(geometry, items, space.at(u + step * axis))
        columns.append([i.weighted(m - h) / step for i, m, h in zip(items, moved, here, strict=True)])
    return [np.stack([c[i] for c in columns], 1) for i in range(len(items))]


def _misplaced(geometry: Geometry, items: Sequence[Item], world: World) -> list[np.ndarray]:
    return [item.misplaced(geometry, world) for item in items]


def fields(item: Item) -> np.ndarray:
    """Return columns (n, k) of a smooth random shift field over the image, 1 px in any direction, in noise units."""
    size = np.array([item.sight.camera.width, item.sight.camera.height])
    middles = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in CELLS)), axis=-1).reshape(-1, 2)
    place = (item.points.pixel + 0.5) / size * CELLS
    bumps = np.exp(-0.5 * np.sum((place[:, None] - middles) ** 2, axis=2))
    bumps /= np.linalg.norm(bumps, axis=1, keepdims=True)
    scale = np.sqrt(item.trust) * item.valid[:, 0] / item.sigma[0]
    return np.concatenate([bumps * (item.points.normal[:, [k]] * scale[:, None]) for k in range(2)], axis=1)


def likelihoods(parts: Sequence[Columns], sizes: Sequence[tuple[float, float]]) -> list[float]:
    """Return the restricted log likelihood of each (robot, field), from cross products of the columns."""
    products = []
    for c in parts:
        columns = np.column_stack([c.common, c.joints, c.field, c.fixed, c.readings])
        products.append((columns.T @ columns, [x.shape[1] for x in (c.common, c.joints, c.field)]))
    return [_likelihood(products, *size) for size in sizes]


def _likelihood(products: Sequence[tuple[np.ndarray, list[int]]], robot: float, field: float) -> float:
    """Return the restricted log likelihood of standard deviations `robot` (rad) and `field` (px).

    `products` are, for each recording, the cross products of its columns, and the numbers of its common, joint and
    field columns.
    """
    total, information, along = 0.0, np.zeros(()), np.zeros(())
    for square, counts in products:
        size, k = np.repeat([1.0, robot, field], counts), sum(counts)
        half = linalg.cholesky(size[:, None] * square[:k, :k] * size + np.eye(k), lower=True)
        taken = linalg.solve_triangular(half, size[:, None] * square[:k, k:], lower=True)
        whitened = square[k:, k:] - taken.T @ taken  # cross products of fixed effects and readings, whitened
        information, along = information + whitened[:-1, :-1], along + whitened[:-1, -1]
        total += float(whitened[-1, -1] + 2 * np.log(np.diag(half)).sum())
    information = information + np.eye(len(information)) / PRIOR**2
    total -= float(along @ np.linalg.solve(information, along))
    return -0.5 * (total + np.linalg.slogdet(information)[1])
