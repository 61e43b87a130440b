"""A block with a hole in it: a ring of convex wedges for contact, one smooth mesh to be seen.

Frame: the hole's own, origin at the centre of its mouth, z up and out of it. A regular hole of n sides is exact; a
round one is a circle's tangent polygon, whose walls stand at the radius and whose corners are at most
radius (1/cos(pi/n) - 1) further out (Coxeter, Regular Polytopes, 2.8): the clearance is never less than stated.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

ROUND_ERROR = 2e-5  # m: by how much a corner of a round hole may lie outside its circle
MESH = mujoco.mjtGeom.mjGEOM_MESH
WALL = "hole_wall"  # the wedges' names, before their numbers


def sides(radius: float, error: float = ROUND_ERROR) -> int:
    """Walls of a round hole of this radius (m), a multiple of 4, with corners no further out than `error` (m)."""
    n = math.pi / math.acos(radius / (radius + error))
    return max(16, 4 * math.ceil(n / 4))


def wedge(n: int, apothem: float, outer: float, depth: float, chamfer: float) -> np.ndarray:
    """Corners (10, 3) in m of one of the n wedges, its wall facing -x at x = apothem.

    Args:
        n: walls of the hole.
        apothem: distance of a wall from the axis.
        outer: the same for the block's outside.
        depth: of the hole.
        chamfer: height and width of the 45 deg bevel at the mouth; 0 for none.
    """
    slope = math.tan(math.pi / n)
    section = [(apothem, -depth), (apothem, -chamfer), (apothem + chamfer, 0.0), (outer, 0.0), (outer, -depth)]
    return np.array([(x, side * x * slope, z) for x, z in section for side in (-1, 1)])


def add_walls(spec: mujoco.MjSpec, body, n: int, apothem: float, outer: float, depth: float, chamfer: float) -> None:
    """Adds the wedges and the bottom of the hole to `body`, for contact only (group 3)."""
    corners = wedge(n, apothem, outer, depth, chamfer)
    spec.add_mesh(name="hole_wedge", uservert=corners.ravel().tolist())
    for i in range(n):
        half = math.pi * i / n
        quat = (math.cos(half), 0, 0, math.sin(half))
        body.add_geom(name=f"{WALL}{i}", type=MESH, meshname="hole_wedge", quat=quat, **CONTACT)
    size = (outer, outer, FLOOR / 2)
    body.add_geom(
        name="hole_bottom", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=(0, 0, -depth - FLOOR / 2), **CONTACT
    )


FLOOR = 0.02  # m: material below the hole
CONTACT = {"contype": 1, "conaffinity": 0, "group": 3, "rgba": (0.2, 0.6, 0.9, 0.4)}


def visual(n: int, apothem: float, outer: float, depth: float, chamfer: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) in m and triangles (f, 3) of the block with its hole, faces apart so that edges stay sharp."""
    m = max(n, 4)
    turn = np.pi * (2 * np.arange(m + 1) - 1) / n  # corners of the polygon
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) / np.cos(np.pi / n)
    profile = [  # from the outside bottom, over the top, down to the middle of the hole's bottom
        (outer, -depth - FLOOR),
        (outer, 0.0),
        (apothem + chamfer, 0.0),
        (apothem, -chamfer),
        (apothem, -depth),
        (0.0, -depth),
    ]
    vertices, faces = [], []
    for (r0, z0), (r1, z1) in zip(profile[:-1], profile[1:], strict=True):
        if (r0, z0) == (r1, z1):  # no chamfer
            continue
        start = sum(map(len, vertices))
        low = np.column_stack([r0 * ring, np.full(m + 1, z0)])
        high = np.column_stack([r1 * ring, np.full(m + 1, z1)])
        vertices.append(np.concatenate([low, high]))
        i = np.arange(m) + start
        quad = [np.stack([i, i + 1, i + m + 2], 1)]
        if r1 > 0:
            quad.append(np.stack([i, i + m + 2, i + m + 1], 1))
        else:
            quad = [np.stack([i, i + 1, i + m + 1], 1)]
        faces += quad
    return np.concatenate(vertices), np.concatenate(faces)
