"""The surfaces of a model's geoms as triangles, in the axes of each geom.

They are those of `trimesh.creation`, whose import takes 0.4 s, which planning a data set does without. MuJoCo's own
`MjsMesh.make_*` have no capsule, points inside the solid, and numbers of single precision.
"""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np

G = mujoco.mjtGeom
Surface = tuple[np.ndarray, np.ndarray]  # vertices (V, 3), m, and triangles (F, 3), counter-clockwise from outside
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))  # corners of each face


def solid(model: mujoco.MjModel, g: int, sections: int) -> Surface | None:
    """Return the surface of geom `g`, circles as `sections` sides; None for planes and others without an inside."""
    kind, size = G(int(model.geom_type[g])), model.geom_size[g]
    if kind == G.mjGEOM_MESH:
        m = int(model.geom_dataid[g])
        v, f = int(model.mesh_vertadr[m]), int(model.mesh_faceadr[m])
        vertices = model.mesh_vert[v : v + int(model.mesh_vertnum[m])]
        return vertices.astype(float), model.mesh_face[f : f + int(model.mesh_facenum[m])].copy()
    if kind == G.mjGEOM_BOX:
        return box(size)
    if kind == G.mjGEOM_CYLINDER:
        return turned(np.array([(0, -1), (1, -1), (1, 1), (0, 1)]) * size[:2], sections)
    if kind == G.mjGEOM_CAPSULE:
        return capsule(size[0], size[1], sections)
    if kind in (G.mjGEOM_SPHERE, G.mjGEOM_ELLIPSOID):
        vertices, faces = capsule(1.0, 0.0, sections)
        return vertices * (size if kind == G.mjGEOM_ELLIPSOID else size[0]), faces
    return None


def box(half: np.ndarray) -> Surface:
    """Return a box with these half edges (3,), m."""
    return CORNERS * half, np.array([(a, *two) for a, b, c, d in SIDES for two in ((b, c), (c, d))])


def capsule(radius: float, half: float, sections: int) -> Surface:
    """Return a cylinder about z of half length `half` with round caps; a sphere if that is 0."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 2 * (sections // 4) + 1)
    outline = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    lower, upper = outline[: len(angle) // 2 + 1], outline[len(angle) // 2 + (half == 0) :]  # a sphere has one equator
    return turned(np.concatenate([lower - (0, half), upper + (0, half)]), sections)


def turned(outline: np.ndarray, sections: int) -> Surface:
    """Return the solid that an outline (k, 2) of radius and height, upwards and between points on z, sweeps about z."""
    angle = 2 * np.pi * np.arange(sections) / sections
    radius, height = outline[1:-1, :1], np.tile(outline[1:-1, 1:], sections)
    rings = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=2)
    poles = [(0.0, 0.0, z) for z in outline[[0, -1], 1]]
    # indices of the vertices: each point of the rings, its neighbour on the ring, and the poles
    here = np.arange(rings.shape[0] * sections).reshape(-1, sections)
    beside = np.roll(here, -1, axis=1)
    low, high = np.full(sections, here.size), np.full(sections, here.size + 1)
    walls = (here[:-1], beside[:-1], beside[1:]), (here[:-1], beside[1:], here[1:])
    corners = (low, beside[0], here[0]), *walls, (high, here[-1], beside[-1])
    faces = [np.stack(three, axis=-1).reshape(-1, 3) for three in corners]
    return np.concatenate([rings.reshape(-1, 3), poles]), np.concatenate(faces)
