"""A user's gripper from an MJCF file: its shapes and inertia at the flange, with joints fixed as in the file.

The world frame of the file is the flange frame, z away from the arm. A site named `grasp` marks the upper end of the
held part; its z axis is that of the flange and points out of the gripper.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.formats.guard import is_file
from vispeg.robots import resources
from vispeg.robots.arm import compiled
from vispeg.robots.mjcf import read_mjcf

FILE = re.compile(r"(.+\.(?:xml|mjcf))(?:\+(peg\d+))?", re.IGNORECASE)  # a tool that is a file, and the peg it holds
GRASP = "grasp"
STRAIGHT = 1e-4  # m, and 1 - cos of the angle: greatest deviation of the site from the flange's axis
MESH = mujoco.mjtGeom.mjGEOM_MESH


@dataclass(frozen=True, eq=False)
class Gripper:
    """A gripper as a rigid tool, in the flange frame.

    Attributes:
        grasp: z of the upper end of the held part, m.
        reach: greatest z of the gripper, m.
        mass: kg.
        com: (3,) centre of mass, m.
        inertia: (3, 3) about the centre of mass, kg m^2.
        model, data: the gripper without joints, and its state, for the shapes.
    """

    grasp: float
    reach: float
    mass: float
    com: np.ndarray
    inertia: np.ndarray
    model: mujoco.MjModel
    data: mujoco.MjData

    def add(self, spec: mujoco.MjSpec, body: Any) -> None:
        """Add the gripper's shapes to a body; they collide with the scene, not with the arm.

        Visible geoms are named `gripper` with the index of the geom in the file.
        """
        m, quat = self.model, np.empty(4)
        touches = (m.geom_contype | m.geom_conaffinity) != 0
        shown = m.geom_group < 3
        if (shown & ~touches).any():  # as for arms: if there are shapes without contact, only these are drawn
            shown &= ~touches
        for g in range(m.ngeom):
            mujoco.mju_mat2Quat(quat, self.data.geom_xmat[g])
            place = {"pos": self.data.geom_xpos[g].copy(), "quat": quat.copy(), "rgba": m.geom_rgba[g], "mass": 0.0}
            contact = {"contype": 0, "conaffinity": int(touches[g]), "group": 0 if shown[g] else 3}
            name, kind = f"gripper{g}" if shown[g] else "", int(m.geom_type[g])
            if kind != MESH:
                body.add_geom(name=name, type=kind, size=m.geom_size[g].copy(), **place, **contact)
                continue
            mesh = int(m.geom_dataid[g])
            vertices = slice(m.mesh_vertadr[mesh], m.mesh_vertadr[mesh] + m.mesh_vertnum[mesh])
            faces = slice(m.mesh_faceadr[mesh], m.mesh_faceadr[mesh] + m.mesh_facenum[mesh])
            spec.add_mesh(
                name=f"tool{g}",
                uservert=m.mesh_vert[vertices].ravel().tolist(),
                userface=m.mesh_face[faces].ravel().tolist(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            )
            body.add_geom(name=name, type=MESH, meshname=f"tool{g}", **place, **contact)


def of(tool: str) -> tuple[Gripper, str] | None:
    """Return the gripper of a tool's name, and the peg after a `+` (or ""); None if the name is not a file.

    Raises:
        UserError: the file is missing, holds no gripper, or has no site `grasp` on the flange's axis.
    """
    match = FILE.fullmatch(tool)
    if match is None:
        return None
    if not is_file(match[1]):
        raise UserError("no such gripper", file=match[1], key="robot.tool")
    path = expanded(match[1]).resolve()
    return _read(path, resources.stamp(path)), match[2] or ""


def renamed(tool: Any, change: Callable[[str], str]) -> Any:
    """Return a tool with another path of its file; a tool that is not a file stays as it is."""
    match = FILE.fullmatch(tool) if isinstance(tool, str) else None
    return f"{change(match[1])}{tool[match.end(1) :]}" if match else tool


def stamp(tool: object) -> tuple[int, ...]:
    """Return `resources.stamp` of a tool's file; empty if the tool is not a file."""
    match = FILE.fullmatch(tool) if isinstance(tool, str) else None
    return resources.stamp(match[1]) if match and is_file(match[1]) else ()


@lru_cache(maxsize=8)
def _read(path: Path, stamp: tuple[int, ...]) -> Gripper:
    resources.forget_meshes()
    spec, _ = read_mjcf(path)
    for group in (spec.tendons, spec.equalities, spec.pairs, spec.excludes, spec.lights, spec.cameras, spec.joints):
        for element in list(group):
            spec.delete(element)
    if not any(site.name == GRASP for site in spec.sites):
        expected = f"a site '{GRASP}' at the upper end of what is held, its z axis out of the gripper"
        raise UserError(
            "no site that marks the held part", file=path, expected=expected, got=[s.name for s in spec.sites]
        )
    model = compiled(spec, str(path))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    site = model.site(GRASP).id
    at, axis = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)[:, 2]
    if np.hypot(*at[:2]) > STRAIGHT or axis[2] < 1 - STRAIGHT or at[2] <= 0:
        expected = "a position on the file's z axis with z > 0, and the site's z axis along the file's"
        what = "the site is off the flange's axis, not in front of it, or tilted"
        raise UserError(what, file=path, key=GRASP, expected=expected, got=at.round(5))
    mass = float(model.body_mass.sum())
    if not model.ngeom or mass <= 0:
        raise UserError("no gripper", file=path, expected="shapes with a mass, or bodies with an <inertial>")
    com = model.body_mass @ data.xipos / mass
    inertia = np.zeros((3, 3))
    for body in range(1, model.nbody):
        turn, r = data.ximat[body].reshape(3, 3), data.xipos[body] - com
        inertia += turn @ np.diag(model.body_inertia[body]) @ turn.T
        inertia += model.body_mass[body] * (r @ r * np.eye(3) - np.outer(r, r))  # parallel axes
    turns = data.geom_xmat.reshape(-1, 3, 3)
    middle = data.geom_xpos[:, 2] + np.einsum("ni,ni->n", turns[:, 2], model.geom_aabb[:, :3])
    reach = float((middle + (np.abs(turns[:, 2]) * model.geom_aabb[:, 3:]).sum(axis=1)).max())
    return Gripper(float(at[2]), reach, mass, com, inertia, model, data)
