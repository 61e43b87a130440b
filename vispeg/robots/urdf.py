"""Reads a URDF as a rigid arm, whether or not its meshes are there.

What is taken: links, inertias, hinges, limits, and those shapes whose files are found. `<dynamics>` (damping, friction)
is not: the numbers found there are rarely measured, and friction is an effect, found from recordings.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import is_file
from vispeg.formats.xml_tree import read_xml
from vispeg.robots.arm import REFUSALS
from vispeg.robots.urdf_check import check_urdf

READABLE = (".stl", ".obj", ".msh")
SPECK = 1e-9, 1e-12  # kg, kg m^2: what a massless link between joints gets, as MuJoCo asks for some


def read_urdf(path: Path) -> tuple[mujoco.MjSpec, dict[str, tuple[float, float]]]:
    """The arm as a spec, and {joint: (effort limit in N m, velocity limit in rad/s)} where the file states them.

    Raises:
        UserError: not a URDF, or MuJoCo cannot read it.
    """
    root = read_xml(path)
    if root.tag != "robot":
        raise UserError("not a URDF", file=path, expected="<robot>", got=f"<{root.tag}>")
    check_urdf(root, path)
    limits = {j.get("name", ""): _limits(j, path) for j in root.iter("joint") if j.find("limit") is not None}
    _strip(root, path)
    for old in root.findall("mujoco"):
        root.remove(old)
    # fuse nothing: massless frames (flange, tool0) stay; no mass is guessed from shapes
    options = {"strippath": "false", "fusestatic": "false", "discardvisual": "false", "inertiafromgeom": "false"}
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", options)
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    except REFUSALS as error:
        raise UserError(f"MuJoCo cannot read it: {error}", file=path) from error
    for joint in spec.joints:
        joint.damping, joint.frictionloss = [0.0, 0.0, 0.0], 0.0
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        body = joint.parent
        if body.mass == 0.0:
            body.mass, body.explicitinertial = SPECK[0], True
            if not np.any(body.inertia) and not np.any(np.nan_to_num(body.fullinertia)):  # NaN: not given
                body.inertia = [SPECK[1]] * 3
    for geom in spec.geoms:
        visual = geom.contype == 0 and geom.conaffinity == 0
        geom.group = 2 if visual else 3
    return spec, limits


def _limits(joint: ET.Element, path: Path) -> tuple[float, float]:
    values = []
    for key in ("effort", "velocity"):
        text = joint.find("limit").get(key)  # type: ignore[union-attr]
        try:
            value = float(text) if text else 0.0
        except ValueError as error:
            raise UserError("not a number", file=path, key=f"{joint.get('name')}.{key}", got=text) from error
        values.append(value if value > 0.0 else float("inf"))  # 0 is how exporters write "not known"
    return values[0], values[1]


def _strip(root: ET.Element, path: Path) -> None:
    """Makes mesh paths absolute; drops shapes whose file is missing or of a kind that MuJoCo does not read."""
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            file = locate(mesh.get("filename", ""), path.parent)
            if file is None or file.suffix.lower() not in READABLE:
                link.remove(shape)
            else:
                mesh.set("filename", str(file))


def locate(name: str, folder: Path) -> Path | None:
    """The file that a URDF's `filename` means, or None.

    `package://NAME/rest` is looked for in every folder of ROS_PACKAGE_PATH and in `folder` and those above it, as
    `NAME/rest` or, inside the package itself, as `rest`.
    """
    folder = folder.resolve()
    if name.startswith("package://"):
        package, _, rest = name.removeprefix("package://").partition("/")
        roots = [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
        above = [folder, *folder.parents]
        tries = [r / package / rest for r in [*roots, *above]]
        tries += [r / rest for r in [*roots, *above] if r.name == package]
    else:
        tries = [folder / name.removeprefix("file://")]
    return next((t for t in tries if is_file(t)), None)
