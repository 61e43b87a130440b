"""`vispeg.convert`: convert logs to recording folders."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, get_args

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.core.several import several
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.frames.camera import RecordedCamera, Sensor
from vispeg.recordings.importers.guess.constants import KEY, Constant
from vispeg.recordings.importers.guess.constants import stated as stated_constants
from vispeg.recordings.importers.mapping import ColumnMap, checked_rate, read_map
from vispeg.recordings.importers.objects import import_object
from vispeg.recordings.importers.plausible import refuse_units
from vispeg.recordings.importers.rosbag import Topics
from vispeg.recordings.importers.source import is_bag, read_source
from vispeg.recordings.objects import ObjectRecording, write_object
from vispeg.recordings.recording import Recording
from vispeg.recordings.write import write
from vispeg.render.cameras.camera_files import load_posed
from vispeg.render.cameras.model_camera import cameras_of
from vispeg.robots.model import RobotModel, load, load_for
from vispeg.robots.objects import load_object
from vispeg.sim.units import needs_of
from vispeg.vision.eye import recorded_of


def convert(
    source: str | Path,
    robot: str,
    out: str | Path,
    *,
    mapping: ColumnMap | Path | None = None,
    topics: Topics | None = None,
    cameras: Path | Sequence[Path] = (),
    depth_camera: str | Sequence[str] = (),
    torque_sensor: Literal["joint", "motor", "none"] | None = None,
    torque_constants: Sequence[str] = (),
    rate_hz: float | None = None,
    column_names: Sequence[str] = (),
    insist: bool = False,
    table: Literal["csv", "parquet"] = "csv",
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> Recording:
    """Convert a log to a recording folder.

    Args:
        source: a table (.csv, .csv.gz, .tsv, .txt, .parquet), arrays (.hdf5, .h5, .mat, .npz, .npy, .json, .jsonl), a
            bag (.bag, .db3, .mcap), or a folder: a LeRobot data set, a ROS 2 bag, tables of episodes or of one run's
            signals.
        robot: a robot's name (iiwa14) or a path to its MJCF or URDF.
        out: the recording folder to write; not needed if a guess is only shown or saved.
        mapping: a YAML file with the source's names and units.
        topics: topics of a bag.
        cameras: camera files with intrinsics and poses that neither the source nor the robot's file has.
        depth_camera: kind of the depth cameras, which sets the expected depth noise: d405, d435 or structured_light;
            NAME=KIND if they differ.
        torque_sensor: where torque was measured: behind the gear (joint) or from the motor current (motor); default:
            torque is not used.
        torque_constants: for a bag or with --guess, if the log has motor currents in place of torques: N m/A at the
            joint (motor constant x gear ratio), as one number per joint, JOINT=NUMBER, or the name of an arm or servo
            (ur5e, XM430-W350).
        rate_hz: sample rate of a file without time stamps, Hz.
        column_names: names for the columns of a table without a header line; default: numbers from 1.
        insist: accept impossible units.
        table: format of the samples.
        overwrite: replace `out` if it exists.
        progress: called with the share of a table that is read.

    Raises:
        UserError: something is wrong in a file, which the error names, or `out` exists.
    """
    source, robot = Path(source), placed(robot)
    if not source.exists():
        raise UserError("does not exist", file=source)
    kinds, model = _kinds(depth_camera), load(robot)
    files = several(cameras)
    constants = stated_constants(torque_constants, model.joints) if torque_constants else None
    if constants is not None and not is_bag(source):
        expected = "--guess, a bag, or torque_constant in the map"
        raise UserError("are not used with this source", file=source, key=KEY, expected=expected)
    columns = mapping if isinstance(mapping, ColumnMap) else read_map(mapping, model.joints)
    if constants is not None and columns.motors:
        expected = "no `motors`: the constants are those at the joint"
        raise UserError("are not used with motors of a map", file=columns.file, key=KEY, expected=expected)
    if rate_hz is not None:
        if "time" in columns.columns or columns.rate_hz not in (None, rate_hz):
            expected = "one of both: no --rate-hz, or no `time` in the map"
            raise UserError("the map states the time too", file=columns.file, key="--rate-hz", expected=expected)
        columns = replace(columns, rate_hz=checked_rate(rate_hz, "--rate-hz"))
    if column_names:
        columns = replace(columns, dialect=replace(columns.dialect, names=tuple(column_names)))
    with TemporaryDirectory() as scratch:
        rec = read_source(
            source,
            robot,
            model.joints,
            columns,
            limits=Limits.of(model),
            topics=topics,
            cameras=_cameras(files, model),
            torque_sensor=torque_sensor,
            scratch=Path(scratch),
            progress=progress,
        )
        if constants is not None:
            rec = _of_currents(rec, constants, torque_sensor, source)
        if kinds:
            rec = _with_kinds(rec, kinds, source)
        if not insist:
            bag = is_bag(source)
            file = mapping if isinstance(mapping, Path) and not bag else source
            stated = "the bag" if bag else "a map" if mapping is None else "the map"
            refuse_units(rec, model, columns, file, stated, needs_of(load_for(rec.joints, robot), rec))
        read = [source, mapping if isinstance(mapping, Path) else None, *files]
        write(rec, expanded(out), overwrite, table, inputs=read)
    return rec


def convert_object(
    source: str | Path,
    robot: str,
    out: str | Path,
    *,
    rate_hz: float | None = None,
    first: int = 0,
    last: int | None = None,
    overwrite: bool = False,
) -> ObjectRecording:
    """Convert tosses of a free object, an .npz archive, to a recording folder.

    Args:
        source: the archive, see `import_object`.
        robot: path of the object's model.
        out: the recording folder to write.
        rate_hz: sample rate of an archive without `time`, Hz.
        first, last: range of tosses to convert, `last` excluded.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: not an archive of tosses, an impossible rate, or `out` exists.
    """
    source, robot = Path(source), placed(robot)
    if source.suffix.lower() != ".npz":
        expected = "an .npz archive with `state` and `start`; a table is a recording already, see docs/formats.md"
        raise UserError("cannot be converted", file=source, expected=expected)
    rate_hz = None if rate_hz is None else checked_rate(rate_hz, "--rate-hz")
    rec = import_object(source, load_object(robot).name, rate_hz, first, last)
    write_object(rec, expanded(out), overwrite, inputs=(source, robot))
    return rec


def placed(robot: str) -> str:
    """Return a robot's name, or the absolute path of its file, which stays valid in other folders."""
    return str(expanded(robot).resolve()) if Path(robot).suffix else robot


