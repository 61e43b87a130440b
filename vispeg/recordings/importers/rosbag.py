"""Import a ROS 1 bag, a ROS 2 bag or an MCAP file: joint states, and optionally commands, poses and wrenches."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.columns import columns_of
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.importers.bagfile import messages, open_bag, topics_of
from vispeg.recordings.importers.bagimages import image_topics, read_images
from vispeg.recordings.importers.build import build, joints_of
from vispeg.recordings.importers.mapping import ColumnMap
from vispeg.recordings.importers.pictures import Album
from vispeg.recordings.recording import Recording
from vispeg.recordings.resample import hold, linear, poses

JOINTS, POSE, WRENCH = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/WrenchStamped"
FIELDS = ("position", "velocity", "effort")
MEASURED, COMMANDED = ("q", "dq", "tau"), ("q_cmd", "dq_cmd", "tau_cmd")


@dataclass(frozen=True)
class Topics:
    """Topics to read; None stands for the only topic of that type, if there is just one. `command` is never guessed.

    Attributes:
        joints: JointState with what was measured; its stamps are the recording's times.
        command: JointState with what was commanded.
        pose: PoseStamped of the flange in the base.
        wrench: WrenchStamped at the flange, in the flange frame.
        images: Image or CompressedImage topics, one camera each; `all` for all there are.
    """

    joints: str | None = None
    command: str | None = None
    pose: str | None = None
    wrench: str | None = None
    images: tuple[str, ...] = ()


def import_rosbag(
    source: Path,
    robot: str,
    joints: Sequence[str],
    mapping: ColumnMap | None = None,
    topics: Topics = Topics(),
    scratch: Path | None = None,
    cameras: Mapping[str, RecordedCamera] | None = None,
) -> Recording:
    """Import a recording on the clock of the measured joint states.

    Times are the messages' header stamps, or bag times where a topic's headers are empty. Joints are matched by name;
    values that a message lacks become NaN. Positions and wrenches are interpolated linearly, orientations by slerp.
    A reading's command is the nearest one within half a period, or else the last one before it.

    Args:
        source: a .bag, .db3 or .mcap file, or a ROS 2 bag's folder.
        robot: a name or a path.
        joints: the robot's joints.
        mapping: its `joints` states the joints' names in the bag, its `recording` further header keys.
        topics: which topics to read.
        scratch: a folder for pictures, kept until the recording is written; needed for `topics.images`.
        cameras: camera name -> intrinsics and pose, overriding CameraInfo; a bag contains no camera poses.

    Raises:
        UserError: no or several candidate topics, joints that no message names, a damaged bag, or a map with columns
            or a rate, which messages have themselves.
    """
    mapping = mapping or ColumnMap()
    if mapping.columns or mapping.rate_hz is not None:
        key, expected = next(iter(mapping.columns), "time.rate_hz"), "joints, motors and recording alone, and topics"
        raise UserError("is not used with a bag", file=mapping.file or source, key=key, expected=expected)
    names = joints_of(joints, mapping)
    columns: dict[str, np.ndarray] = {}
    album, stated = None if scratch is None else Album(scratch), dict[str, RecordedCamera]()
    with open_bag(source) as reader:
        topic = topics.joints or _only(reader, JOINTS, topics.command, source)
        time, states = _joint_states(reader, topic, names, mapping, source)
        time, states = _once(time, states)
        origin = time[0]
        clock = (time - origin) * 1e-9
        columns["time"] = clock
        for name, values in zip(MEASURED, np.split(states, 3, axis=1), strict=True):
            _add(columns, name, names, values)
        if topics.command is not None:
            at, values = _once(*_joint_states(reader, topics.command, names, mapping, source))
            held = _overlapping(hold, clock, (at - origin) * 1e-9, values, topics.command, source)
            for name, part in zip(COMMANDED, np.split(held, 3, axis=1), strict=True):
                _add(columns, name, names, part)
        for name, kind, requested, row, onto in (
            ("ee", POSE, topics.pose, _pose, poses),
            ("ft", WRENCH, topics.wrench, _wrench, linear),
        ):
            candidates = topics_of(reader, kind)
            chosen = requested or (candidates[0] if len(candidates) == 1 else None)
            if chosen is not None:
                at, values = _once(*_rows(reader, chosen, kind, row, source))
                values = _overlapping(onto, clock, (at - origin) * 1e-9, values, chosen, source)
                _add(columns, name, names, values)
        if album is not None and topics.images:

            def seconds(stamp: float, at: float) -> float:
                return ((stamp if stamp > 0 else at) - int(origin)) * 1e-9

            wanted = image_topics(reader, topics.images, source)
            stated = read_images(reader, wanted, album, seconds, source, cameras or {})
    rec = build(columns, source, robot, joints, mapping)
    if album is None or not topics.images:
        return rec
    return replace(rec, frames=album.frames(rec, stated))


def joint_topics(source: Path) -> tuple[str, ...]:
    """List the JointState topics of a bag. Raises UserError: not a readable bag."""
    with open_bag(source) as reader:
        return tuple(topics_of(reader, JOINTS))


def _only(reader: Any, kind: str, not_this: str | None, source: Path) -> str:
    candidates = [topic for topic in topics_of(reader, kind) if topic != not_this]
    if len(candidates) != 1:
        said = f"holds {'several topics' if candidates else 'no topic'} of type {kind}"
        raise UserError(said + ("; name one with --topic" if candidates else ""), file=source, choices=candidates)
    return candidates[0]


def _joint_states(
    reader: Any, topic: str, names: list[str], mapping: ColumnMap, source: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Read times (n,) ns and [position, velocity, effort] (n, 3 nj), NaN for values that a message lacks."""
    wanted = [mapping.joints.get(name, name) for name in names]
    places: dict[tuple[str, ...], tuple[list[int], list[int]]] = {}
    all_names: set[str] = set()

    def row(message: Any) -> np.ndarray | None:
        sent = tuple(message.name)
        if sent not in places:
            all_names.update(sent)
            pairs = [(j, sent.index(name)) for j, name in enumerate(wanted) if name in sent]
            places[sent] = ([j for j, _ in pairs], [k for _, k in pairs])
        ours, theirs = places[sent]
        if not ours:
            return None  # a message about other joints, such as a gripper's, on the same topic
        out = np.full((3, len(wanted)), np.nan)
        for line, field in zip(out, FIELDS, strict=True):
            values = np.asarray(getattr(message, field), float)
            if len(values) == len(sent):
                line[ours] = values[theirs]
        return out.ravel()

    time, values = _rows(reader, topic, JOINTS, row, source, allow_none=True)
    absent = [name for name in wanted if name not in all_names]
    if absent:
        raise UserError(
            f"no message on {topic} names this joint", file=source, got=absent[0], choices=sorted(all_names)
        )
    return time, values


