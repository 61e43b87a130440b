"""The surface of a part of the cell as a triangle mesh, in the frame of a site, as pose estimators need it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

G = mujoco.mjtGeom
SECTIONS = 64  # number of sides that approximate a circle


def part_mesh(scene: Any, part: str, site: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (v, 3) in m and triangles (f, 3) of a part of the nominal scene, in the frame of a site.

    Args:
        scene: a `vispeg.robots.scene.Scene`.
        part: name of one of its parts, made of boxes, cylinders, spheres, capsules and meshes.
        site: name of the site in whose frame the vertices are.

    Raises:
        ValueError: the part has a geom of another type.
    """
    import trimesh

    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    frame, pieces = data.site(site), list[Any]()
    for name in scene.parts[part]:
        geom = model.geom(name)
        kind, size = int(geom.type[0]), np.asarray(geom.size)
        if kind == G.mjGEOM_MESH:
            mesh, i = model.mesh(int(geom.dataid[0])), int(geom.dataid[0])
            first, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
            start, faces = int(model.mesh_faceadr[i]), int(model.mesh_facenum[i])
            solid = trimesh.Trimesh(model.mesh_vert[first : first + count], model.mesh_face[start : start + faces])
        elif kind == G.mjGEOM_BOX:
            solid = trimesh.creation.box(2 * size)
        elif kind == G.mjGEOM_CYLINDER:
            solid = trimesh.creation.cylinder(size[0], 2 * size[1], sections=SECTIONS)
        elif kind == G.mjGEOM_SPHERE:
            solid = trimesh.creation.icosphere(3, size[0])
        elif kind == G.mjGEOM_CAPSULE:
            solid = trimesh.creation.capsule(2 * size[1], size[0], count=(SECTIONS, SECTIONS))
            solid.apply_translation((0.0, 0.0, -solid.bounds.mean(axis=0)[2]))
        else:
            raise ValueError(f"{name}: a geom of type {kind} cannot be made a mesh")
        world = np.asarray(solid.vertices) @ data.geom(name).xmat.reshape(3, 3).T + data.geom(name).xpos
        vertices = (world - frame.xpos) @ frame.xmat.reshape(3, 3)
        pieces.append(trimesh.Trimesh(vertices, solid.faces))
    union: Any = trimesh.util.concatenate(pieces)
    return np.asarray(union.vertices), np.asarray(union.faces)