def _kinds(stated: str | Sequence[str]) -> dict[str, Sensor]:
    """Return the depth camera kind by camera, "" for all. Raises UserError: an unknown kind, or two for one camera."""
    out: dict[str, Sensor] = {}
    for text in [stated] if isinstance(stated, str) else stated:
        name, equals, kind = text.rpartition("=")
        known = next((k for k in get_args(Sensor) if k == kind), None)
        if known is None or (equals and not name):
            expected = "KIND or NAME=KIND"
            choices = get_args(Sensor)
            raise UserError(
                "no kind of depth camera", key="--depth-camera", expected=expected, got=text, choices=choices
            )
        if name in out or (out and "" in (name, *out)):
            raise UserError("a camera is stated twice", key="--depth-camera", got=text)
        out[name] = known
    return out


def _with_kinds(rec: Recording, kinds: Mapping[str, Sensor], source: Path) -> Recording:
    """Return the recording with the kinds of its depth cameras set. Raises UserError: a camera without depth."""
    frames = rec.frames
    deep = [] if frames is None else frames.deep
    if frames is None or not deep:
        expected = "pictures of depth, taken over with --images"
        raise UserError("no camera has depth", file=source, key="--depth-camera", expected=expected)
    for name in kinds:
        if name and name not in deep:
            raise UserError("no such camera with depth", file=source, key="--depth-camera", got=name, choices=deep)
    for_all = kinds.get("")
    return replace(rec, frames=frames.of_kinds(dict.fromkeys(deep, for_all) if for_all else kinds))


def _of_currents(
    rec: Recording,
    constants: Mapping[str, Constant],
    sensor: Literal["joint", "motor", "none"] | None,
    source: Path,
) -> Recording:
    """Convert efforts in A, measured and commanded, to torques in N m.

    Raises:
        UserError: no efforts, or a joint without a constant.
    """
    lacking = [joint for joint in rec.joints if joint not in constants]
    if rec.tau is None or lacking:
        what = "no constant of this joint" if lacking else "the bag has no efforts"
        raise UserError(what, file=source, key=KEY, got=", ".join(lacking) or None)
    factors = [constants[joint].value for joint in rec.joints]
    tau_cmd = None if rec.tau_cmd is None else rec.tau_cmd * factors
    return replace(rec, tau=rec.tau * factors, tau_cmd=tau_cmd, torque_sensor=sensor or "motor")


def _cameras(files: Sequence[Path], robot: RobotModel) -> Mapping[str, RecordedCamera]:
    """Return the robot file's cameras, overridden by what camera files state of them.

    Raises:
        UserError: two files name one camera.
    """
    out = {c.name: recorded_of(c) for c in cameras_of(robot) if c.parent in ("base", "flange")}
    stated: dict[str, Path] = {}
    for file in files:
        for camera, posed in load_posed(file):
            if camera.name in stated:
                raise UserError(f"camera '{camera.name}' is stated twice", file=file, got=str(stated[camera.name]))
            new, old = recorded_of(camera), out.get(camera.name)
            stated[camera.name] = Path(file)
            # a file without poses leaves that of the robot's file
            out[camera.name] = new if posed else replace(new, mount=old and old.mount, pose=old and old.pose)
    return out
