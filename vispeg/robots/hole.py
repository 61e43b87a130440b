"""A block with a hole in it: wedges around the mouth and plates about them for contact, one smooth mesh to be seen.

Frame: the hole's own, origin at the centre of its mouth, z up and out of it. A regular hole of n sides is exact; a
round one is a circle's tangent polygon, whose walls stand at the radius and whose corners are at most
radius (1/cos(pi/n) - 1) further out (Coxeter, Regular Polytopes, 2.8): the clearance is never less than stated.

Every piece that a part bears on is as stiff as a whole surface. Wedges as wide as the block would make its top as many
times too stiff, so they end in a square about the mouth, and the rest of the top is four plates around it; a block in
which that square has no room is wedges alone. Where a soft part sinks in, it still meets the sides of pieces: `TOP` is
one piece, for what is known to stay beside the mouth.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

ROUND_ERROR = 2e-5  # m: by how much a corner of a round hole may lie outside its circle
MESH = mujoco.mjtGeom.mjGEOM_MESH
WALL, PLATE = "hole_wall", "hole_plate"  # names of the wedges and plates, before their numbers
TOP = "hole_top"  # a box without a hole, quick to touch; nothing does unless it is given `TOUCHED`
TOUCHED, UNTOUCHED = 1, 2  # contype; every part of a cell looks for the first alone
FLAT = 2e-3  # m: of wedge about the bevel, at least, so that no wedge is thinner


def sides(radius: float, error: float = ROUND_ERROR) -> int:
    """Walls of a round hole of this radius (m), a multiple of 4, with corners no further out than `error` (m)."""
    n = math.pi / math.acos(radius / (radius + error))
    return max(16, 4 * math.ceil(n / 4))


def polygon(n: int, apothem: float) -> np.ndarray:
    """Corners (n, 2) of a regular polygon, counterclockwise; its first side faces +x."""
    angle = np.pi * (2 * np.arange(n) - 1) / n
    return apothem / np.cos(np.pi / n) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def cut(outline: np.ndarray, normal: tuple[float, float], reach: float = 0.0) -> np.ndarray:
    """Give the convex outline (k, 2) where `normal . x >= reach` (Sutherland and Hodgman 1974)."""
    above = outline @ np.array(normal) - reach
    out = []
    for p, q, a, b in zip(outline, np.roll(outline, -1, 0), above, np.roll(above, -1), strict=True):
        if a >= 0:
            out.append(p)
        if a * b < 0:
            out.append(p + (q - p) * a / (a - b))
    return np.array(out)


def wedge(i: int, n: int, apothem: float, outline: np.ndarray, depth: float, chamfer: float) -> np.ndarray:
    """Corners (k, 3) in m of wedge i of n, its wall facing the axis.

    Args:
        i, n: its number, walls of the hole.
        apothem: distance of a wall from the axis.
        outline: (m, 2) what the wedges fill, counterclockwise.
        depth: of the hole.
        chamfer: height and width of the 45 deg bevel at the mouth; 0 for none.
    """
    start, end = np.pi * (2 * i - 1) / n, np.pi * (2 * i + 1) / n  # the rays that it lies between
    middle = (math.cos(2 * np.pi * i / n), math.sin(2 * np.pi * i / n))
    sector = cut(cut(outline, (-math.sin(start), math.cos(start))), (math.sin(end), -math.cos(end)))
    layers = [(apothem, -depth), (apothem, -chamfer), (apothem + chamfer, 0.0)]
    return np.concatenate([_at(cut(sector, middle, reach), z) for reach, z in layers])


def add_walls(spec: mujoco.MjSpec, body, n: int, apothem: float, outer: float, depth: float, chamfer: float) -> None:
    """Add the wedges, the plates and the bottom of the hole to `body`, for contact only (group 3)."""
    square, block = polygon(4, apothem + chamfer + FLAT), polygon(n, outer)
    fits = np.hypot(*square[0]) < outer
    corners = [wedge(i, n, apothem, square if fits else block, depth, chamfer) for i in range(n // 4)]
    _add(spec, body, corners, WALL)
    if fits:  # like a windmill's sails, so that none lies upon another
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
    """Pieces of a quarter of the block, four times about the axis; numbered counterclockwise."""
    for k, corners in enumerate(quarter):
        spec.add_mesh(name=f"{name}{k}", uservert=corners.ravel().tolist())
    for i in range(4 * len(quarter)):
        turn, k = divmod(i, len(quarter))
        half = math.pi / 4 * turn
        quat = (math.cos(half), 0, 0, math.sin(half))
        body.add_geom(name=f"{name}{i}", type=MESH, meshname=f"{name}{k}", quat=quat, **CONTACT)


FLOOR = 0.02  # m: material below the hole
CONTACT = {"contype": TOUCHED, "conaffinity": 0, "group": 3, "rgba": (0.2, 0.6, 0.9, 0.4)}


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
