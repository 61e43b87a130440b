"""Read messages from ROS 1 bags, ROS 2 bags and MCAP files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from vispeg.core.errors import UserError
from vispeg.core.extras import missing
from vispeg.core.notes import note
from vispeg.formats.guard import refuse_special

STORAGES = {".db3": "sqlite3", ".mcap": "mcap"}


@contextmanager
def open_bag(path: Path) -> Iterator[Any]:
    """Open a `rosbags.highlevel.AnyReader`.

    Args:
        path: a .bag file, a ROS 2 bag folder, or a .db3 or .mcap file with or without its folder's metadata.yaml.

    Raises:
        UserError: rosbags is not installed, there is no such file, or it is not a bag.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise missing("rosbags", "a ROS bag", file=str(path)) from error
    if not path.exists():
        raise UserError("does not exist", file=path)
    for part in (path, *(path.iterdir() if path.is_dir() else ())):
        refuse_special(part)
    with TemporaryDirectory() as scratch, ExitStack() as opened:
        with _reading(path):
            folder = _with_metadata(path, Path(scratch)) if path.suffix in STORAGES else path
            typestore = get_typestore(Stores.ROS2_HUMBLE)
            reader = opened.enter_context(AnyReader([folder], default_typestore=typestore))
        yield reader


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turn what the reader raises on a damaged file, which can be any exception, into a UserError."""
    try:
        yield
    except Exception as error:
        said = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(f"is not a bag that can be read: {said}", file=path) from error


def _with_metadata(path: Path, scratch: Path) -> Path:
    """Make a ROS 2 bag folder for one storage file: a link to the file, and metadata.yaml built from its content."""
    from rosbags.rosbag2.storage_mcap import McapReader
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

    storage = (Sqlite3Reader if path.suffix == ".db3" else McapReader)(path)
    storage.open()
    try:
        head, topics = storage.metadata, []
        for connection in storage.connections:
            about = {"name": connection.topic, "type": connection.msgtype, "serialization_format": "cdr"}
            topics.append(
                {"topic_metadata": about | {"offered_qos_profiles": ""}, "message_count": connection.msgcount}
            )
        info = {
            "version": 5,
            "storage_identifier": STORAGES[path.suffix],
            "relative_file_paths": [path.name],
            "duration": {"nanoseconds": max(head.duration - 1, 0)},  # rosbags adds 1 ns
            "starting_time": {"nanoseconds_since_epoch": head.start_time},
            "message_count": head.message_count,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
        }
    finally:
        storage.close()
    os.symlink(path.resolve(), scratch / path.name)
    (scratch / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": info}), encoding="utf-8")
    return scratch


def topics_of(reader: Any, kind: str) -> list[str]:
    """List the topics whose messages have the type `kind`, such as `sensor_msgs/msg/JointState`, sorted."""
    return sorted({c.topic for c in reader.connections if c.msgtype == kind and c.msgcount > 0})


def messages(reader: Any, topic: str, kind: str, path: Path) -> Iterator[tuple[float, float, Any]]:
    """Yield (header stamp ns, bag time ns, message) of one topic, in the bag's order.

    Raises:
        UserError: no such topic, it has another type than `kind`, or the bag is damaged.
    """
    connections = [c for c in reader.connections if c.topic == topic]
    if not connections:
        raise UserError("no such topic", file=path, got=topic, choices=sorted({c.topic for c in reader.connections}))
    if any(c.msgtype != kind for c in connections):
        raise UserError(f"topic {topic} has another type", file=path, expected=kind, got=connections[0].msgtype)
    count = 0
    with _reading(path):  # what the caller raises between messages does not come here
        for connection, at, raw in reader.messages(connections=connections):
            count += 1
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            yield int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec), int(at), message
    promised = sum(c.msgcount for c in connections)
    if count != promised:
        note(f"{path}: {topic} holds {count} of the {promised} messages that its index names")
