"""Logs become recording folders: what `vispeg convert` does, from Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from vispeg.core.errors import UserError
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.importers.mapping import ColumnMap, read_map
from vispeg.recordings.importers.objects import import_object
from vispeg.recordings.importers.plausible import refuse_units
from vispeg.recordings.importers.rosbag import Topics
from vispeg.recordings.importers.source import read_source
from vispeg.recordings.objects import ObjectRecording, write_object
from vispeg.recordings.recording import Recording
from vispeg.recordings.write import write
from vispeg.render.cameras.camera_files import load_cameras
from vispeg.render.cameras.model_camera import cameras_of
from vispeg.robots.model import RobotModel, load
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
    torque_sensor: Literal["joint", "motor", "none"] | None = None,
    insist: bool = False,
    table: Literal["csv", "parquet"] = "csv",
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> Recording:
    """A log as a recording folder.

    Args:
        source: see `read_source`.
        robot: a name, or a path to an MJCF or URDF.
        out: the folder.
        mapping: names and units, or the YAML file with them; by default the recording format's own names.
        topics: of a bag.
        cameras: camera files with what the source does not say of its cameras; the robot's own file is asked before.
        torque_sensor: what measured torque is: behind the gear (joint) or from the current (motor).
        insist: take the stated units even where they cannot be true.
        table: format of the samples.
        overwrite: replace `out`.
        progress: called with the share of a table that is read.

    Raises:
        UserError: naming the file and what is wrong in it; `out` exists.
    """
    source, robot = Path(source), placed(robot)
    if not source.exists():
        raise UserError("does not exist", file=source)
    model = load(robot)
    files = [cameras] if isinstance(cameras, str | Path) else [*cameras]
    columns = mapping if isinstance(mapping, ColumnMap) else read_map(mapping, model.joints)
    with TemporaryDirectory() as scratch:
        rec = read_source(
            source,
            robot,
            model.joints,
            columns,
            topics=topics,
            cameras=_cameras(files, model),
            torque_sensor=torque_sensor,
            scratch=Path(scratch),
            progress=progress,
        )
        if not insist:
            file = mapping if isinstance(mapping, Path) else source
            refuse_units(rec, model, columns, file, "a map" if mapping is None else "the map", needs_of(model, rec))
        read = [source, mapping if isinstance(mapping, Path) else None, *files]
        write(rec, Path(out), overwrite, table, inputs=read)
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
    """A free object's tosses, an .npz archive, as a recording folder.

    Args:
        source: the archive, see `import_object`.
        robot: the path of the object's model.
        out: the folder.
        rate_hz: samples a second of an archive without `time`.
        first, last: the tosses taken, `last` not included.
        overwrite: replace `out`.

    Raises:
        UserError: no archive, or one of something else; a rate that cannot be; `out` exists.
    """
    source, robot = Path(source), placed(robot)
    if source.suffix.lower() != ".npz":
        expected = "an .npz archive with `state` and `start`; a table is a recording already, see docs/formats.md"
        raise UserError("cannot be converted", file=source, expected=expected)
    if rate_hz is not None and not 1 <= rate_hz <= 100_000:
        raise UserError("not a rate", key="--rate-hz", expected="1 to 100000 samples a second", got=rate_hz)
    rec = import_object(source, load_object(robot).name, rate_hz, first, last)
    write_object(rec, Path(out), overwrite, inputs=(source, robot))
    return rec


def placed(robot: str) -> str:
    """A robot's name, or the absolute path of its file: a recording may be read from another folder."""
    return str(Path(robot).expanduser().resolve()) if Path(robot).suffix else robot


def _cameras(files: Sequence[Path], robot: RobotModel) -> Mapping[str, RecordedCamera]:
    """What camera files say, over what the robot's own file does. Raises UserError: two files name one camera."""
    out = {c.name: recorded_of(c) for c in cameras_of(robot) if c.parent in ("base", "flange")}
    stated: dict[str, Path] = {}
    for file in files:
        for camera in load_cameras(file):
            if camera.name in stated:
                raise UserError(f"camera '{camera.name}' is stated twice", file=file, got=str(stated[camera.name]))
            stated[camera.name], out[camera.name] = Path(file), recorded_of(camera)
    return out
