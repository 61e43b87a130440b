"""The surface of a part of the cell as a triangle mesh, in the frame of a site, as pose estimators need it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from vispeg.robots.solids import solid

SECTIONS = 64  # number of sides that approximate a circle


def part_mesh(scene: Any, part: str, site: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (v, 3) in m and triangles (f, 3) of a part of the nominal scene, in the frame of a site.

    Args:
        scene: a `vispeg.robots.scene.Scene`.
        part: name of one of its parts, made of boxes, cylinders, spheres, capsules, ellipsoids and meshes.
        site: name of the site in whose frame the vertices are.

    Raises:
        ValueError: the part has a geom of another type.
    """
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    frame, vertices, faces, count = data.site(site), list[np.ndarray](), list[np.ndarray](), 0
    for name in scene.parts[part]:
        geom = data.geom(name)
        surface = solid(model, geom.id, SECTIONS)
        if surface is None:
            raise ValueError(f"{name}: a geom of type {int(model.geom_type[geom.id])} cannot be made a mesh")
        corners, triangles = surface
        points, index = np.unique(corners, axis=0, return_inverse=True)  # meshes repeat vertices at their edges
        world = points @ geom.xmat.reshape(3, 3).T + geom.xpos
        vertices.append((world - frame.xpos) @ frame.xmat.reshape(3, 3))
        faces.append(index.reshape(-1)[triangles] + count)
        count += len(world)
    return np.concatenate(vertices), np.concatenate(faces)
