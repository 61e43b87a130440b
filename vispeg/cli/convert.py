"""Converts a CSV or Parquet table, a NumPy archive or a ROS bag into a recording folder.

Example:
    vispeg convert log.csv --robot iiwa14 --map map.yaml --out rig-a
    vispeg convert run.mcap --robot arm.urdf --topic /joint_states --torque-sensor joint --out rig-b

A map names columns and units, one a line: `time: {column: t, unit: ms}`, `q.joint1: {column: pos_1, unit: deg}`;
`joints: {joint1: lbr_A1}` renames a bag's joints, `recording: {control: {mode: torque}}` adds to recording.yaml.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from vispeg.core.errors import UserError
from vispeg.recordings.importers.mapping import ColumnMap, read_map
from vispeg.recordings.recording import Recording
from vispeg.recordings.write import write

TABLES, BAGS = (".csv", ".parquet"), (".bag", ".db3", ".mcap")


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg convert`."""

    source: tyro.conf.Positional[Path]
    """A .csv, .parquet, .npz, .bag, .db3 or .mcap file, or a ROS 2 bag's folder."""
    out: Path
    """The recording folder to write."""
    robot: str
    """A robot's name (iiwa14) or a path to its MJCF or URDF."""
    map: Path | None = None
    """A YAML file with the source's names and units."""
    topic: str | None = None
    """Bags: the JointState topic with what was measured (default: the only one)."""
    command_topic: str | None = None
    """Bags: the JointState topic with what was commanded."""
    pose_topic: str | None = None
    """Bags: the PoseStamped topic of the flange in the base (default: the only one, if there is one)."""
    wrench_topic: str | None = None
    """Bags: the WrenchStamped topic at the flange (default: the only one, if there is one)."""
    torque_sensor: Literal["joint", "motor", "none"] = "none"
    """What measured torque is: behind the gear (joint) or from the current (motor)."""
    table: Literal["csv", "parquet"] = "csv"
    """Format of the samples."""
    overwrite: bool = False
    """Replace OUT if it exists."""

    def run(self) -> int:
        """Writes the recording and says what is in it."""
        rec = self._read()
        write(rec, self.out, self.overwrite, self.table, inputs=(self.source, self.map))
        names = ("q", "dq", "tau", "tau_cmd", "q_cmd", "dq_cmd", "ee", "ee_cmd", "ft")
        found = ", ".join(name for name in names if getattr(rec, name) is not None)
        print(f"{self.out}: {len(rec.time)} samples of {len(rec.joints)} joints at {rec.rate_hz:g} Hz: {found}")
        return 0

    def _read(self) -> Recording:
        from vispeg.robots.model import load as load_robot

        robot = str(Path(self.robot).expanduser().resolve()) if Path(self.robot).suffix else self.robot
        joints = load_robot(robot).joints
        mapping = read_map(self.map, joints)
        kind = self.source.suffix.lower()
        header: dict[str, Any] = {"torque_sensor": self.torque_sensor}
        if not self.source.exists():
            raise UserError("does not exist", file=self.source)
        if kind in BAGS or (self.source / "metadata.yaml").is_file():
            return self._bag(robot, joints, mapping, header)
        for name in ("topic", "command_topic", "pose_topic", "wrench_topic"):
            if getattr(self, name) is not None:
                raise UserError(f"--{name.replace('_', '-')} is for bags", file=self.source)
        if kind in TABLES:
            from vispeg.recordings.importers.table import import_table

            return import_table(self.source, robot, joints, mapping, **header)
        if kind == ".npz":
            from vispeg.recordings.importers.npz import import_npz

            return import_npz(self.source, robot, joints, mapping, **header)
        choices = (*TABLES, ".npz", *BAGS, "a ROS 2 bag's folder")
        raise UserError(
            "is nothing that can be converted", file=self.source, got=kind or self.source.name, choices=choices
        )

    def _bag(self, robot: str, joints: tuple[str, ...], mapping: ColumnMap, header: dict[str, Any]) -> Recording:
        from vispeg.recordings.importers.rosbag import Topics, import_rosbag

        topics = Topics(self.topic, self.command_topic, self.pose_topic, self.wrench_topic)
        return import_rosbag(self.source, robot, joints, mapping, topics, **header)
