"""What no effect of a camera is, and moves edges all the same: where things stand, and what light does to an edge."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vispeg.identify.pictures.points import Points, misplacement, pixels
from vispeg.identify.pictures.posture import LOOSE, Postures
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

if TYPE_CHECKING:
    from vispeg.identify.pictures.evidence import Item

FIXED = np.array([1e-3, 1e-3, 1e-3, 5e-3, 5e-3, 5e-3])  # m, rad: how well fixture and grip are known
LAID = np.array([1e-2, 1e-2, 1e-2, 3e-2, 3e-2, 3e-2])  # m, rad: ... and a board, by pictures of this camera alone
# px by which light and shadow shift edges: all that face one way, those between two parts, those of both, those at one
# place of a part, and those of two parts in one picture; measured between Filament's pictures in looks of S and the
# borders of the model
EDGE_BIAS, EDGE_BIAS_HERE = 0.1, 0.05
PLACE = 0.02  # m of a part that have one shading
SMALL = 1e-4  # m, rad: steps of derivatives


def _edges(p: Points, scale: np.ndarray, away: np.ndarray) -> list[np.ndarray]:
    """Columns (n,): what one standard deviation of each edge bias does, in units of the noise.

    Edges that even the freest model leaves away from their borders are known as badly as that: `away` (n,) is what it
    leaves, `scale` (n,) a pixel, both in those units.
    """
    facing = np.round(np.arctan2(p.normal[:, 1], p.normal[:, 0]) / (np.pi / 2)).astype(int) % 4
    one_way, out = np.column_stack([p.parts, facing]), []
    place = np.column_stack([p.body, facing, np.floor(p.local / PLACE).astype(int)])
    for labels in (facing[:, None], p.parts, one_way, place):
        for rows in _alike(labels):
            remainder = abs(scale[rows] @ away[rows]) / max(scale[rows] @ scale[rows], 1e-9)
            out.append(rows * max(EDGE_BIAS, remainder) * scale)
    return out + [rows * EDGE_BIAS_HERE * scale for rows in _alike(np.column_stack([one_way, p.frame]))]


def _alike(labels: np.ndarray) -> list[np.ndarray]:
    """(n,) bool for each different row of some labels (n, k): where it stands."""
    kinds, kind = np.unique(labels, axis=0, return_inverse=True)
    return [kind.ravel() == k for k in range(len(kinds))]


def _things(geometry: Geometry, p: Points) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """(n,) bool which points are of a thing, (3,) m what it turns about, (6,) m and rad how well its place is known."""
    scene, model = geometry.scene, geometry.model
    board = p.parts[:, 0] > len(scene.parts)
    middle = p.local[board].mean(axis=0) if board.any() else np.zeros(3)
    fixed = [(p.body == model.body(name).id, np.zeros(3), FIXED) for name in scene.things]
    return [thing for thing in (*fixed, (board, middle, LAID)) if thing[0].any()]


def nuisances(geometry: Geometry, item: Item, world: World, arm: Postures) -> tuple[np.ndarray, np.ndarray]:
    """Give what one standard deviation of each common unknown (n, k), and one rad of each joint in each frame, do."""
    p, sight, scene = item.points, item.sight, geometry.scene
    scale = np.sqrt(item.trust) * item.valid[:, 0] / item.sigma[0]
    here = pixels(geometry, sight, world, p)

    def effect_of(moved: np.ndarray) -> np.ndarray:
        return np.nan_to_num(np.sum((moved - here) * p.normal, axis=1)) * scale / SMALL

    common = []
    for rows, centre, sizes in _things(geometry, p):
        for axis in range(6):
            step = np.zeros(3)
            step[axis % 3] = SMALL
            shift = np.broadcast_to(step, p.local.shape) if axis < 3 else np.cross(step, p.local - centre)
            there = replace(p, local=p.local + np.where(rows[:, None], shift, 0))
            common.append(effect_of(pixels(geometry, sight, world, there)) * sizes[axis])
    (_, at), nj = np.unique(p.frame, return_inverse=True), len(scene.joints)
    joints = np.zeros((len(p.frame), (int(at.max(initial=-1)) + 1) * nj))
    for j in range(nj):
        joints[np.arange(len(at)), at * nj + j] = arm.slopes[:, j] * scale
    away = np.nan_to_num(misplacement(geometry, sight, world, p)) * scale
    posture = np.linalg.solve(joints.T @ joints + np.eye(joints.shape[1]) / LOOSE**2, joints.T @ away)
    common += _edges(p, scale, away - joints @ posture)
    return np.stack(common, 1) if common else np.zeros((len(p.frame), 0)), joints
