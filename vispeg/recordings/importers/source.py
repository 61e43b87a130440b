"""Convert any log to a recording, with the importer chosen by its file name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.formats.arrays import array_names
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.columns import SIGNALS
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.importers.mapping import ColumnMap
from vispeg.recordings.importers.rosbag import Topics
from vispeg.recordings.importers.turns import turned
from vispeg.recordings.load import HEADER
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import STORES, TABLES, parts
from vispeg.recordings.tables.table import MAX_BYTES

BAGS = (".bag", ".db3", ".mcap")
INSTEAD = {  # unsupported formats, and how to get a table from them
    ".xlsx": "pandas.read_excel(FILE).to_csv('log.csv')",
    ".xls": "pandas.read_excel(FILE).to_csv('log.csv')",
    ".pkl": "a CSV that its own program writes: a pickle can run any code, and is never opened",
    ".pickle": "a CSV that its own program writes: a pickle can run any code, and is never opened",
    ".pt": "a CSV that its own program writes: a pickle can run any code, and is never opened",
    ".feather": "pandas.read_feather(FILE).to_parquet('log.parquet')",
}
FLAGS = {"joints": "--topic", "command": "--command-topic", "pose": "--pose-topic", "wrench": "--wrench-topic"}


def is_table(source: Path) -> bool:
    """Return whether a log has named columns for a map: a table, a file of arrays, or a folder of them."""
    if source.is_dir():
        return not is_bag(source) and bool(parts(source))
    return source.name.lower().endswith((*TABLES, *STORES))


def is_bag(source: Path) -> bool:
    """Return whether a log is a ROS bag: a bag file, or the folder of a ROS 2 bag."""
    return source.name.lower().endswith(BAGS) or (source / "metadata.yaml").is_file()


def refuse_recording(source: Path) -> None:
    """Raise UserError if a folder is a recording, whose table alone would come without what recording.yaml states."""
    if (source / HEADER).is_file():
        raise UserError("is a recording already", file=source, expected="a log, or the table in this folder alone")


def read_source(
    source: Path,
    robot: str,
    joints: Sequence[str],
    mapping: ColumnMap,
    *,
    limits: Limits | None = None,
    topics: Topics | None = None,
    cameras: Mapping[str, RecordedCamera] | None = None,
    torque_sensor: str | None = None,
    scratch: Path | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Recording:
    """Convert a table, an archive or a ROS bag to a recording.

    Args:
        source: a .csv, .csv.gz, .parquet, .npz, .bag, .db3 or .mcap file, or the folder of a ROS 2 bag.
        robot: the robot's name, or a path to its model.
        joints: names of the robot's joints.
        mapping: names and units of the source's columns.
        limits: limits of these joints, into whose ranges wrapped angles are shifted; None leaves angles unchanged.
        topics: topics of a bag; `images` also names the videos of a LeRobot table.
        cameras: intrinsics and poses that the source lacks, by camera name.
        torque_sensor: kind of the measured torque; overrides the map.
        scratch: folder for images until the recording is written.
        progress: called with the share of a table that has been read.

    Raises:
        UserError: not a supported log, or a recording; topics or images for another kind of log; with `limits`, a joint
            that the robot does not have; errors of the importers.
    """
    refuse_recording(source)
    if torque_sensor is not None:
        mapping = replace(mapping, recording={**mapping.recording, "torque_sensor": torque_sensor})
    rec = _read(source, robot, joints, mapping, topics or Topics(), cameras, scratch, progress)
    if limits is None:
        return rec
    for joint in rec.joints:
        if joint not in joints:
            raise UserError("the robot has no such joint", file=source, key="joints", got=joint, choices=joints)
    order = [list(joints).index(joint) for joint in rec.joints]
    return turned(rec, Limits(limits.range[order], limits.velocity[order], limits.torque[order]), source)


def _read(
    source: Path,
    robot: str,
    joints: Sequence[str],
    mapping: ColumnMap,
    topics: Topics,
    cameras: Mapping[str, RecordedCamera] | None,
    scratch: Path | None,
    progress: Callable[[float], None],
) -> Recording:
    if is_bag(source):
        from vispeg.recordings.importers.rosbag import import_rosbag

        return import_rosbag(source, robot, joints, mapping, topics, scratch, cameras)
    for field in fields(topics):
        if field.name in FLAGS and getattr(topics, field.name) is not None:
            raise UserError(f"{FLAGS[field.name]} is for bags", file=source)
    if source.name.lower().endswith(".npz") and _is_whole(source, mapping):
        if topics.images:
            raise UserError("--images is for bags and LeRobot tables", file=source)
        from vispeg.recordings.importers.npz import import_npz

        return import_npz(source, robot, joints, mapping)
    if is_table(source):
        from vispeg.recordings.importers.table import import_table

        rec = import_table(source, robot, joints, mapping, progress)
        if not topics.images or scratch is None:
            return rec
        from vispeg.recordings.importers.lerobot_video import import_video

        return replace(rec, frames=import_video(source, rec, topics.images, cameras or {}, scratch))
    if topics.images:
        raise UserError("--images is for bags and LeRobot tables", file=source)
    kind = source.suffix.lower()
    if kind in INSTEAD:
        raise UserError("cannot be converted", file=source, got=kind, expected=INSTEAD[kind])
    choices = (*TABLES, *STORES, *BAGS, "a folder of these", "a ROS 2 bag's folder")
    raise UserError("cannot be converted", file=source, got=kind or source.name, choices=choices)


def _is_whole(source: Path, mapping: ColumnMap) -> bool:
    """Return whether an archive's arrays are signals of all joints, by the map or by the recording's own names."""
    if any(target in SIGNALS for target in mapping.columns) or not mapping.columns:
        return True
    return not any("." in target for target in mapping.columns) and "q" in array_names(source, most=MAX_BYTES)
