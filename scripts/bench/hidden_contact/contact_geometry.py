"""A round peg in a chamfered round hole, analytically: where they overlap, how deep, and which way it pushes.

Frame of the hole: origin at the centre of its mouth, z up and out of it. The solid around the hole is, in a half plane
through the axis, the convex corner z < 0, rho - z > R + c, rho > R (top, 45 degree chamfer, wall), and the bottom
z < -depth; beyond the block's edge stands the table. The peg is a cylinder that ends in a flat disk.

Contacts: 24 points of the peg's rim against the planes, 24 points of the hole's outer mouth circle against the peg's
disk, the rim's deepest point in the wall and in the chamfer, the hole's inner edge against the peg's side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RING = 24
ANGLES = 2 * np.pi * np.arange(RING) / RING
COS, SIN = np.cos(ANGLES), np.sin(ANGLES)
PLANE, WALL, EDGE = 0, 1, 2  # groups of contacts that share a patch of friction
GROUP = np.array([PLANE] * (2 * RING) + [WALL, WALL, EDGE])
SHARE = np.array([1 / 8] * (2 * RING) + [1.0, 1.0, 1.0])  # of the stiffness of one contact
ROOT = np.sqrt(0.5)


@dataclass
class Shape:
    """Sizes of rows, (n,) in m; `bump` is a chip's height on the wall at angle 0 and 8 mm below the mouth."""

    peg: np.ndarray
    hole: np.ndarray
    chamfer: np.ndarray
    depth: np.ndarray
    block: np.ndarray
    table: np.ndarray  # height of the table's top, m
    pad: np.ndarray  # thickness of a soft pad on top
    bump: np.ndarray


def _unit(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size = np.sqrt(x * x + y * y)
    size = np.where(size > 1e-12, size, 1.0)
    return x / size, y / size


def contacts(tip: np.ndarray, axis: np.ndarray, s: Shape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (n, k, 3) m, normals on the peg (n, k, 3) and depths (n, k) m, above 0 in overlap; hole's frame.

    Args:
        tip: (n, 3) centre of the peg's end.
        axis: (n, 3) unit vector from the tip up along the peg, less than 30 degrees from z.
        s: sizes.
    """
    n = len(tip)
    points, normals = np.zeros((n, 2 * RING + 3, 3)), np.zeros((n, 2 * RING + 3, 3))
    depth = np.full((n, 2 * RING + 3), -1.0)
    ux, uy, uz = axis.T
    r, hole, c = s.peg[:, None], s.hole[:, None], s.chamfer[:, None]
    # the rim against the planes: e1, e2 span the disk
    e1 = np.stack([uz, np.zeros(n), -ux], axis=1)
    e1 /= np.sqrt(np.sum(e1 * e1, axis=1))[:, None]
    e2 = np.cross(axis, e1)
    rim = tip[:, None] + r[:, :, None] * (COS[:, None] * e1[:, None] + SIN[:, None] * e2[:, None])
    x, y, z = rim[..., 0], rim[..., 1], rim[..., 2]
    rho = np.sqrt(x * x + y * y)
    top = s.pad[:, None] - z
    over = np.minimum((rho - z - hole - c) * ROOT, rho - hole)
    on_top = np.where((top <= over) & (rho < s.block[:, None]), top, -1.0)
    low = np.maximum(-s.depth[:, None] - z, -1.0)
    inside = rho < hole + 2 * c
    beside = np.where(rho >= s.block[:, None], s.table[:, None] - z, -1.0)
    depth[:, :RING] = np.maximum(np.maximum(on_top, np.where(inside, low, -1.0)), beside)
    points[:, :RING], normals[:, :RING, 2] = rim, 1.0
    # the outer mouth circle against the disk
    mouth = hole + c
    mx, my = mouth * COS, mouth * SIN
    px, py, pz = mx - tip[:, :1], my - tip[:, 1:2], s.pad[:, None] - tip[:, 2:]
    along = px * ux[:, None] + py * uy[:, None] + pz * uz[:, None]
    radial2 = px * px + py * py + pz * pz - along * along
    under = (radial2 < r * r) & (along < 4e-3)
    depth[:, RING : 2 * RING] = np.where(under, along, -1.0)
    points[:, RING : 2 * RING] = np.stack([mx, my, np.broadcast_to(s.pad[:, None], mx.shape)], axis=2)
    normals[:, RING : 2 * RING] = axis[:, None]
    # the rim's deepest point in the wall, then in the chamfer
    for k, lean in ((2 * RING, 0.0), (2 * RING + 1, 1.0)):
        dx, dy = _unit(tip[:, 0] + lean * s.peg * ux, tip[:, 1] + lean * s.peg * uy)
        w = np.stack([dx, dy, -(dx * ux + dy * uy) / uz], axis=1)
        w /= np.sqrt(np.sum(w * w, axis=1))[:, None]
        p = tip + s.peg[:, None] * w
        rho = np.sqrt(p[:, 0] ** 2 + p[:, 1] ** 2)
        wall = rho - s.hole
        if lean == 0.0:
            near = np.exp(-((np.arctan2(p[:, 1], p[:, 0]) / 0.5) ** 2)) * (p[:, 2] < -0.008)
            wall = wall + s.bump * near
        bevel = (rho - p[:, 2] - s.hole - s.chamfer) * ROOT
        topside = s.pad - p[:, 2]
        in_wall = (wall <= bevel) & (wall < topside)
        in_bevel = (bevel < wall) & (bevel < topside)
        depth[:, k] = np.where(in_wall, wall, -1.0) if lean == 0.0 else np.where(in_bevel, bevel, -1.0)
        cx, cy = _unit(p[:, 0], p[:, 1])
        points[:, k] = p
        if lean == 0.0:
            normals[:, k, 0], normals[:, k, 1] = -cx, -cy
        else:
            normals[:, k, 0], normals[:, k, 1], normals[:, k, 2] = -cx * ROOT, -cy * ROOT, ROOT
    # the hole's inner edge against the peg's side
    span = (-s.chamfer - tip[:, 2]) / uz
    ax, ay = tip[:, 0] + span * ux, tip[:, 1] + span * uy
    dx, dy = _unit(ax, ay)
    edge = np.stack([s.hole * dx, s.hole * dy, -s.chamfer], axis=1)
    rel = edge - tip
    along = np.sum(rel * axis, axis=1)
    away = rel - along[:, None] * axis
    distance = np.sqrt(np.sum(away * away, axis=1))
    depth[:, -1] = np.where(along > 0, s.peg - distance, -1.0)
    points[:, -1] = edge
    normals[:, -1] = -away / np.maximum(distance, 1e-12)[:, None]
    return points, normals, depth


def gap(tip: np.ndarray, s: Shape) -> np.ndarray:
    """Return the distance (n,) m from the rim's lowest possible point to the highest surface under it.

    Above 0 nothing can touch.
    """
    rho = np.hypot(tip[:, 0], tip[:, 1])
    high = np.where(rho < s.block + s.peg, s.pad, s.table)
    return tip[:, 2] - high - 0.6 * s.peg
