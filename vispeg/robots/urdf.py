"""Read a URDF as a rigid arm, even if meshes are missing.

Links, inertias, joints, limits, couplings (`<mimic>`) and shapes whose files are found are used. `<dynamics>` (damping,
friction) is ignored: its numbers are rarely measured, and friction is an effect that is identified from recordings.
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.formats.guard import is_file
from vispeg.formats.xml_tree import read_xml
from vispeg.robots.arm import REFUSALS
from vispeg.robots.urdf_check import check_urdf

NAMED = 3  # meshes that a note names
READABLE = (".stl", ".obj", ".msh")
SPECK = 1e-9, 1e-12  # kg, kg m^2: given to a massless link between joints, as MuJoCo requires some inertia
LEAST = 1e-15  # kg m^2: mjMINVAL, below which MuJoCo refuses a moment of inertia
MOMENTS = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
# OURS are always set: links are not fused, so that massless frames (flange, tool0) stay, and visual shapes are kept.
# USUAL holds unless the file says otherwise: no mass is computed from shapes.
OURS = {"strippath": "false", "fusestatic": "false", "discardvisual": "false"}
USUAL = {"inertiafromgeom": "false"}


def read_urdf(path: Path) -> tuple[mujoco.MjSpec, dict[str, tuple[float, float]]]:
    """Return the arm as a spec, and {joint: (torque limit in N m, velocity limit in rad/s)} where the file states them.

    A limit of 0 or less counts as unknown and is returned as inf.

    Raises:
        UserError: the file is not a URDF, needs xacro, has impossible values, or MuJoCo cannot read it.
    """
    root = read_xml(path)
    if root.tag != "robot":
        raise UserError("not a URDF", file=path, expected="<robot>", got=f"<{root.tag}>")
    _refuse_xacro(root, path)
    check_urdf(root, path)
    _complete_ranges(root)
    stated = [(j.get("name", ""), j.find("limit")) for j in root.iter("joint")]
    limits = {name: _limits(name, limit, path) for name, limit in stated if limit is not None}
    options = _options(root, path)
    dropped = _resolve_meshes(root, path, options.get("meshdir", ""))
    _correct_inertias(root, path, options)
    for old in root.findall("mujoco"):
        root.remove(old)
    compiler = USUAL | {key: text for key, text in options.items() if key != "meshdir"} | OURS
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", compiler)
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    except REFUSALS as error:
        raise UserError(f"MuJoCo cannot read it: {error}", file=path) from error
    for joint in spec.joints:
        joint.damping, joint.frictionloss = [0.0, 0.0, 0.0], 0.0
        body = joint.parent
        if body.mass == 0.0:
            body.mass, body.explicitinertial = SPECK[0], True
            if not np.any(body.inertia) and not np.any(np.nan_to_num(body.fullinertia)):  # NaN: not given
                body.inertia = [SPECK[1]] * 3
    for geom in spec.geoms:
        visual = geom.contype == 0 and geom.conaffinity == 0
        geom.group = 2 if visual else 3
    for text in dropped:  # last, so that an error stands alone
        note(text)
    return spec, limits


def _complete_ranges(root: ET.Element) -> None:
    """Write the 0 that URDF means by a missing `lower` or `upper`; a joint with neither has no range.

    MuJoCo takes a joint with one of them as unlimited.
    """
    for limit in root.iterfind("joint/limit"):
        if limit.get("lower") or limit.get("upper"):
            for key in ("lower", "upper"):
                limit.set(key, limit.get(key) or "0")


def _limits(joint: str, limit: ET.Element, path: Path) -> tuple[float, float]:
    """Return a joint's limits of torque, N m, and velocity, rad/s; inf for an unknown one."""
    values = []
    for key in ("effort", "velocity"):
        text = limit.get(key)
        try:
            value = float(text) if text else 0.0
        except ValueError as error:
            raise UserError("not a number", file=path, key=f"{joint}.{key}", got=text) from error
        values.append(value if value > 0.0 else float("inf"))  # exporters write 0 for an unknown limit
    return values[0], values[1]