def _rows(
    reader: Any,
    topic: str,
    kind: str,
    row: Callable[[Any], np.ndarray | None],
    source: Path,
    allow_none: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Read times (n,) ns, header stamps or else bag times, and the values that `row` makes of each message, (n, k)."""
    stamps, bag_times, rows = [], [], []
    for stamp, at, message in messages(reader, topic, kind, source):
        values = row(message)
        if values is not None:
            stamps.append(stamp)
            bag_times.append(at)
            rows.append(values)
    if not rows and not allow_none:
        raise UserError("topic holds no messages", file=source, got=topic)
    chosen = stamps if all(stamp > 0 for stamp in stamps) else bag_times
    return np.array(chosen, np.int64), np.array(rows)


def _once(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort by time; of equal stamps keep the first."""
    time, first = np.unique(time, return_index=True)
    return time, values[first]


def _overlapping(
    onto: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    clock: np.ndarray,
    time: np.ndarray,
    values: np.ndarray,
    topic: str,
    source: Path,
) -> np.ndarray:
    """Resample values at `time` to `clock` by the function `onto`. Raises UserError: the two do not overlap."""
    if time[0] > clock[-1] or time[-1] < clock[0]:
        raise UserError(f"{topic} does not overlap the joint states in time (another clock?)", file=source)
    return onto(clock, time, values)


def _add(columns: dict[str, np.ndarray], signal: str, joints: list[str], values: np.ndarray) -> None:
    """Add a signal's columns unless it was never sent (all NaN)."""
    if np.isfinite(values).any():
        columns |= dict(zip(columns_of(signal, joints), values.T, strict=True))


def _pose(message: Any) -> np.ndarray:
    p, o = message.pose.position, message.pose.orientation
    return np.array([p.x, p.y, p.z, o.w, o.x, o.y, o.z], float)


def _wrench(message: Any) -> np.ndarray:
    f, t = message.wrench.force, message.wrench.torque
    return np.array([f.x, f.y, f.z, t.x, t.y, t.z], float)
