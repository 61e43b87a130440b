"""Converts a table, an archive or a ROS bag into a recording.

Example:
    vispeg convert log.csv --robot iiwa14 --guess --save-map map.yaml
    vispeg convert log.csv --robot iiwa14 --map map.yaml --out rig-a
    vispeg convert run.mcap --robot arm.urdf --topic /joint_states --torque-sensor joint --out rig-b
    vispeg convert run.mcap --robot iiwa14 --images all --cameras wrist.yaml --out rig-c
    vispeg convert so101-pick-place --robot so101_new_calib.xml --guess --yes --out pick
    vispeg convert episode_0.hdf5 --robot arm.urdf --guess --rate-hz 50 --save-map map.yaml
    vispeg convert tosses.npz --robot cube.xml --rate-hz 148 --episodes 0:285 --out toss-a

SOURCE is a table, a file of arrays (HDF5, MATLAB, NumPy, JSON), a LeRobot data set or a ROS bag.
A map names columns and units, one a line:
`time: {column: t, unit: ms}`, `q.joint1: {column: pos_1, unit: deg}`;
`joints: {joint1: lbr_A1}` renames a bag's joints, `recording: {control: {mode: torque}}` adds to recording.yaml,
`table: {separator: ";", decimal: ","}` describes a text table. `--guess` proposes a map from a table's header
and ranges. Impossible units (200 kHz, angles far outside the joints' ranges) are refused
without `--insist`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, OutputOptions
from vispeg.cli.reading import progress_bar
from vispeg.core.errors import UserError
from vispeg.recordings.columns import SIGNALS
from vispeg.recordings.importers.mapping import ColumnMap


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg convert`."""

    source: tyro.conf.Positional[Path]
    """A table (.csv, .csv.gz, .tsv, .txt, .parquet), arrays (.hdf5, .h5, .mat, .npz, .npy, .json, .jsonl), a bag (.bag,
    .db3, .mcap), or a folder: a LeRobot data set, a ROS 2 bag, tables of episodes or of one run's signals."""
    robot: str
    """A robot's name (iiwa14) or a path to its MJCF or URDF."""
    out: Path | None = None
    """The recording folder to write; not needed if --guess only shows or saves a map."""
    map: Path | None = None
    """A YAML file with the source's names and units."""
    guess: bool = False
    """Tables: propose the map, with a reason for each column, and ask before it is used."""
    yes: bool = False
    """With --guess: accept the proposed map without a question."""
    save_map: Path | None = None
    """With --guess: write the proposed map to this file, to be edited and passed as --map."""
    rate_hz: float | None = None
    """Samples a second of a file that keeps no time."""
    columns: str | None = None
    """Names of the columns of a table without a header line, with commas: time,q1,q2."""
    calibration: Path | None = None
    """With --guess: LeRobot's calibration file (encoder ranges); default: calibration.json in the data set."""
    torque_constants: tuple[str, ...] = ()
    """With --guess, or for a bag: measured torque is a motor current, with these N m/A at the joint (motor constant x
    gear): a number a joint, JOINT=NUMBER, or the name of an arm or servo (ur5e, XM430-W350)."""
    episodes: str | None = None
    """For an object's archive: tosses to convert, FIRST:LAST without LAST. The others can be held out."""
    insist: bool = False
    """Accept impossible units."""
    topic: str | None = None
    """Bags: the JointState topic of measured values; default: the only one."""
    command_topic: str | None = None
    """Bags: the JointState topic of commands."""
    pose_topic: str | None = None
    """Bags: the PoseStamped topic of the flange in the base; default: the only one."""
    wrench_topic: str | None = None
    """Bags: the WrenchStamped topic at the flange; default: the only one."""
    images: tuple[str, ...] = ()
    """Pictures to convert: topics of a bag (NAME=TOPIC names the camera), videos of a LeRobot table
    (observation.images.wrist), or all."""
    cameras: tuple[Path, ...] = ()
    """Camera files with the intrinsics and poses that the source lacks, and the robot's own file too."""
    depth_camera: tuple[str, ...] = ()
    """Kind of the depth cameras, by whose noise their depth is judged: d405, d435 or structured_light; NAME=KIND where
    they differ."""
    torque_sensor: Literal["joint", "motor", "none"] | None = None
    """Where torque was measured: behind the gear (joint) or from the current (motor); default: torque is not used."""
    table: Literal["csv", "parquet"] = "csv"
    """Format of the samples."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Write the recording and say what is in it."""
        from vispeg.api.recording.convert import convert, placed
        from vispeg.recordings.importers.rosbag import Topics
        from vispeg.robots.objects import is_object

        if not self.source.exists():
            raise UserError("does not exist", file=self.source)
        if is_object(placed(self.robot)):
            return self._object()
        if self.episodes is not None:
            raise UserError("--episodes is for a free object's tosses", file=self.source)
        mapping = self._guessed() if self.guess else self.map
        if self.guess and mapping is None:
            return 0
        with progress_bar(f"reading {self.source}", self.source.stat().st_size) as share:
            rec = convert(
                self.source,
                self.robot,
                self._out(),
                mapping=mapping,
                topics=Topics(self.topic, self.command_topic, self.pose_topic, self.wrench_topic, self.images),
                cameras=self.cameras,
                depth_camera=self.depth_camera,
                torque_sensor=self.torque_sensor,
                torque_constants=() if self.guess else self.torque_constants,
                rate_hz=self.rate_hz,
                column_names=self._names(),
                insist=self.insist,
                table=self.table,
                overwrite=self.overwrite,
                progress=share,
            )
        signals = [name for name in SIGNALS if getattr(rec, name) is not None]
        shape = {"samples": len(rec.time), "joints": list(rec.joints), "rate_hz": rec.rate_hz}
        frames = 0 if rec.frames is None else len(rec.frames)
        line = f"{self.out}: {len(rec.time)} samples of {len(rec.joints)} joints at {rec.rate_hz:g} Hz: "
        line += ", ".join(signals)
        line += f"; {frames} frames of {', '.join(rec.frames.names)}" if rec.frames is not None else ""
        self.output.give({"recording": str(self.out), **shape, "signals": signals, "frames": frames}, [line])
        return 0

    def _names(self) -> list[str]:
        return [] if self.columns is None else [name.strip() for name in self.columns.split(",")]

    def _out(self) -> Path:
        if self.out is None:
            raise UserError("no folder to write to", key="--out", expected="--out FOLDER")
        return self.out

    def _object(self) -> int:
        """Give the same of a free object's tosses."""
        from vispeg.api.recording.convert import convert_object

        first, last = self._span()
        out = self._out()
        rec = convert_object(
            self.source, self.robot, out, rate_hz=self.rate_hz, first=first, last=last, overwrite=self.overwrite
        )
        count = len(rec.tosses)
        record = {"recording": str(out), "object": rec.name_of, "samples": len(rec.time), "episodes": count}
        line = f"{out}: {count} tosses of {rec.name_of}, {len(rec.time)} samples at {rec.rate_hz:g} Hz"
        self.output.give(record, [line])
        return 0

    def _span(self) -> tuple[int, int | None]:
        if self.episodes is None:
            return 0, None
        first, colon, last = self.episodes.partition(":")
        if not (colon and (first or "0").isdigit() and (last or "0").isdigit()) or len(self.episodes) > 20:
            raise UserError("not a range", key="--episodes", expected="FIRST:LAST, such as 0:285", got=self.episodes)
        return int(first or 0), int(last) if last else None

    def _guessed(self) -> ColumnMap | None:
        """Give the proposed map if it is to be used now: shown, saved or asked about as the arguments say."""
        from vispeg.api.recording.guess import propose

        if self.map is not None:
            raise UserError("a map is given already", key="--guess", expected="--guess or --map, not both")
        proposed = propose(
            self.source,
            self.robot,
            self.torque_sensor,
            rate_hz=self.rate_hz,
            columns=self._names(),
            calibration=self.calibration,
            torque_constants=self.torque_constants,
        )
        self.output.line(str(proposed))
        if self.save_map is not None:
            proposed.save(self.save_map, overwrite=self.overwrite)
            self.output.line(f"written to {self.save_map}; use it with --map {self.save_map}")
        if self.out is not None and self._confirmed():
            return proposed.mapping
        map_file = None if self.save_map is None else str(self.save_map)
        self.output.give({"recording": None, "map": map_file, "proposal": proposed.record}, [])
        return None

    def _confirmed(self) -> bool:
        if self.yes:
            return True
        if not (sys.stdin.isatty() and sys.stdout.isatty()):
            expected = "--yes to take it, or --save-map FILE to look at it and pass it as --map"
            raise UserError("a guess must be confirmed", key="--guess", expected=expected)
        if input("Convert with this map? [y/N] ").strip().lower() in ("y", "yes"):
            return True
        self.output.line("nothing written; --save-map FILE keeps the map to be mended")
        return False