def _refuse_xacro(root: ET.Element, path: Path) -> None:
    """Raise UserError for a xacro file, which is a macro source from which a URDF is generated."""
    if any(str(element.tag).startswith("xacro:") for element in root.iter()):
        stem = path.name.partition(".")[0]
        # another name than the file's: the shell would empty the file before xacro reads it
        out = f"{stem}.urdf" if path.name != f"{stem}.urdf" else f"{stem}-expanded.urdf"
        raise UserError("needs xacro", file=path, expected=f"its result: xacro {path.name} > {out}")


def _options(root: ET.Element, path: Path) -> dict[str, str]:
    """Return the options of MuJoCo's compiler in the file. Raises UserError for a number that is not finite."""
    out: dict[str, str] = {}
    for compiler in root.findall("mujoco/compiler"):
        out |= compiler.attrib
    for key in ("boundmass", "boundinertia", "settotalmass"):
        try:
            finite = math.isfinite(float(out.get(key, "0")))
        except ValueError:
            finite = False
        if not finite:
            raise UserError("is not finite", file=path, key=f"compiler.{key}", expected="a number", got=out[key])
    return out


def _correct_inertias(root: ET.Element, path: Path, options: Mapping[str, str]) -> None:
    """Correct inertias that MuJoCo refuses, as its own options would, and name the links in a note.

    As with `balanceinertia`, all three moments become their mean if the largest exceeds the sum of the others. As with
    `boundinertia`, moments that are too small are raised; unlike there, also negative ones. Corrections that the file
    requests itself are not mentioned in the note.
    """
    asked = {"balance": options.get("balanceinertia") == "true", "bound": float(options.get("boundinertia", "0")) > 0}
    corrected: list[str] = []
    for link in root.findall("link"):
        inertia, mass = link.find("inertial/inertia"), link.find("inertial/mass")
        if inertia is None:
            continue
        tensor = np.zeros((3, 3))
        for key, (i, k) in MOMENTS.items():
            tensor[i, k] = tensor[k, i] = float(inertia.get(key) or 0)
        if not tensor.any() and (mass is None or not float(mass.get("value") or 0)):
            continue  # a frame without mass
        moments, axes = np.linalg.eigh(tensor)
        small, unequal = moments[0] < LEAST, False
        moments = np.maximum(moments, SPECK[1]) if small else moments
        if moments[0] + moments[1] < moments[2]:
            unequal, moments = True, np.full(3, moments.mean())
        if not small and not unequal:
            continue
        tensor = axes @ np.diag(moments) @ axes.T if moments[0] != moments[2] else np.diag(moments)
        for key, place in MOMENTS.items():
            inertia.set(key, repr(float(tensor[place])))
        if (small and not asked["bound"]) or (unequal and not asked["balance"]):
            corrected.append(f"{link.get('name')} ({'too small' if small else 'A + B < C'})")
    if corrected:
        cure = "corrected as by MuJoCo's balanceinertia and boundinertia"
        note(f"{path}: impossible inertias are {cure}: {', '.join(corrected)}")


def _resolve_meshes(root: ET.Element, path: Path, meshes: str) -> list[str]:
    """Make mesh paths absolute; drop shapes whose file is missing or has a format that MuJoCo does not read.

    `meshes` is the `meshdir` that the file states, in which meshes are looked for too, by path and by name alone.

    Returns:
        Notes on what was dropped.
    """
    missing, unread = list[str](), list[str]()
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            file = locate(name, path.parent)
            if file is None and meshes:
                file = locate(name, path.parent / meshes) or locate(Path(name).name, path.parent / meshes)
            if file is None or file.suffix.lower() not in READABLE:
                link.remove(shape)
                (missing if file is None else unread).append(f"{name} ({shape.tag} of {link.get('name')})")
            else:
                mesh.set("filename", str(file))
    packages = " (looked for in the folders above it and in ROS_PACKAGE_PATH)"
    packages = packages if any("package://" in name for name in missing) else ""
    reasons = (
        (missing, f"were not found{packages}"),
        (unread, "have a format that MuJoCo does not read (save them as .stl or .obj)"),
    )
    return [f"{path}: the arm is without meshes that {why}: {_some(names)}" for names, why in reasons if names]


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def locate(name: str, folder: Path) -> Path | None:
    """Return the file of a URDF's `filename`, or None if it does not exist.

    `package://NAME/rest` is looked for as `NAME/rest` in each folder of ROS_PACKAGE_PATH, in `folder` and in the
    folders above it; and as `rest` in those of these folders that are called NAME.
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
