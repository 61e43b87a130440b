"""The nominal KUKA LBR iiwa 14 R820: a table of its links, and the MjSpec built from it.

The numbers are those of MuJoCo Menagerie's `kuka_iiwa_14` (BSD-3-Clause, derived from Drake's model of the arm). There
is no armature, damping, friction or elasticity, since these are effects.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco

from vispeg.core.assets import assets

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class Link:
    """One body of the chain; it turns about its own z axis if `limit` is given.

    Attributes:
        name: body name; `linkN` carries `jointN`.
        pos, quat: pose in the parent, m and (w, x, y, z) before normalisation.
        mass: kg.
        com: centre of mass in the body's frame, m.
        inertia: diagonal about the centre of mass, along the body's axes, kg m^2.
        limit: the joint moves within +-limit rad; None for the fixed base.
        torque, speed: limits of the joint, N m and rad/s.
    """

    name: str
    pos: Vec3
    quat: tuple[float, float, float, float]
    mass: float
    com: Vec3
    inertia: Vec3
    limit: float | None = None
    torque: float = math.inf
    speed: float = math.inf


ONE, FLIP, TURN = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 1.0), (1.0, 1.0, 0.0, 0.0)

LINKS = (
    Link("base", (0, 0, 0), ONE, 5, (-0.1, 0, 0.07), (0.05, 0.06, 0.03)),
    Link("link1", (0, 0, 0.1575), ONE, 5.76, (0, -0.03, 0.12), (0.0333, 0.033, 0.0123), 2.96706, 320, 1.4835),
    Link("link2", (0, 0, 0.2025), FLIP, 6.35, (0.0003, 0.059, 0.042), (0.0305, 0.0304, 0.011), 2.0944, 320, 1.4835),
    Link("link3", (0, 0.2045, 0), FLIP, 3.5, (0, 0.03, 0.13), (0.025, 0.0238, 0.0076), 2.96706, 176, 1.7453),
    Link("link4", (0, 0, 0.2155), TURN, 3.5, (0, 0.067, 0.034), (0.017, 0.0164, 0.006), 2.0944, 176, 1.3090),
    Link("link5", (0, 0.1845, 0), FLIP, 3.5, (0.0001, 0.021, 0.076), (0.01, 0.0087, 0.00449), 2.96706, 110, 2.2689),
    Link("link6", (0, 0, 0.2155), TURN, 1.8, (0, 0.0006, 0.0004), (0.0049, 0.0047, 0.0036), 2.0944, 40, 2.3562),
    Link("link7", (0, 0.081, 0), FLIP, 1.2, (0, 0, 0.02), (0.001, 0.001, 0.001), 3.05433, 40, 2.3562),
)
FLANGE = (0.0, 0.0, 0.045)  # m, in link7
HOME = (0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0)  # rad: the flange in front, looking down

GREY, ORANGE = (0.86, 0.87, 0.88, 1.0), (1.0, 0.42, 0.05, 1.0)
PARTS = (("", GREY), ("_ring", ORANGE))  # mesh file suffix and colour


def build() -> mujoco.MjSpec:
    """Return the bare arm: bodies, hinges and visual meshes; the caller adds actuators and the flange site."""
    spec = mujoco.MjSpec()
    spec.modelname = "iiwa14"
    spec.compiler.degree = False
    folder = assets() / "iiwa14"
    parent = spec.worldbody
    for link in LINKS:
        norm = math.hypot(*link.quat)
        body = parent.add_body(
            name=link.name,
            pos=link.pos,
            quat=[c / norm for c in link.quat],
            mass=link.mass,
            ipos=link.com,
            inertia=link.inertia,
            explicitinertial=True,
        )
        if link.limit is not None:
            body.add_joint(
                name=link.name.replace("link", "joint"),
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=(0, 0, 1),
                range=(-link.limit, link.limit),
                limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            )
        for suffix, colour in PARTS:
            file = folder / f"{link.name}{suffix}.stl"
            if file.is_file():  # not every link has a ring
                spec.add_mesh(name=file.stem, file=str(file), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
                body.add_geom(
                    name=file.stem,
                    type=mujoco.mjtGeom.mjGEOM_MESH,
                    meshname=file.stem,
                    rgba=colour,
                    group=2,
                    contype=0,
                    conaffinity=0,
                )
        parent = body
    return spec
