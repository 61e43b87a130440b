"""Hand-eye calibration from robot poses and a tag's poses in the camera, as `vispeg camera place` does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vispeg.api.recording.convert import placed
from vispeg.api.result import Result
from vispeg.core.errors import UserError
from vispeg.core.provenance import digest, here
from vispeg.core.rotation import quaternion
from vispeg.measure.pose_table import PoseReadings, Readings, check_form, poses_of, readings, together, two_poses
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Table
from vispeg.render.calibration.from_poses import Placed, place
from vispeg.render.calibration.hand_eye import Mount
from vispeg.render.calibration.known import read_intrinsics
from vispeg.render.calibration.rigid import from_quaternion
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import save_cameras
from vispeg.report.text.summary import Block, Line
from vispeg.report.text.tables import Column, Sheet
from vispeg.report.write import write_json
from vispeg.robots.model import load
from vispeg.sim.compiled import flange_pose

FORMAT = "vispeg-camera-place/1"
Ways = list[tuple[np.ndarray, str]]  # possible interpretations of a table: poses (n, 4, 4), and what each assumes
NEAR, FAR = 0.08, 3.0  # m, plausible distances of a flange from the arm's base
ODD = 3.0  # standard deviations above which a row is reported


@dataclass(frozen=True, repr=False)
class CameraPlace(Result):
    """The pose of a camera with 95 % intervals.

    Attributes:
        record: content of results.json, see docs/cameras.md.
        camera: the camera with its intrinsics; None if none were given.
        sources: files that were read.
    """

    record: Mapping[str, Any]
    camera: Camera | None
    sources: tuple[str | Path, ...] = ()
    holds = "calibration"  # class attributes, see `Result`
    tables = ("rows",)

    @property
    def summary(self) -> list[Block]:
        """The pose with its intervals, and warnings."""
        eye = self.record["hand_eye"]
        rows = []
        for axis, value, half in zip("xyz", eye["pos_m"], eye["half_width_95"]["pos_m"], strict=True):
            rows.append([f"{axis} on {eye['parent']}", f"{1e3 * value:.2f}", f"+- {1e3 * half:.2g}", "mm"])
        for axis, half in zip("xyz", eye["half_width_95"]["turn_rad"], strict=True):
            rows.append([f"turn about its {axis}", "", f"+- {np.degrees(half):.2g}", "deg"])
        rows.append(["quaternion wxyz", " ".join(f"{value:.4f}" for value in eye["quat_wxyz"]), "", ""])
        error = eye["robot_error"]
        size = f"{error['mm']:.2g} mm and {error['deg']:.2g} deg an axis"
        left = f"{len(self.record['rows'])} poses; the robot's own error is about {size}"
        out: list[Block] = [Sheet([Column(head) for head in ("what", "value", "95 %", "unit")], rows), Line(left)]
        return out + [Line(note, warning=True) for note in self.record["notes"]]

    def _write(self, folder: Path) -> None:
        write_json(folder / "results.json", dict(self.record))
        if self.camera is not None:
            save_cameras(folder / "camera.yaml", self.camera)


def place_camera(
    table: str | Path,
    *,
    robot: str | None = None,
    mount: Mount = "flange",
    orientation: Literal["rotation_vector", "fixed_xyz", "moving_xyz"] | None = None,
    intrinsics: str | Path | None = None,
    name: str = "camera",
) -> CameraPlace:
    """Find a camera's pose on the flange (tag at rest), or on the base (tag on the flange).

    Args:
        table: table of poses (.csv, .csv.gz, .parquet).
        robot: the robot whose joint angles the table has, instead of the flange's poses.
        mount: what the camera is fixed to; with `flange` the tag is at rest, with `base` it is on the flange.
        orientation: meaning of three angles; default: the interpretation that fits the data.
        intrinsics: file of the camera's intrinsics (this project's, OpenCV's, ROS's or ViSP's), to write a camera file.
        name: the camera's name in camera.yaml.

    Raises:
        UserError: no such table, motion that does not determine the pose, or units that the data do not determine.
    """
    path = Path(table)
    rows = read_table(path)
    robots, tags = _interpretations(rows, robot, orientation)
    flange, tag, assumed = together(robots, tags, path)
    try:
        found = place(tag, flange, mount)
    except UserError as error:
        raise UserError(f"the camera's pose cannot be determined: {error}", file=path) from error
    files = [p for p in (path, None if intrinsics is None else Path(intrinsics)) if p is not None]
    record = _record(found, mount, assumed, rows)
    record["provenance"] = here(None, {str(p): f"sha256:{digest(p)}" for p in files if p.exists()})
    return CameraPlace(
        record, None if intrinsics is None else _camera(Path(intrinsics), name, found, mount), tuple(files)
    )


def _interpretations(table: Table, robot: str | None, form: str | None) -> tuple[Ways, Ways]:
    """Return all possible interpretations of the flange's and the tag's poses, (n, 4, 4) each."""
    if robot is None:
        poses = two_poses(table)
        check_form(form, poses, table.file)
        robots, tags = (poses_of(table, columns, form) for columns in poses)
        # cm that the header does not state are tried only if no other unit gives poses in reach
        usual = [way for way in robots if _reached(way.position) and way.assumed_unit != "cm"]
        return _matrices(usual or robots, "the robot's"), _matrices(tags, "the tag's")
    model = load(placed(robot))
    combined: list[Readings] = readings(table, model.joints, form)
    if combined[0].turn is None:
        raise UserError(
            "a tag's pose without orientation", file=table.file, expected="qw qx qy qz, rx ry rz or roll pitch yaw"
        )
    # each combination assumes something of the joints and something of the tag: collect both separately, each once
    angles, tag_of = {way.of_joints: way.angles for way in combined}, {way.of_pose: way for way in combined}
    flange = []
    for assumed, q in angles.items():
        pose = flange_pose(model, np.asarray(q))
        flange.append((from_quaternion(pose[:, :3], pose[:, 3:]), assumed))
    return flange, [(_matrix(way.position, way.turn), assumed) for assumed, way in tag_of.items()]


def _matrices(ways: Sequence[PoseReadings], whose: str) -> Ways:
    return [(_matrix(way.position, way.turn), f"{whose} {way.said}" if way.said else "") for way in ways]


def _reached(position: np.ndarray) -> bool:
    """Return whether an arm can reach these positions (n, 3); motions alone cannot tell metres from millimetres."""
    return NEAR < float(np.median(np.linalg.norm(position, axis=1))) < FAR


def _matrix(position: np.ndarray, turn: np.ndarray | None) -> np.ndarray:
    assert turn is not None  # tables without orientation have been refused
    out = np.tile(np.eye(4), (len(position), 1, 1))
    out[:, :3, 3] = position
    out[:, :3, :3] = turn
    return out


def _record(found: Placed, mount: Mount, assumed: str, rows: Table) -> dict[str, Any]:
    eye, half = found.found, found.half
    notes = [f"taken as {assumed}: the header leaves it open, and no other reading fits"] if assumed else []
    for number, misfit in enumerate(eye.misfit):
        if misfit > ODD:
            notes.append(
                f"{rows.row(number)} of {rows.file.name} is {misfit:.1f} standard deviations off; moving, or swapped?"
            )
    spread = np.ptp(np.stack([x[:3, 3] for x in eye.methods.values()]), axis=0).max()
    if spread > 3 * half[:3].max():
        notes.append(f"closed-form methods differ by {1e3 * spread:.1f} mm: turn the flange farther")
    other = "base" if mount == "flange" else "flange"
    return {
        "format": FORMAT,
        "hand_eye": {
            "parent": mount,
            "pos_m": eye.camera[:3, 3].tolist(),
            "quat_wxyz": quaternion(eye.camera[:3, :3]).tolist(),
            "half_width_95": {"pos_m": half[:3].tolist(), "turn_rad": half[3:].tolist()},
            "tag": {
                "parent": other,
                "pos_m": eye.board[:3, 3].tolist(),
                "quat_wxyz": quaternion(eye.board[:3, :3]).tolist(),
            },
            "tag_scatter_mm": 1e3 * eye.scatter,
            "robot_error": {"mm": 1e3 * float(eye.robot[0]), "deg": float(np.degrees(eye.robot[1]))},
        },
        "rows": [
            {"row": int(rows.numbers[number]), "misfit": float(misfit)} for number, misfit in enumerate(eye.misfit)
        ],
        "notes": notes,
    }


def _camera(intrinsics: Path, name: str, found: Placed, mount: Mount) -> Camera:
    lens = read_intrinsics(intrinsics)
    pose = found.found.camera
    camera = Camera(name, *lens.size, *lens.focal, *lens.centre, lens.distortion)
    return camera.moved(parent=mount, pos=tuple(pose[:3, 3]), quat=tuple(quaternion(pose[:3, :3]).tolist()))
