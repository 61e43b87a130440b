"""Converts a CSV or Parquet table, a NumPy archive or a ROS bag into a recording folder.

Example:
    vispeg convert log.csv --robot iiwa14 --guess --save-map map.yaml
    vispeg convert log.csv --robot iiwa14 --map map.yaml --out rig-a
    vispeg convert run.mcap --robot arm.urdf --topic /joint_states --torque-sensor joint --out rig-b
    vispeg convert run.mcap --robot iiwa14 --images all --cameras wrist.yaml --out rig-c
    vispeg convert tosses.npz --robot cube.xml --rate-hz 148 --episodes 0:285 --out toss-a

A map names columns and units, one a line: `time: {column: t, unit: ms}`, `q.joint1: {column: pos_1, unit: deg}`;
`joints: {joint1: lbr_A1}` renames a bag's joints, `recording: {control: {mode: torque}}` adds to recording.yaml,
`table: {separator: ";", decimal: ","}` says how a text table is written. `--guess` proposes a map from a table's header
and ranges. Units that cannot be true (200 kHz, angles far outside the joints' ranges) are refused, or `--insist`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import tyro

from vispeg.cli.output import Output, Told
from vispeg.cli.reading import told
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.recordings.columns import SIGNALS
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.importers.mapping import FACTORS, ColumnMap, map_from, read_map
from vispeg.recordings.importers.plausible import doubts
from vispeg.recordings.quality import Limits
from vispeg.recordings.recording import Recording
from vispeg.recordings.write import write

TABLES, BAGS = (".csv", ".csv.gz", ".parquet"), (".bag", ".db3", ".mcap")


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg convert`."""

    source: tyro.conf.Positional[Path]
    """A .csv, .csv.gz, .parquet, .npz, .bag, .db3 or .mcap file, or a ROS 2 bag's folder."""
    robot: str
    """A robot's name (iiwa14) or a path to its MJCF or URDF."""
    out: Path | None = None
    """The recording folder to write; not needed where --guess only shows or saves a map."""
    map: Path | None = None
    """A YAML file with the source's names and units."""
    guess: bool = False
    """Tables: propose the map, with a reason for each column, and ask before it is used."""
    yes: bool = False
    """With --guess: take what is proposed."""
    save_map: Path | None = None
    """With --guess: write what is proposed into this file, to be looked at and passed as --map."""
    rate_hz: float | None = None
    """Of an object's archive without `time`: samples a second."""
    episodes: str | None = None
    """Of an object's archive: the tosses taken, FIRST:LAST, LAST not included, so that others are left to judge on."""
    insist: bool = False
    """Take the stated units even where they cannot be true."""
    topic: str | None = None
    """Bags: the JointState topic with what was measured (default: the only one)."""
    command_topic: str | None = None
    """Bags: the JointState topic with what was commanded."""
    pose_topic: str | None = None
    """Bags: the PoseStamped topic of the flange in the base (default: the only one, if there is one)."""
    wrench_topic: str | None = None
    """Bags: the WrenchStamped topic at the flange (default: the only one, if there is one)."""
    images: tuple[str, ...] = ()
    """Pictures to take over: topics of a bag, videos of a LeRobot table (observation.images.wrist), or all."""
    cameras: Path | None = None
    """A camera file with what the source does not say of its cameras: intrinsics, and where they sit."""
    torque_sensor: Literal["joint", "motor", "none"] | None = None
    """What measured torque is: behind the gear (joint) or from the current (motor). Not stated, it is not used."""
    table: Literal["csv", "parquet"] = "csv"
    """Format of the samples."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: Told = Output()

    def run(self) -> int:
        """Writes the recording and says what is in it."""
        from vispeg.robots.model import load as load_robot
        from vispeg.robots.objects import is_object

        if not self.source.exists():
            raise UserError("does not exist", file=self.source)
        robot = str(Path(self.robot).expanduser().resolve()) if Path(self.robot).suffix else self.robot
        if is_object(robot):
            return self._object(robot)
        for flag in ("rate_hz", "episodes"):
            if getattr(self, flag) is not None:
                raise UserError(f"--{flag.replace('_', '-')} is for a free object's tosses", file=self.source)
        model = load_robot(robot)
        limits = Limits(model.range, model.velocity_limit, model.torque_limit)
        mapping = self._guessed(model.joints, limits) if self.guess else read_map(self.map, model.joints)
        if mapping is None:
            return 0
        if self.out is None:
            raise UserError("no folder to write to", key="--out", expected="--out FOLDER")
        with TemporaryDirectory() as scratch:
            rec = self._read(robot, model.joints, mapping, Path(scratch))
            self._refuse_units(rec, model.joints, limits, mapping)
            write(rec, self.out, self.overwrite, self.table, inputs=(self.source, self.map, self.cameras))
        found = ", ".join(name for name in SIGNALS if getattr(rec, name) is not None)
        shape = {"samples": len(rec.time), "joints": list(rec.joints), "rate_hz": rec.rate_hz}
        frames = 0 if rec.frames is None else len(rec.frames)
        record = {"recording": str(self.out), **shape, "signals": found.split(", "), "frames": frames}
        line = f"{self.out}: {len(rec.time)} samples of {len(rec.joints)} joints at {rec.rate_hz:g} Hz: {found}"
        line += f"; {frames} frames of {', '.join(rec.frames.names)}" if rec.frames is not None else ""
        self.output.give(record, [line])
        return 0

    def _object(self, source: str) -> int:
        """The same of a free object's tosses."""
        from vispeg.recordings.importers.objects import import_object
        from vispeg.recordings.objects import write_object
        from vispeg.robots.objects import load_object

        if self.out is None:
            raise UserError("no folder to write to", key="--out", expected="--out FOLDER")
        if self.source.suffix.lower() != ".npz":
            expected = "an .npz archive with `state` and `start`; a table is a recording already, see docs/formats.md"
            raise UserError("is nothing that can be converted", file=self.source, expected=expected)
        if self.rate_hz is not None and not 1 <= self.rate_hz <= 100_000:
            raise UserError("is no rate", key="--rate-hz", expected="1 to 100000 samples a second", got=self.rate_hz)
        name = load_object(source).name
        rec = import_object(self.source, name, self.rate_hz, *self._span())
        write_object(rec, self.out, self.overwrite, inputs=(self.source, source))
        count = len(rec.tosses)
        record = {"recording": str(self.out), "object": name, "samples": len(rec.time), "episodes": count}
        self.output.give(
            record, [f"{self.out}: {count} tosses of {name}, {len(rec.time)} samples at {rec.rate_hz:g} Hz"]
        )
        return 0

    def _span(self) -> tuple[int, int | None]:
        if self.episodes is None:
            return 0, None
        first, colon, last = self.episodes.partition(":")
        if not (colon and (first or "0").isdigit() and (last or "0").isdigit()) or len(self.episodes) > 20:
            raise UserError("is no range", key="--episodes", expected="FIRST:LAST, such as 0:285", got=self.episodes)
        return int(first or 0), int(last) if last else None

    def _guessed(self, joints: tuple[str, ...], limits: Limits) -> ColumnMap | None:
        """The proposed map if it is to be used now: shown, saved or asked about as the arguments say."""
        from vispeg.recordings.importers.guess.source import guess
        from vispeg.recordings.importers.guess.words import advice, data, text

        if self.map is not None:
            raise UserError("a map is given already", key="--guess", expected="--guess or --map, not both")
        if not self.source.name.lower().endswith(TABLES):
            expected = f"a table ({', '.join(TABLES)}); archives and bags name their signals themselves"
            raise UserError("cannot be guessed", file=self.source, key="--guess", expected=expected)
        proposal = guess(self.source, joints, limits)
        if self.torque_sensor is not None:
            proposal.recording["torque_sensor"] = self.torque_sensor
            proposal.doubts[:] = [doubt for doubt in proposal.doubts if not doubt.startswith("torque_sensor")]
        shown = text(proposal)
        self.output.line(shown.rstrip("\n"))
        for line in advice(proposal):
            self.output.line(f"# {line}")
        if self.save_map is not None:
            if self.save_map.suffix.lower() not in (".yaml", ".yml"):
                raise UserError(
                    "is no name for a map", key="--save-map", expected="a .yaml file", got=str(self.save_map)
                )
            write_text_atomic(self.save_map, shown, overwrite=self.overwrite)
            self.output.line(f"written to {self.save_map}; use it with --map {self.save_map}")
        if self.out is None or not self._confirmed():
            map_file = None if self.save_map is None else str(self.save_map)
            self.output.give({"recording": None, "map": map_file, "proposal": data(proposal)}, [])
            return None
        return map_from(data(proposal), self.source, joints)

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

    def _refuse_units(self, rec: Recording, joints: tuple[str, ...], limits: Limits, mapping: ColumnMap) -> None:
        """Raises UserError where the units cannot be true, with the likely one, unless the user insists."""
        order = [joints.index(joint) for joint in rec.joints if joint in joints]
        if len(order) != len(rec.joints) or self.insist:
            return
        own = Limits(limits.range[order], limits.velocity[order], limits.torque[order])
        angles = [origin for target, origin in mapping.columns.items() if target.partition(".")[0] == "q"]
        found = doubts(rec, own, any(abs(origin.factor) == FACTORS["deg"] for origin in angles))
        if not found:
            return
        first, likely = found[0], {doubt.likely: None for doubt in found if doubt.likely}
        unit = f" (likely {' or '.join(likely)})" if likely else ""
        where = self.map or self.source
        expected = f"the right unit in {'the map' if self.map or self.guess else 'a map'}{unit}, or --insist"
        raise UserError(f"a unit cannot be true: {first.said}", file=where, key=first.key, expected=expected)

    def _known(self) -> dict[str, RecordedCamera]:
        """What --cameras says, by name."""
        if self.cameras is None:
            return {}
        from vispeg.render.camera_files import load_cameras
        from vispeg.vision.eye import recorded_of

        return {camera.name: recorded_of(camera) for camera in load_cameras(self.cameras)}

    def _read(self, robot: str, joints: tuple[str, ...], mapping: ColumnMap, scratch: Path) -> Recording:
        name = self.source.name.lower()
        header: dict[str, Any] = {"torque_sensor": mapping.recording.get("torque_sensor", "none")}
        if self.torque_sensor is not None:
            header["torque_sensor"] = self.torque_sensor
            mapping = replace(mapping, recording={**mapping.recording, "torque_sensor": self.torque_sensor})
        if name.endswith(BAGS) or (self.source / "metadata.yaml").is_file():
            return self._bag(robot, joints, mapping, header, scratch)
        for flag in ("topic", "command_topic", "pose_topic", "wrench_topic"):
            if getattr(self, flag) is not None:
                raise UserError(f"--{flag.replace('_', '-')} is for bags", file=self.source)
        if name.endswith(TABLES):
            from vispeg.recordings.importers.table import import_table

            with told(f"reading {self.source}", self.source.stat().st_size) as share:
                rec = import_table(self.source, robot, joints, mapping, share, **header)
            if not self.images:
                return rec
            from vispeg.recordings.importers.lerobot_video import import_video

            return replace(rec, frames=import_video(self.source, rec, self.images, self._known(), scratch))
        if self.images:
            raise UserError("--images is for bags and LeRobot tables", file=self.source)
        if name.endswith(".npz"):
            from vispeg.recordings.importers.npz import import_npz

            return import_npz(self.source, robot, joints, mapping, **header)
        choices = (*TABLES, ".npz", *BAGS, "a ROS 2 bag's folder")
        kind = self.source.suffix.lower() or self.source.name
        raise UserError("is nothing that can be converted", file=self.source, got=kind, choices=choices)

    def _bag(
        self, robot: str, joints: tuple[str, ...], mapping: ColumnMap, header: dict[str, Any], scratch: Path
    ) -> Recording:
        from vispeg.recordings.importers.rosbag import Topics, import_rosbag

        topics = Topics(self.topic, self.command_topic, self.pose_topic, self.wrench_topic, self.images)
        return import_rosbag(self.source, robot, joints, mapping, topics, scratch, self._known(), **header)
