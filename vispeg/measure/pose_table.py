"""Read a table of static poses, one per row: joint angles and a measured pose.

The header may leave units (degrees or radians, millimetres or metres) and the meaning of three orientation angles open.
Then each combination is one interpretation of the table (`Readings`). The one that fits the arm is taken; if two fit,
an error asks the user to state it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.core.errors import UserError
from vispeg.recordings.importers.guess.names import meaning, split
from vispeg.recordings.importers.guess.propose import Proposal, joint_columns, own_names
from vispeg.recordings.importers.mapping import FACTORS
from vispeg.recordings.tables.table import Dialect, Table
from vispeg.render.calibration.rigid import inverse

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
ANGLES = {"rad": 1.0, "deg": FACTORS["deg"]}
TURNS = {  # possible meanings of three orientation angles
    "rotation_vector": lambda v: Rotation.from_rotvec(v),
    "fixed_xyz": lambda v: Rotation.from_euler("xyz", v),
    "moving_xyz": lambda v: Rotation.from_euler("XYZ", v),
}
# words that end a column's name -> component of the position, of the quaternion, number of the orientation angle
POSITION = {"x": "x", "y": "y", "z": "z", "px": "x", "py": "y", "pz": "z", "tx": "x", "ty": "y", "tz": "z"}
QUATERNION = {"qw": "w", "qx": "x", "qy": "y", "qz": "z", "ow": "w", "ox": "x", "oy": "y", "oz": "z"}
THREE = {"rx": 0, "ry": 1, "rz": 2, "roll": 0, "pitch": 1, "yaw": 2, "wx": 0, "wy": 1, "wz": 2}
# first of three words of angles -> their possible meanings
MEANS = {"rx": (*TURNS,), "wx": ("rotation_vector",), "roll": ("fixed_xyz", "moving_xyz")}
# words in a column's name that say it is the tag's, that it is an orientation, that it belongs to a pose
OF_TAG = {"tag", "marker", "board", "target", "april", "apriltag", "aruco", "cam", "camera", "optical", "object"}
OF_TURN = {"quat", "quaternion", "rotation", "orientation", "ori", "rot", "rotvec", "rvec", "euler"}
OF_POSE = {"pose", "position", "pos", "translation", "trans", "tvec"} | OF_TURN
BEYOND = 2.2 * np.pi  # rad; angles of a static pose are smaller, so larger numbers are not in this unit
REACHED = 20.0  # m; positions of an arm are nearer, so larger numbers are not in this unit
BETTER = 1.5  # factor by which the misfit of every other interpretation must be larger


@dataclass(frozen=True)
class Readings:
    """One interpretation of a table.

    Attributes:
        angles: joint angles (n, nj) rad; None if none were asked for.
        position: (n, 3) m.
        turn: rotation matrices (n, 3, 3); None if the table has only positions.
        of_joints, of_pose: the choices that were made where the header is ambiguous, in words; "" for none.
    """

    angles: np.ndarray | None
    position: np.ndarray
    turn: np.ndarray | None
    of_joints: str
    of_pose: str

    @property
    def said(self) -> tuple[str, ...]:
        """All choices that were made, in words."""
        return tuple(text for text in (self.of_joints, self.of_pose) if text)


@dataclass(frozen=True)
class PoseReadings:
    """One interpretation of the columns of a pose.

    Attributes:
        position, turn: as for `Readings`.
        assumed_unit: key of LENGTHS that was taken where the header leaves the positions' unit open; "" where not.
        said: the choices that were made, in words.
    """

    position: np.ndarray
    turn: np.ndarray | None
    assumed_unit: str
    said: str


@dataclass(frozen=True)
class PoseColumns:
    """The columns of one pose.

    Attributes:
        position: names of the columns x, y, z.
        turn: names of the columns w, x, y, z of a quaternion, or of three angles; empty without orientation.
        form: `quaternion`, or the key of MEANS to which the angles' names belong; empty without orientation.
    """

    position: tuple[str, ...]
    turn: tuple[str, ...]
    form: str


def pose_columns(names: Sequence[str], file: Path) -> PoseColumns:
    """Return the columns of the only pose in a header.

    Raises:
        UserError: no complete position, an incomplete orientation or two of them, or two columns with one meaning.
    """
    found: dict[str, dict[str | int, str]] = {"position": {}, "quaternion": {}, "rx": {}, "roll": {}, "wx": {}}
    with_w = any(_words(name)[-1:] == ["w"] for name in names)
    for name in names:
        word = _word(name, with_w)
        for kind, key in (
            ("position", POSITION.get(word)),
            ("quaternion", QUATERNION.get(word)),
            (word if word in MEANS else _family(word), THREE.get(word)),
        ):
            if key is None:
                continue
            if key in found[kind]:
                expected = "one pose a row, its columns called x, y, z and qw .. qz, rx ry rz or roll pitch yaw"
                raise UserError(
                    "two columns of one name", file=file, key=f"{found[kind][key]}, {name}", expected=expected
                )
            found[kind][key] = name
    whole = {kind: columns for kind, columns in found.items() if len(columns) == (4 if kind == "quaternion" else 3)}
    if "position" not in whole:
        raise UserError("no measured position", file=file, expected="columns x, y and z", choices=names)
    turns = [kind for kind in found if kind != "position" and found[kind]]
    if len(turns) > 1 or any(kind not in whole for kind in turns):
        expected = "none, qw qx qy qz, rx ry rz, or roll pitch yaw"
        got = ", ".join(name for kind in turns for name in found[kind].values())
        raise UserError("not one orientation", file=file, expected=expected, got=got)
    order = {"quaternion": ("w", "x", "y", "z")}
    turn = tuple(whole[turns[0]][key] for key in order.get(turns[0], (0, 1, 2))) if turns else ()
    return PoseColumns(tuple(whole["position"][k] for k in "xyz"), turn, turns[0] if turns else "")


def readings(table: Table, joints: Sequence[str], form: str | None = None) -> list[Readings]:
    """Return all interpretations of a table that its header allows.

    Args:
        table: as `read_table` returns it.
        joints: the robot's joints; empty to read no angles.
        form: meaning of three orientation angles, a key of TURNS; None if not known.

    Raises:
        UserError: no pose, joints without columns, an empty cell, or values that are impossible in every unit.
    """
    file = table.file
    columns = pose_columns(table.names, file)
    check_form(form, [columns], file)
    angles = None if not joints else _angles(table, joints, {*columns.position, *columns.turn})
    of_joints = [(None, "")] if angles is None else _as_radians(*angles, file)
    ways = poses_of(table, columns, form)
    return [Readings(q, way.position, way.turn, said, way.said) for (q, said), way in product(of_joints, ways)]


def check_form(form: str | None, poses: Sequence[PoseColumns], file: Path) -> None:
    """Refuse a stated meaning of three angles, `form`, that is unknown, or that no pose of the table has a use for."""
    if form is None:
        return
    if form not in TURNS:
        raise UserError("not a meaning of three angles", key="--orientation", got=form, choices=TURNS)
    if not any(columns.form in MEANS for columns in poses):
        expected = "no --orientation, or a table with three angles: rx ry rz, or roll pitch yaw"
        raise UserError("no angles whose meaning could be stated", file=file, key="--orientation", expected=expected)


def poses_of(table: Table, columns: PoseColumns, form: str | None) -> list[PoseReadings]:
    """Return all interpretations of a pose; arguments and errors as for `readings`."""
    file = table.file
    values = _block(table, columns.position)
    lengths = _units(columns.position, LENGTHS, file)
    lengths = [unit for unit in lengths if float(np.abs(values).max()) * LENGTHS[unit] < REACHED]
    if not lengths:
        got = float(np.abs(values).max())
        raise UserError(
            "a position out of any arm's reach", file=file, key=columns.position[0], expected="m or mm", got=got
        )
    turns = [(None, "")] if not columns.turn else _turns(table, columns, form, file)
    out = []
    for unit, (turn, said) in product(lengths, turns):
        assumed = unit if len(lengths) > 1 else ""
        texts = (f"positions in {assumed}" if assumed else "", said)
        out.append(PoseReadings(values * LENGTHS[unit], turn, assumed, ", ".join(text for text in texts if text)))
    return out


def two_poses(table: Table) -> tuple[PoseColumns, PoseColumns]:
    """Return the columns of the robot's pose and of the tag's, in a table that has both.

    Raises:
        UserError: not two poses, names that do not say which one is the tag's, or a pose without orientation.
    """
    groups: dict[str, list[str]] = {}
    with_w = any(_words(name)[-1:] == ["w"] for name in table.names)
    for name in table.names:
        if name in table.columns and _word(name, with_w) in {*POSITION, *QUATERNION, *THREE}:
            groups.setdefault("_".join(word for word in _words(name)[:-1] if word not in OF_POSE), []).append(name)
    tags = [prefix for prefix in groups if set(prefix.split("_")) & OF_TAG]
    robots = [prefix for prefix in groups if prefix not in tags]
    if len(tags) != 1 or len(robots) != 1:
        expected = "flange_x .. flange_qz and tag_x .. tag_qz, or joint angles (with --robot) and one pose"
        raise UserError("not the robot's pose and a tag's", file=table.file, expected=expected, choices=table.names)
    robot, tag = (pose_columns(groups[prefix], table.file) for prefix in (robots[0], tags[0]))
    for columns in (robot, tag):
        if not columns.turn:
            expected = "qw qx qy qz, rx ry rz, or roll pitch yaw"
            raise UserError("a pose without orientation", file=table.file, key=columns.position[0], expected=expected)
    return robot, tag


def motions(poses: np.ndarray) -> np.ndarray:
    """Return the angle (rad) and the path along the screw axis (m), (m, 2), of motions between poses (n, 4, 4).

    Motions are those between rows that are one, two and three rows apart. Both numbers are the same in every frame, so
    that motions of a flange can be compared with those of a tag in the view of the flange's camera.
    """
    out = []
    for step in range(1, min(4, len(poses))):
        between = poses[:-step] @ inverse(poses[step:])
        turn = Rotation.from_matrix(between[:, :3, :3]).as_rotvec()
        angle = np.linalg.norm(turn, axis=1)
        along = np.einsum("ni,ni->n", turn / np.maximum(angle, 1e-9)[:, None], between[:, :3, 3])
        out.append(np.stack([angle, along], axis=1))
    return np.concatenate(out)


def together(
    robots: Sequence[tuple[np.ndarray, str]], tags: Sequence[tuple[np.ndarray, str]], file: Path
) -> tuple[np.ndarray, np.ndarray, str]:
    """Choose the interpretations of robot poses and tag poses whose motions agree best.

    Args:
        robots, tags: interpretations: poses (n, 4, 4), and the choices in words.
        file: the table, for the error.

    Returns:
        Robot poses and tag poses, (n, 4, 4) each, and the choices in words.

    Raises:
        UserError: two interpretations fit about equally well.
    """
    pairs = list(product(robots, tags))
    misfits = []
    for (robot, _), (tag, _) in pairs:
        a, b = motions(robot), motions(tag)
        path = np.sqrt(np.mean(a[:, 1] ** 2))  # m, to which the misfit of the paths is relative
        angle_rms, path_rms = np.sqrt(np.mean((np.abs(a) - np.abs(b)) ** 2, axis=0))
        misfits.append(float(np.hypot(angle_rms, path_rms / max(path, 1e-12))))
    order = np.argsort(misfits)
    (robot, said), (tag, tag_said) = pairs[int(order[0])]
    if len(pairs) > 1 and misfits[order[1]] < BETTER * misfits[order[0]]:
        other = pairs[int(order[1])]
        expected = "units in the header (tag_x_mm), or --orientation"
        got = "; ".join(f"{a} or {b}" for a, b in ((said, other[0][1]), (tag_said, other[1][1])) if a != b)
        raise UserError("fits in two ways", file=file, expected=expected, got=got)
    return robot, tag, ", ".join(text for text in (said, tag_said) if text)


def best(ways: Sequence[Readings], misfit: Callable[[Readings], tuple[float, float]], file: Path) -> Readings:
    """Return the interpretation with the least misfit.

    Args:
        ways: at least one.
        misfit: returns the RMS residual of an interpretation, m and rad.
        file: the table, for the error.

    Raises:
        UserError: another interpretation fits about equally well.
    """
    if len(ways) == 1:
        return ways[0]
    misfits = []
    for way in ways:
        spread = float(np.std(way.position))  # misfits are compared relative to it, as units differ
        metres, radians = misfit(way)
        misfits.append(float(np.hypot(metres / max(spread, 1e-12), radians)))
    order = np.argsort(misfits)
    first, second = ways[int(order[0])], ways[int(order[1])]
    if misfits[order[1]] < BETTER * misfits[order[0]] or misfits[order[1]] < 1e-9:
        differs = [f"{a} or {b}" for a, b in zip(first.said, second.said, strict=True) if a != b]
        expected = "units in the header (x_mm, q1_deg), or --orientation"
        raise UserError("fits in two ways", file=file, expected=expected, got="; ".join(differs))
    return first


def _words(name: str) -> list[str]:
    """Return the words of a column's name without its unit: `tip_x [mm]` -> tip, x."""
    bare = re.sub(r"[\[(].*?[\])]", "", name).strip()
    return [word for word in split(bare) if word not in (*LENGTHS, *ANGLES, "degrees", "radians")]


