"""A block with a hole: wedges around the mouth and plates around these for contact, and one smooth mesh to be drawn.

The frame of the hole has its origin at the centre of the mouth, z up and out of the hole. A hole with n flat walls is
exact. A round hole is the polygon around the circle: its walls are at the radius, and its corners at most
radius (1/cos(pi/n) - 1) further out (Coxeter, Regular Polytopes, 2.8). The clearance is never less than stated.

In contact, each piece that a part touches has the stiffness of a whole surface. If the wedges reached the edge of the
block, a part on the block's top would touch many of them, and the top would be as many times too stiff. So the wedges
end at a square around the mouth, and four plates form the rest of the top. A block that is too small for this square
consists of wedges alone. A soft part that sinks in can still meet the sides of pieces. `TOP` is a single box without a
hole, for contact that is known to stay away from the mouth.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from vispeg.robots.furniture import TOUCHED, UNTOUCHED

ROUND_ERROR = 2e-5  # m: greatest distance of a corner of a round hole from its circle
MESH = mujoco.mjtGeom.mjGEOM_MESH
WALL, PLATE = "hole_wall", "hole_plate"  # names of the wedges and plates, before their numbers
TOP = "hole_top"  # a box without a hole, cheap in contact; it has no contact until its contype is set to `TOUCHED`
FLAT = 2e-3  # m: width of the wedges' top around the bevel, so that no wedge is too thin
FLOOR = 0.02  # m: material below the hole
CONTACT = {"contype": TOUCHED, "conaffinity": 0, "group": 3, "rgba": (0.2, 0.6, 0.9, 0.4)}  # geoms that are not drawn


def sides(radius: float, error: float = ROUND_ERROR) -> int:
    """Return the number of walls, a multiple of 4, whose corners are at most `error` (m) outside `radius` (m)."""
    n = math.pi / math.acos(radius / (radius + error))
    return max(16, 4 * math.ceil(n / 4))


def polygon(n: int, apothem: float) -> np.ndarray:
    """Return the corners (n, 2) of a regular polygon, counterclockwise; its first side faces +x."""
    angle = np.pi * (2 * np.arange(n) - 1) / n
    return apothem / np.cos(np.pi / n) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def cut(outline: np.ndarray, normal: tuple[float, float], reach: float = 0.0) -> np.ndarray:
    """Cut a convex outline (n, 2) to the part (k, 2) where `normal . x >= reach` (Sutherland and Hodgman 1974)."""
    above = outline @ np.array(normal) - reach
    out = []
    for p, q, a, b in zip(outline, np.roll(outline, -1, 0), above, np.roll(above, -1), strict=True):
        if a >= 0:
            out.append(p)
        if a * b < 0:
            out.append(p + (q - p) * a / (a - b))
    return np.array(out)


def wedge(i: int, n: int, apothem: float, outline: np.ndarray, depth: float, chamfer: float) -> np.ndarray:
    """Return the corners (k, 3), m, of a wedge, one wall of which faces the hole's axis.

    Args:
        i: number of the wedge, from 0.
        n: number of walls of the hole.
        apothem: distance of a wall from the axis, m.
        outline: (m, 2) outer edge of the wedges, counterclockwise, m.
        depth: depth of the hole, m.
        chamfer: height and width of the 45 deg bevel at the mouth, m; 0 for none.
    """
    start, end = np.pi * (2 * i - 1) / n, np.pi * (2 * i + 1) / n  # angles of its two radial sides
    middle = (math.cos(2 * np.pi * i / n), math.sin(2 * np.pi * i / n))
    sector = cut(cut(outline, (-math.sin(start), math.cos(start))), (math.sin(end), -math.cos(end)))
    layers = [(apothem, -depth), (apothem, -chamfer), (apothem + chamfer, 0.0)]
    return np.concatenate([_at(cut(sector, middle, reach), z) for reach, z in layers])


def add_walls(spec: mujoco.MjSpec, body, n: int, apothem: float, outer: float, depth: float, chamfer: float) -> None:
    """Add wedges, plates and the bottom of the hole to `body`, for contact only (group 3).

    Args:
        spec, body: the spec, and the body whose frame is that of the hole.
        n: number of walls of the hole.
        apothem: distance of a wall from the axis, m.
        outer: distance of the block's sides from the axis, m.
        depth: depth of the hole, m.
        chamfer: height and width of the 45 deg bevel at the mouth, m; 0 for none.
    """
    square, block = polygon(4, apothem + chamfer + FLAT), polygon(n, outer)
    fits = np.hypot(*square[0]) < outer
    corners = [wedge(i, n, apothem, square if fits else block, depth, chamfer) for i in range(n // 4)]
    _add(spec, body, corners, WALL)
    if fits:  # four plates like the sails of a windmill, which do not overlap
        sail = cut(cut(block, (1, 0), square[0, 0]), (0, 1), square[0, 1])
        _add(spec, body, [np.concatenate([_at(sail, 0.0), _at(sail, -depth)])], PLATE)
    box = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": (outer, outer, depth / 2), "pos": (0, 0, -depth / 2)}
    body.add_geom(name=TOP, mass=0.0, **CONTACT | box | {"contype": UNTOUCHED})
    size = (outer, outer, FLOOR / 2)
    body.add_geom(
        name="hole_bottom", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=(0, 0, -depth - FLOOR / 2), **CONTACT
    )


def _at(outline: np.ndarray, z: float) -> np.ndarray:
    return np.column_stack([outline, np.full(len(outline), z)])


def _add(spec: mujoco.MjSpec, body, quarter: list[np.ndarray], name: str) -> None:
    """Add the pieces of a quarter of the block four times around the axis, numbered counterclockwise."""
    for k, corners in enumerate(quarter):
        spec.add_mesh(name=f"{name}{k}", uservert=corners.ravel().tolist())
    for i in range(4 * len(quarter)):
        turn, k = divmod(i, len(quarter))
        half = math.pi / 4 * turn
        quat = (math.cos(half), 0, 0, math.sin(half))
        body.add_geom(name=f"{name}{i}", type=MESH, meshname=f"{name}{k}", quat=quat, **CONTACT)


def visual(n: int, apothem: float, outer: float, depth: float, chamfer: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (v, 3) in m and triangles (f, 3) of the block with its hole, for drawing.

    Faces share no vertices, so that edges stay sharp. The arguments are as for `add_walls`.
    """
    turn = np.pi * (2 * np.arange(n + 1) - 1) / n  # corners of the polygon
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
        low = np.column_stack([r0 * ring, np.full(n + 1, z0)])
        high = np.column_stack([r1 * ring, np.full(n + 1, z1)])
        vertices.append(np.concatenate([low, high]))
        i = np.arange(n) + start
        if r1 > 0:
            faces += [np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)]
        else:  # all upper corners are one point on the axis
            faces.append(np.stack([i, i + 1, i + n + 1], 1))
    return np.concatenate(vertices), np.concatenate(faces)
