"""The visible shapes of a MuJoCo model as triangles in the axes of their geoms, for pages that draw them."""

from __future__ import annotations

import mujoco
import numpy as np

from vispeg.robots.solids import box, capsule, solid

G = mujoco.mjtGeom
SECTIONS = 24  # number of sides that approximate a circle
BARE = (150, 158, 168), (21, 101, 179)  # alternating colours of links without shapes
HIDDEN = 3  # geom groups from this on are collision shapes and markers


def visible(model: mujoco.MjModel) -> list[int]:
    """Return the geoms to draw: in a body with shapes that are for display only, those; in other bodies all."""
    transparent = (model.geom_rgba[:, 3] == 0) & (model.geom_matid < 0)
    drawn = (model.geom_group < HIDDEN) & ~transparent
    collides = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
    for_display = np.zeros(model.nbody, bool)  # bodies with shapes that do not collide
    for_display[model.geom_bodyid[drawn & ~collides]] = True
    for_display[0] = False  # shapes of the world body belong to different objects
    return [int(g) for g in np.flatnonzero(drawn & ~(collides & for_display[model.geom_bodyid]))]


def skeleton(model: mujoco.MjModel) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Return capsules that stand for moving links without shapes: (body, vertices (V, 3), m, faces (F, 3)).

    A link is a body with all bodies fixed to it. Its capsules reach from its joint to the next joints; at the end of a
    chain, to twice the distance of its centre of mass. Vertices are in the body's axes.
    """
    shaped = {int(model.body_weldid[model.geom_bodyid[g]]) for g in visible(model)}
    bare = [b for b in range(1, model.nbody) if model.body_weldid[b] == b and b not in shaped]
    if not bare:
        return []
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    ends: dict[int, list[np.ndarray]] = {b: [] for b in bare}
    for b in range(1, model.nbody):
        parent = int(model.body_weldid[model.body_parentid[b]])
        if model.body_weldid[b] == b and parent in ends:
            ends[parent].append(data.xpos[b].copy())
    for b in bare:
        if not ends[b]:
            members = np.flatnonzero(model.body_weldid == b)
            mass = model.body_mass[members]
            centre = data.xipos[members]
            middle = np.average(centre, axis=0, weights=mass) if mass.sum() > 0 else data.xpos[b]
            ends[b] = [2 * middle - data.xpos[b]]
    lengths = {b: [float(np.linalg.norm(end - data.xpos[b])) for end in ends[b]] for b in bare}
    reach = sum(max(of_body) for of_body in lengths.values())
    radius = max(0.035 * reach, 0.005)  # about the thickness of a wrist for an arm of 1 m
    out = []
    for b in bare:
        axes = data.xmat[b].reshape(3, 3)
        for end, length in zip(ends[b], lengths[b], strict=True):
            vertices, faces = capsule(radius, length / 2, SECTIONS)
            vertices = vertices + (0.0, 0.0, length / 2)  # from the origin along z
            if length > 1e-9:
                turn, quat = np.empty(9), np.empty(4)
                mujoco.mju_quatZ2Vec(quat, axes.T @ (end - data.xpos[b]))
                mujoco.mju_quat2Mat(turn, quat)
                vertices = vertices @ turn.reshape(3, 3).T
            out.append((b, vertices.astype(np.float32), faces.astype(np.uint32)))
    return out


def rgba_of(model: mujoco.MjModel, g: int) -> tuple[float, ...]:
    """Return the colour and opacity (4,) of a geom, 0 to 1: its own, or its material's."""
    material = int(model.geom_matid[g])
    rgba = model.geom_rgba[g]
    if material >= 0 and np.allclose(rgba, (0.5, 0.5, 0.5, 1.0)):  # MuJoCo's default: no colour of its own
        rgba = model.mat_rgba[material]
    return tuple(float(c) for c in rgba)


def colour_of(model: mujoco.MjModel, g: int) -> tuple[float, ...]:
    """Return the colour (3,) of a geom, 0 to 1: its own, or its material's."""
    return rgba_of(model, g)[:3]


def shape_of(model: mujoco.MjModel, g: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return vertices (V, 3), m, and faces (F, 3) of a geom in its own axes; None for other kinds of geom."""
    if model.geom_type[g] == G.mjGEOM_PLANE:
        made = box(np.array([*(s if s > 0 else 2.0 for s in model.geom_size[g, :2]), 5e-4]))
    else:
        made = solid(model, g, SECTIONS)
    return None if made is None else (made[0].astype(np.float32), made[1].astype(np.uint32))


def simplified(vertices: np.ndarray, faces: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Simplify a mesh to at most `most` faces: vertices in one cell of a grid are merged at their mean.

    The cells grow until no more than `most` faces are left; collapsed faces are dropped (Rossignac and Borrel,
    "Multi-resolution 3D approximations for rendering complex scenes", 1993).
    """
    if len(faces) <= most:
        return vertices, faces
    low, extent = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    cells = 96.0
    while True:
        at = np.floor((vertices - low) / max(extent / cells, 1e-12)).astype(np.int64)
        _, cell, count = np.unique(at, axis=0, return_inverse=True, return_counts=True)
        new = cell.reshape(-1)[faces]
        new = new[(new[:, 0] != new[:, 1]) & (new[:, 1] != new[:, 2]) & (new[:, 2] != new[:, 0])]
        _, first = np.unique(np.sort(new, axis=1), axis=0, return_index=True)
        if len(first) <= most or cells < 2:
            break
        cells *= 0.85
    means = np.zeros((len(count), 3))
    np.add.at(means, cell.reshape(-1), vertices)
    used, index = np.unique(new[np.sort(first)], return_inverse=True)
    return (means / count[:, None])[used].astype(np.float32), index.reshape(-1, 3).astype(np.uint32)