def _word(name: str, with_w: bool) -> str:
    """Return the pose component of a column: `tip_x` x, `ee.qw` qw, `orientation.x` qx if there is a w, else rx."""
    words = _words(name)
    if not words:
        return ""
    if words[-1] in "xyzw" and OF_TURN & set(words[:-1]):
        return ("q" if with_w else "r") + words[-1]
    return words[-1]


def _family(word: str) -> str:
    """Return the key of MEANS to which a word of an orientation angle belongs, such as `roll` for `yaw`."""
    return {"r": "rx", "w": "wx"}.get(word[:1], "roll") if word not in ("roll", "pitch", "yaw") else "roll"


def _angles(table: Table, joints: Sequence[str], taken: set[str]) -> tuple[np.ndarray, list[str]]:
    """Return joint angles (n, nj) as they are in the table, and the unit that each column's name states, or ""."""
    numeric = [name for name in table.names if name in table.columns and name not in taken]
    named = own_names([meaning(name, {}) for name in numeric], joints, table)
    out = Proposal(table.file, [], [], {}, Dialect())
    # measured angles, else columns labelled as joint 3 or a3, else any names of letters with a number
    measured = [m for m in named if m.quantity == "q" and not m.commanded]
    measured = measured or [m for m in named if re.fullmatch(r"(j|a|joint|axis)_?\d+", m.label or "", re.IGNORECASE)]
    measured = measured or [m for m in named if re.fullmatch(r"[A-Za-z]+[ _]?\d+.*", m.name)]
    found = joint_columns(measured, joints, "q", out) if measured else {}
    lacking = [joint for joint in joints if joint not in found]
    if lacking:
        said = f"no angles of {', '.join(lacking)}"
        raise UserError(
            said, file=table.file, expected="columns called as the joints, or q1, q2, ..", choices=table.names
        )
    return _block(table, [found[joint].name for joint in joints]), [found[joint].unit for joint in joints]


