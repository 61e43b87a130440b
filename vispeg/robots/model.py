"""The robot model that the rest of the project uses: names, limits and a function that builds an MjSpec."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.core.paths import expanded
from vispeg.formats.format import enrol
from vispeg.formats.guard import is_file
from vispeg.robots import gripper, iiwa14, menagerie, tools
from vispeg.robots.arm import prepare
from vispeg.robots.declare import RobotConfig
from vispeg.robots.examples import write_mjcf, write_urdf
from vispeg.robots.mjcf import read_mjcf
from vispeg.robots.resources import forget_meshes, stamp
from vispeg.robots.urdf import read_urdf

GRAVITY = 9.81  # m/s^2
BUILT_IN = "iiwa14"
XACRO = ".xacro"
SUFFIXES = (".xml", ".mjcf", ".urdf")
Tool = str | Mapping[str, Any] | None


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A fixed-base arm with its declared tool and mounting. SI units, radians.

    Attributes:
        name: short name.
        source: origin of the numbers, such as a file.
        joints: hinge joint names, base to tip, (nj,).
        torque_limit: (nj,) N m, inf if unknown.
        velocity_limit: (nj,) rad/s, inf if unknown.
        range: (nj, 2) lower and upper limit, rad; infinite for an unlimited joint.
        flange: name of the flange site.
        links: names of the bodies that the joints turn, (nj,), in the order of `joints`.
        base: name of the body that the first joint is mounted on.
        build: function that returns a new MjSpec.
        home: (nj,) rad, posture to start from; empty if none is declared.
    """

    name: str
    source: str
    joints: tuple[str, ...]
    torque_limit: np.ndarray
    velocity_limit: np.ndarray
    range: np.ndarray
    flange: str
    links: tuple[str, ...]
    base: str
    build: Callable[[], mujoco.MjSpec] = field(repr=False)
    home: tuple[float, ...] = ()

    def spec(self) -> mujoco.MjSpec:
        """Return a new spec, which the caller may change.

        It has one motor per joint, of the joint's name, with torque in N m as input and without limits.
        """
        return self.build()

    def compile(self) -> mujoco.MjModel:
        """Compile `spec()`."""
        return self.spec().compile()


@enrol("URDF", write_urdf)
@enrol("MJCF", write_mjcf)
def load(
    robot: str | Path,
    tool: Tool = None,
    base_tilt: tuple[float, float] = (0.0, 0.0),
    declared: RobotConfig | None = None,
    moved: tuple[str, ...] | None = None,
) -> RobotModel:
    """Load a robot by name or from a file; the same arguments return the same object.

    Args:
        robot: `iiwa14`, a path to an MJCF or URDF, or a robot of MuJoCo Menagerie: a short name (see `vispeg robots`),
            a folder, or FOLDER/ENTRY, see `vispeg.robots.menagerie`.
        tool: the tool at the flange, see `vispeg.robots.tools.attach`.
        base_tilt: (roll, pitch) of the mounting, rad. The base is turned by Rx(roll) Ry(pitch), so gravity in the base
            frame is (Rx(roll) Ry(pitch))' (0, 0, -9.81).
        declared: flange, limits, damping and home posture that replace those of the file; its `model` and `tool` are
            ignored.
        moved: names of the hinges that stay movable. The others (of a gripper or a torso) are fixed at their initial
            position; their mass is kept. None: all stay movable.

    Raises:
        UserError: the robot or tool is unknown, or a file cannot be used.
    """
    carried = tool if isinstance(tool, str) or tool is None else _as_text(tool)
    tilt = np.asarray(base_tilt, float)
    if tilt.shape != (2,) or not np.isfinite(tilt).all():
        raise UserError("not a base tilt", expected="roll and pitch in rad", got=base_tilt)
    path = _file(str(robot))
    turn = float(tilt[0]), float(tilt[1])
    stamps = (stamp(path) if path else ()), gripper.stamp(carried)  # an edited file is read again
    return _load(str(path) if path else "", stamps, carried, turn, declared or RobotConfig(), moved)


def load_for(
    joints: Sequence[str], robot: str | Path, tool: Tool = None, base_tilt: tuple[float, float] = (0.0, 0.0)
) -> RobotModel:
    """Load the robot of a log; joints that the log lacks are fixed at their initial position, and a note names them.

    Args:
        joints: names of the joints in the log.
        robot, tool, base_tilt: as for `load`.

    Returns:
        The robot. It is the unchanged robot of `load` if the log has all of its joints, no joint, or a joint that the
        robot does not have.
    """
    whole = load(robot, tool, base_tilt)
    held = [joint for joint in whole.joints if joint not in joints]
    if not held or not joints or not set(joints) <= set(whole.joints):
        return whole
    note(f"{robot}: the log lacks {len(held)} of the robot's joints: held at rest, their mass stays: {', '.join(held)}")
    return load(robot, tool, base_tilt, moved=tuple(joint for joint in whole.joints if joint in joints))


