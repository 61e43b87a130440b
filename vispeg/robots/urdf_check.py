"""Check names, joint types and numbers of a URDF before MuJoCo reads it, because MuJoCo does not check them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from vispeg.core.errors import UserError

JOINTS = ("revolute", "continuous", "prismatic", "fixed")
LINKS = 1000  # greatest number of links, and of joints
LARGEST = 1e6  # kg, m, kg m^2, rad: larger numbers are taken for mistakes
NUMBERS = {  # tag -> attribute -> how many numbers it holds
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mimic": {"multiplier": 1, "offset": 1},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}


def check_urdf(root: ET.Element, path: Path) -> None:
    """Check names, joint types and numbers below `<robot>`; `path` is the file, for the error.

    Raises:
        UserError: a missing or repeated name, more than `LINKS` links or joints, a joint type not in `JOINTS`, a joint
            that mimics none that moves, or an impossible number: not as many as `NUMBERS` says, too large, an axis of
            length 0, inverted limits, or a negative mass.
    """
    for tag in ("link", "joint"):
        names: set[str] = set()
        for element in root.findall(tag):
            name = element.get("name")
            if not name:
                raise UserError(f"a {tag} without a name", file=path)
            if name in names:
                raise UserError(f"two {tag}s of one name", file=path, key=name)
            names.add(name)
            for child in element.iter():
                for key, count in NUMBERS.get(child.tag, {}).items():
                    _numbers(child, key, count, f"{name}.{child.tag}.{key}", path)
        if len(names) > LINKS:
            raise UserError(f"has too many {tag}s", file=path, expected=f"at most {LINKS}", got=len(names))
    for joint in root.findall("joint"):
        _joint(joint, path)
    _mimics(root, path)
    for link in root.findall("link"):
        mass = link.find("inertial/mass")
        if mass is not None and float(mass.get("value") or 0) < 0:  # that it is a number is checked above
            key = f"{link.get('name')}.mass"
            raise UserError("negative mass", file=path, key=key, expected="kg, zero or more", got=mass.get("value"))


def _joint(joint: ET.Element, path: Path) -> None:
    """Check a joint's type, axis and limits."""
    name, kind = joint.get("name"), joint.get("type")
    if kind == "floating":
        expected = 'a base that stands still: write type="fixed" where the arm is mounted'
        raise UserError("a floating joint", file=path, key=name, expected=expected)
    if kind not in JOINTS:
        raise UserError("a joint of an unknown type", file=path, key=name, got=kind, choices=JOINTS)
    axis = joint.find("axis")
    if axis is not None and kind != "fixed":
        xyz = _numbers(axis, "xyz", 3, f"{name}.axis", path)
        if xyz and math.hypot(*xyz) < 1e-6:
            raise UserError("an axis without a direction", file=path, key=f"{name}.axis", got=axis.get("xyz"))
    limit = joint.find("limit")
    if limit is None:
        return
    low, high = (_number(limit.get(key) or "0", f"{name}.{key}", path) for key in ("lower", "upper"))
    if low > high:
        raise UserError("limits are inverted", file=path, key=name, expected="lower <= upper", got=[low, high])


def _mimics(root: ET.Element, path: Path) -> None:
    """Check that every joint that mimics another mimics one that moves, and not itself."""
    moving = [joint.get("name", "") for joint in root.findall("joint") if joint.get("type") != "fixed"]
    for joint in root.findall("joint"):
        mimic = joint.find("mimic")
        others = [name for name in moving if name != joint.get("name")]
        if mimic is not None and joint.get("type") != "fixed" and mimic.get("joint") not in others:
            key, got = f"{joint.get('name')}.mimic", mimic.get("joint")
            raise UserError("no such joint to follow", file=path, key=key, got=got, choices=others)


def _numbers(element: ET.Element, key: str, count: int, where: str, path: Path) -> Sequence[float]:
    """Return the `count` numbers of an attribute, empty if the element lacks it; `where` names it in errors."""
    text = element.get(key)
    if text is None:
        return []
    values = [_number(word, where, path) for word in text.split()]
    if len(values) != count:
        raise UserError("wrong count of numbers", file=path, key=where, expected=count, got=text)
    if any(abs(value) > LARGEST for value in values):
        raise UserError("too large for an arm", file=path, key=where, expected=f"at most {LARGEST:g}", got=text)
    return values


def _number(text: str, where: str, path: Path) -> float:
    """Return a number, which may be infinite."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise UserError("not a number", file=path, key=where, got=text)
    return value