def _as_radians(values: np.ndarray, stated: Sequence[str], file: Path) -> list[tuple[np.ndarray, str]]:
    """Return all interpretations of joint angles (n, nj): rad, and the choice in words, "" if their names state it.

    Raises:
        UserError: a unit that is not an angle's, or impossible angles.
    """
    if not {*stated} - {""} <= {*ANGLES}:
        got = ", ".join(sorted({*stated} - {"", *ANGLES}))
        raise UserError("not angles of joints", file=file, expected="rad or deg", got=got)
    if all(stated):
        return [(values * [ANGLES[unit] for unit in stated], "")]
    most = float(np.abs(values[:, [not unit for unit in stated]]).max())
    units = [u for u in ANGLES if most * ANGLES[u] < BEYOND]
    if not units:
        raise UserError("impossible joint angles", file=file, expected="rad or deg", got=most)
    return [(values * [ANGLES[unit or u] for unit in stated], f"joint angles in {u}") for u in units]


def _turns(table: Table, columns: PoseColumns, form: str | None, file: Path) -> list[tuple[np.ndarray, str]]:
    """Return all interpretations of an orientation: rotations (n, 3, 3), and the choice in words."""
    values = _block(table, columns.turn)
    if columns.form == "quaternion":
        length = np.linalg.norm(values, axis=1)
        bad = np.flatnonzero(np.abs(length - 1) > 1e-2)
        if len(bad):
            got = round(float(length[bad[0]]), 4)
            raise UserError(
                "not a unit quaternion", file=file, key=table.row(int(bad[0])), expected="length 1", got=got
            )
        return [(Rotation.from_quat(values, scalar_first=True).as_matrix(), "")]
    forms = MEANS[columns.form] if form is None else (form,)
    units = [u for u in _units(columns.turn, ANGLES, file) if np.abs(values).max() * ANGLES[u] < BEYOND]
    if not units:
        raise UserError("impossible orientation angles", file=file, key=columns.turn[0], expected="rad or deg")
    return [
        (TURNS[name](values * ANGLES[unit]).as_matrix(), f"orientation as {name} in {unit}")
        for name, unit in product(forms, units)
    ]


def _units(names: Sequence[str], units: Mapping[str, float], file: Path) -> list[str]:
    """Return the unit that the columns' names state, as a list of one, or all keys of `units` if they state none.

    Raises:
        UserError: columns in different units.
    """
    patterns = {"rad": "rad(ians)?", "deg": "deg(rees)?|°"}
    found = set()
    for name in names:
        hits = [
            u for u in units if re.search(rf"(?<![A-Za-z])({patterns.get(u, u)})(?![A-Za-z])", name.replace("_", " "))
        ]
        found.add(hits[0] if hits else "")
    if len(found) > 1:
        raise UserError("columns in different units", file=file, key=", ".join(names), expected="one unit")
    unit = found.pop()
    return [unit] if unit else list(units)


def _block(table: Table, names: Sequence[str]) -> np.ndarray:
    """Return columns as an array (n, k). Raises UserError: an empty cell."""
    out = np.stack([table.number(name) for name in names], axis=1)
    bad = np.argwhere(~np.isfinite(out))
    if len(bad):
        key = f"{table.row(int(bad[0][0]))}, column {names[int(bad[0][1])]}"
        raise UserError("a reading is missing", file=table.file, key=key)
    return out
