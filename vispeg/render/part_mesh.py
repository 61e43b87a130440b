"""The surface of a part of the cell as a triangle mesh, in the frame of a site, as pose estimators need it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

G = mujoco.mjtGeom
SECTIONS = 64  # number of sides that approximate a circle
# corners of a box's sides, anticlockwise from outside; corner 4 x + 2 y + z is at x, y, z of 0 or 1
SIDES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


def part_mesh(scene: Any, part: str, site: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (v, 3) in m and triangles (f, 3) of a part of the nominal scene, in the frame of a site.

    Args:
        scene: a `vispeg.robots.scene.Scene`.
        part: name of one of its parts, made of boxes, cylinders, spheres, capsules and meshes.
        site: name of the site in whose frame the vertices are.

    Raises:
        ValueError: the part has a geom of another type.
    """
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    frame, vertices, faces, count = data.site(site), list[np.ndarray](), list[np.ndarray](), 0
    for name in scene.parts[part]:
        own, triangles = geom_mesh(model, model.geom(name).id)
        world = own @ data.geom(name).xmat.reshape(3, 3).T + data.geom(name).xpos
        vertices.append((world - frame.xpos) @ frame.xmat.reshape(3, 3))
        faces.append(triangles + count)
        count += len(own)
    return np.concatenate(vertices), np.concatenate(faces)


def geom_mesh(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (v, 3) in m and triangles (f, 3) of a geom, in its own frame, each vertex once.

    Raises:
        ValueError: it is not a box, cylinder, sphere, capsule or mesh.
    """
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == G.mjGEOM_MESH:
        i = int(model.geom_dataid[geom])
        first, start = model.mesh_vertadr[i], model.mesh_faceadr[i]
        # vertices at which normals differ are there several times
        points, place = np.unique(model.mesh_vert[first : first + model.mesh_vertnum[i]], axis=0, return_inverse=True)
        return points.astype(float), place.reshape(-1)[model.mesh_face[start : start + model.mesh_facenum[i]]]
    if kind == G.mjGEOM_BOX:
        corners = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1
        return corners * size, np.concatenate([SIDES[:, :3], SIDES[:, [0, 2, 3]]])
    quarter = np.linspace(0, np.pi / 2, SECTIONS // 4 + 1)
    arc = size[0] * np.stack([np.sin(quarter), -np.cos(quarter)], axis=1)  # radius and height, from the pole up
    if kind == G.mjGEOM_CYLINDER:
        half = size[:2] * [[0, -1], [1, -1]]
    elif kind == G.mjGEOM_SPHERE:
        half = arc[:-1]
    elif kind == G.mjGEOM_CAPSULE:
        half = arc - [0, size[1]]
    else:
        raise ValueError(f"{model.geom(geom).name}: a geom of type {kind} cannot be made a mesh")
    equator = arc[-1:] if kind == G.mjGEOM_SPHERE else arc[:0]
    return revolved(np.concatenate([half, equator, half[::-1] * [1, -1]]))


def revolved(profile: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the surface that a profile (k, 2) of radius and height makes about z; its ends lie on the axis."""
    turn = 2 * np.pi * np.arange(SECTIONS) / SECTIONS
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings = [np.column_stack([radius * circle, np.full(SECTIONS, height)]) for radius, height in profile[1:-1]]
    poles = [(0, 0, profile[0, 1]), (0, 0, profile[-1, 1])]
    one, last = np.arange(SECTIONS), (len(profile) - 3) * SECTIONS
    two, top = np.roll(one, -1), last + SECTIONS
    faces = [np.column_stack([two, one, 0 * one + top])]
    for low in range(0, last, SECTIONS):
        a, b, c, d = low + one, low + two, low + SECTIONS + two, low + SECTIONS + one
        faces += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    faces.append(np.column_stack([last + one, last + two, 0 * one + top + 1]))
    return np.concatenate([*rings, poles]), np.concatenate(faces)