def is_path(robot: str) -> bool:
    """Return whether `robot` is a path of a robot's file, not a name."""
    return Path(robot).suffix.lower() in SUFFIXES


def same(robot: str, other: str) -> bool:
    """Return whether two names or paths denote the same robot."""
    paths = is_path(robot) and is_path(other)
    return robot == other or (paths and expanded(robot).resolve() == expanded(other).resolve())


def available() -> list[str]:
    """Return the names that `load` can find on this computer without a download."""
    return [BUILT_IN, *menagerie.available()]


@lru_cache(maxsize=64)
def _load(
    file: str,
    stamps: tuple[tuple[int, ...], tuple[int, ...]],
    tool: str | None,
    tilt: tuple[float, float],
    declared: RobotConfig,
    moved: tuple[str, ...] | None,
) -> RobotModel:
    """Build the robot of a file, or the built-in one for ""; arguments are as in `load`, made hashable for the cache.

    `stamps` are those of the robot's and the tool's files. They are only part of the key.
    """
    home: tuple[float, ...] = ()
    if file:
        path = Path(file)
        forget_meshes()
        spec, limits = read_urdf(path) if path.suffix.lower() == ".urdf" else read_mjcf(path)
        name, source = path.stem, file
    else:
        spec, name, source = iiwa14.build(), BUILT_IN, "MuJoCo Menagerie kuka_iiwa_14"
        limits = {x.name.replace("link", "joint"): (x.torque, x.speed) for x in iiwa14.LINKS if x.limit is not None}
        spec.body("link7").add_site(name="flange", pos=iiwa14.FLANGE, group=4)
        spec.option.gravity = (0.0, 0.0, -GRAVITY)
        home = iiwa14.HOME
    arm = prepare(spec, limits, file or name, declared, moved)
    tools.attach(spec, arm.flange, json.loads(tool) if tool and tool.startswith("{") else tool)
    spec.option.gravity = tilted(np.array(spec.option.gravity), *tilt)
    arm.check(spec, file or name)
    return RobotModel(
        name=name,
        source=source,
        joints=arm.joints,
        torque_limit=arm.torque,
        velocity_limit=arm.speed,
        range=arm.range,
        flange=arm.flange,
        links=arm.links,
        base=arm.base,
        build=spec.copy,
        home=declared.home or home,
    )


def tilted(gravity: np.ndarray, roll: float, pitch: float) -> np.ndarray:
    """Return gravity (3,) in the axes of a base that is turned by Rx(roll) Ry(pitch), angles in rad: (Rx Ry)' g."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    return (rx @ ry).T @ gravity


def _as_text(tool: Mapping[str, Any]) -> str:
    """Return the numbers of a tool mapping as JSON, so that equal tools share one cached robot."""
    mass, com, inertia = tools.stated(tool)
    return json.dumps({"mass_kg": mass, "com_m": com.tolist(), "inertia_kgm2": inertia.tolist()})


def check_name(robot: str, file: Path | None = None, key: str | None = None) -> None:
    """Check that a robot's name is known. Files and downloads are checked later, when they are read.

    Args:
        robot: a name or a path; empty if the cell determines the robot.
        file, key: file and key of the name, for the error message.

    Raises:
        UserError: the name is unknown; the message lists the known ones.
    """
    named = robot not in ("", BUILT_IN) and Path(robot).suffix.lower() not in (*SUFFIXES, XACRO)
    if named and not menagerie.knows(robot):
        raise _unknown(robot, file, key)


def _unknown(robot: str, file: Path | None = None, key: str | None = None) -> UserError:
    """Return the error for an unknown name of a robot."""
    hint = "a name, or a path to an .xml (MJCF) or .urdf"
    if is_file(Path(robot) / "recording.yaml"):
        expected = f"{hint}, or a model; recordings are arguments of their own (--recording {robot})"
        return UserError("is a recording, not a robot", file=file or robot, key=key, expected=expected)
    if is_file(Path(robot) / "model.yaml"):
        inside = str(Path(robot) / "model.yaml")
        return UserError("is a folder, not a robot", file=file or robot, key=key, expected=f"its model, {inside}")
    names = dict.fromkeys([*available(), *menagerie.ARMS])
    return UserError("unknown robot", file=file, key=key, expected=hint, got=robot, choices=[*names])


def _file(robot: str) -> Path | None:
    """Return the file of a robot; None for the built-in robot. Raises UserError if there is none."""
    if robot == BUILT_IN:
        return None
    if Path(robot).suffix.lower() in SUFFIXES:
        if not is_file(robot):
            raise UserError("no such robot file", file=robot)
        return expanded(robot).resolve()
    if Path(robot).suffix.lower() == XACRO:
        out = Path(robot).name.partition(".")[0] + ".urdf"
        raise UserError("needs xacro", file=robot, expected=f"its result: xacro {Path(robot).name} > {out}")
    found = menagerie.find(robot)
    if found is None:
        raise _unknown(robot)
    return found
