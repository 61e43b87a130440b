"""Nuisances that move edges without a camera effect: poses of fixture and part, and light that shifts an edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.core.rules import RULES
from vispeg.identify.pictures.points import Item, Points, pixels
from vispeg.identify.pictures.posture import Postures
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

SMALL = 1e-4  # m, rad: steps of the derivatives


def _edges(p: Points, scale: np.ndarray, away: np.ndarray) -> list[np.ndarray]:
    """Return columns (n,), each the effect of one standard deviation of one edge bias, in noise units.

    A bias belongs to a group of edges, such as those of one part. Its standard deviation is `edge_shift`, or the mean
    shift that the aligned world and fitted postures leave in that group, if that is larger; of the edges of one part,
    direction and frame it is `edge_shift_here`. `away` (n,) is what they leave at each point, `scale` (n,) one pixel,
    both in noise units.
    """
    facing = np.round(np.arctan2(p.normal[:, 1], p.normal[:, 0]) / (np.pi / 2)).astype(int) % 4
    one_way, out = np.column_stack([p.parts, facing]), []
    place = np.column_stack([p.body, facing, np.floor(p.local / RULES.edge_place).astype(int)])
    for labels in (facing[:, None], p.parts, one_way, place):
        for rows in _alike(labels):
            remainder = abs(scale[rows] @ away[rows]) / max(scale[rows] @ scale[rows], 1e-9)
            out.append(rows * max(RULES.edge_shift, remainder) * scale)
    return out + [rows * RULES.edge_shift_here * scale for rows in _alike(np.column_stack([one_way, p.frame]))]


def _alike(labels: np.ndarray) -> list[np.ndarray]:
    """Return for each distinct row of labels (n, k) a mask (n,) bool of its occurrences."""
    kinds, kind = np.unique(labels, axis=0, return_inverse=True)
    return [kind.ravel() == k for k in range(len(kinds))]


def _things(geometry: Geometry, p: Points) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return for each object its points (n,) bool, centre of rotation (3,) m and sigmas of its pose (6,) m, rad.

    Where a board was laid down is not known: its sigmas are so large that the pictures alone decide.
    """
    scene, model = geometry.scene, geometry.model
    board = p.parts[:, 0] > len(scene.parts)
    middle = p.local[board].mean(axis=0) if board.any() else np.zeros(3)
    fixed = [(p.body == model.body(name).id, np.zeros(3), np.repeat(RULES.thing_known, 3)) for name in scene.things]
    return [thing for thing in (*fixed, (board, middle, np.ones(6))) if thing[0].any()]


def nuisances(geometry: Geometry, item: Item, world: World, arm: Postures) -> tuple[np.ndarray, np.ndarray]:
    """Return columns (n, k) of the common unknowns, and columns (n, frames nj) of the joints in each frame.

    A column is the effect on each point, in noise units, of one standard deviation of an unknown or one rad of a joint.
    """
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
            shifted = replace(p, local=p.local + np.where(rows[:, None], shift, 0))
            common.append(effect_of(pixels(geometry, sight, world, shifted)) * sizes[axis])
    (_, at), nj = np.unique(p.frame, return_inverse=True), len(scene.joints)
    joints = np.zeros((len(p.frame), (int(at.max(initial=-1)) + 1) * nj))
    for j in range(nj):
        joints[np.arange(len(at)), at * nj + j] = arm.slopes[:, j] * scale
    away = np.nan_to_num(item.misplaced(geometry, world)) * scale
    posture = np.linalg.solve(joints.T @ joints + np.eye(joints.shape[1]) / RULES.posture_frame**2, joints.T @ away)
    common += _edges(p, scale, away - joints @ posture)
    return np.stack(common, 1) if common else np.zeros((len(p.frame), 0)), joints
