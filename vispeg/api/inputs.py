"""Read a model and recordings, and check them against each other."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NotRequired, TypedDict

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.core.provenance import Provenance, digest, here
from vispeg.core.several import each_once, several
from vispeg.recordings.checks.cleared import cleared
from vispeg.recordings.frames.files import FOLDER
from vispeg.recordings.load import load, needed
from vispeg.recordings.progress import Reading, silent
from vispeg.recordings.recording import Recording, in_order
from vispeg.recordings.schema import Header
from vispeg.recordings.windows import SECONDS, choose, split
from vispeg.robots import resources
from vispeg.robots.declared import declared
from vispeg.robots.model import RobotModel
from vispeg.robots.model import load as load_robot
from vispeg.robots.objects import is_object
from vispeg.robots.tools import stated
from vispeg.sim.units import check_units
from vispeg.task.belief import believed, cell_of, of_world
from vispeg.task.world_file import is_world
from vispeg.vision.eye import posed
from vispeg.worlds.model_file import load_model, model_text
from vispeg.worlds.words import place
from vispeg.worlds.world import World

Model = World | str | Path
Source = Recording | str | Path
ToolNumbers = tuple[float, np.ndarray, np.ndarray]  # kg; centre, m; inertia, kg m^2


@dataclass(frozen=True)
class Inputs:
    """A model and recordings, ready for a comparison, a fit or a diagnosis.

    Attributes:
        world: the model.
        fitted, held_out: the recordings to fit and those held out.
        digests: name given by the user -> digest of the content, for the fitted and for the held-out recordings.
        files: files and folders that were read.
        hold_out: share of each recording that is held out at its end; None if separate recordings are held out.
    """

    world: World
    fitted: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    digests: tuple[Mapping[str, str], Mapping[str, str]]
    files: tuple[str | Path, ...]
    hold_out: float | None = None

    def provenance(self, seed: int | None) -> Provenance:
        """Return the provenance of a result: everything needed to repeat it."""
        return here(seed, {**self.digests[0], **self.digests[1]})

    def key(self) -> list[object]:
        """Return everything that determines a result, as plain data."""
        robot = resources.digest(self.world.robot) if Path(self.world.robot).is_file() else None
        return [model_text(self.world), robot, *([*group.values()] for group in self.digests), self.hold_out]


def load_recording(path: str | Path, *, seconds: float = 0.0) -> Recording:
    """Read the recording in a folder with recording.yaml and samples.csv or samples.parquet; see docs/formats.md.

    Args:
        path: the folder.
        seconds: of a longer recording, keep only the most informative windows, this many seconds in total; 0 keeps
            everything.

    Raises:
        UserError: something is missing, malformed or implausible; the error names the file and the key, column or row.
    """
    return choose(load(path), seconds)


def read_inputs(
    model: Model,
    recordings: Source | Sequence[Source],
    validate: Source | Sequence[Source],
    *,
    need_validate: bool = True,
    hold_out: float | None = None,
    seconds: float = SECONDS,
    signals: Callable[[Header], Collection[str]] | None = needed,
    reading: Reading = silent,
) -> Inputs:
    """Read the model, and the fitted and held-out recordings.

    If the model's robot is the user's file, it replaces the recordings' robot. Each recording is cut to its windows
    before the next is read, so that at most one long recording is in memory.

    Args:
        model: a world, a model file, a robot's name, or a path to an MJCF or URDF.
        recordings: recordings to fit: folders, or objects in memory.
        validate: held-out recordings.
        need_validate: whether held-out data are required.
        hold_out: share of each recording to hold out at its end; only without `validate`.
        seconds: of longer recordings, use only the most informative windows, this many seconds in total; 0 uses
            everything.
        signals: header -> signals to keep besides `q`; None keeps all.
        reading: shows progress while a recording is read.

    Raises:
        UserError: no recording, one given twice or on both sides, a copy, or another robot's.
    """
    world = model if isinstance(model, World) else read_model(str(model))
    _refuse_object(world)
    fit, judge = several(recordings), several(validate)
    if not fit:
        raise UserError("no recording given", key="--recording", expected="at least one folder")
    if hold_out is not None and judge:
        raise UserError("cannot be combined with --validate", key="--hold-out", expected="one of them")
    if need_validate and not judge and hold_out is None:
        expected = "a folder that is not fitted; with only one recording, --hold-out 0.3 judges on its last 30 %"
        raise UserError("no recording to judge on", key="--validate", expected=expected)
    for flag, sources in (("--recording", fit), ("--validate", judge)):
        each_once(map(_path, sources), flag)
    both = {_path(s).resolve() for s in fit} & {_path(s).resolve() for s in judge}
    if both:
        raise UserError("fitted and held out at once", file=sorted(both)[0], expected="different recordings")
    if not 0 <= seconds < float("inf"):
        raise UserError("not a length", key="--seconds", expected="seconds, or 0 for all", got=seconds)
    if hold_out is not None:
        whole = [_read(s, world, 0.0, signals, reading) for s in fit]
        world = _with_tool(_of_recordings(world, whole), whole)
        halves = [split(rec, hold_out) for rec in whole]
        fitted, held_out = (tuple(choose(rec, seconds) for rec in side) for side in zip(*halves, strict=True))
        digests = {str(_path(s)): _digest(s) for s in fit}
        ends = {f"{name}, last {hold_out:.0%}": value for name, value in digests.items()}
        return Inputs(world, fitted, held_out, (digests, ends), _files(model, world, fit), hold_out)
    fitted, held_out = (tuple(_read(s, world, seconds, signals, reading) for s in sources) for sources in (fit, judge))
    world = _with_tool(_of_recordings(world, (*fitted, *held_out)), (*fitted, *held_out))
    for held, path in zip(held_out, map(_path, judge), strict=True):
        for other, rec in zip(map(_path, fit), fitted, strict=True):
            if np.array_equal(held.q, rec.q, equal_nan=True):
                raise UserError(f"a copy of {other}, which is fitted", file=path, expected="different recordings")
    digests = tuple({str(_path(s)): _digest(s) for s in sources} for sources in (fit, judge))
    return Inputs(world, fitted, held_out, (digests[0], digests[1]), _files(model, world, (*fit, *judge)))


def _files(model: Model, world: World, sources: Sequence[Source]) -> tuple[str | Path, ...]:
    """Return the files that were read: the model's files and the recordings' folders."""
    source = [] if isinstance(model, World) else [str(model)]
    return (*source, world.robot, *(p for p in map(_path, sources) if p.exists()))


def _path(source: Source) -> Path:
    return source.path if isinstance(source, Recording) else Path(source)


def _digest(source: Source) -> str:
    """Return the SHA-256 of a folder's content, or of a recording in memory."""
    return f"sha256:{_hash(source).hex() if isinstance(source, Recording) else digest(source)}"


def _hash(value: object) -> bytes:
    """Hash a value by its parts: an array by type, shape and numbers, as NumPy abbreviates the text of a long one."""
    if isinstance(value, np.ndarray):
        parts = [repr((value.dtype.str, value.shape)).encode(), np.ascontiguousarray(value).tobytes()]
    elif dataclasses.is_dataclass(value):
        parts = [_hash((field.name, getattr(value, field.name))) for field in dataclasses.fields(value)]
    elif isinstance(value, Mapping):
        parts = [_hash(item) for item in value.items()]
    elif isinstance(value, list | tuple):
        parts = [_hash(item) for item in value]
    else:
        parts = [repr(value).encode()]
    hashed = hashlib.sha256(f"{type(value).__name__} {[*map(len, parts)]}".encode())
    for part in parts:
        hashed.update(part)
    return hashed.digest()


def _read(
    source: Source,
    world: World,
    seconds: float,
    signals: Callable[[Header], Collection[str]] | None,
    reading: Reading,
) -> Recording:
    """Return a recording of the model's robot, with checked units, cut to its most informative windows."""
    if isinstance(source, Recording):
        rec = source
    else:
        with reading(Path(source)) as progress:
            rec = load(source, None if signals is None else lambda header: (*signals(header), "dq"), progress)
    rec = _of_robot(rec, world, _path(source))
    check_units(rec)
    rec = cleared(rec)
    if signals is needed and rec.control.mode != "osc":
        rec = replace(rec, dq=None)  # it was only needed to check the angles
    if rec.chosen is not None:
        return rec
    return choose(rec, seconds)


def of_cell(model: Model) -> bool:
    """Return whether a model has a cell, so that contact can be compared."""
    return (model if isinstance(model, World) else read_model(str(model))).cell is not None


class Windows(TypedDict):
    """Arguments of `read_inputs`: seconds to use in total (0 for all), and signals to keep (None for all)."""

    seconds: float
    signals: NotRequired[None]


def windows(model: Model, seconds: float, *groups: Source | Sequence[Source]) -> Windows:
    """Return `seconds` for an arm; use everything if there are pictures or a cell, for a cell with all signals."""
    if of_cell(model):
        return {"seconds": 0.0, "signals": None}
    sources = [source for group in groups for source in several(group)]
    return {"seconds": 0.0 if any(map(_pictured, sources)) else seconds}


def _pictured(source: Source) -> bool:
    return source.frames is not None if isinstance(source, Recording) else (Path(source) / FOLDER).is_dir()


def read_model(source: str) -> World:
    """Read the world of a model file, a robot's name or a path, and check its robot, tool and places of effects.

    OPEN_CELL stands for the cell that each recording states; the name or file of a world stands for its cell.

    Raises:
        UserError: as for `load_model`, or a robot, tool or place that does not exist; the error names file and key.
    """
    if is_world(source):
        return of_world(source)
    world = load_model(source)
    _refuse_object(world)
    if Path(source).suffix.lower() not in (".yaml", ".yml"):
        load_robot(world.robot)  # report an invalid file here, before recordings are read
        return world
    if not world.robot:  # the arm is that of the world that the cell names
        world = replace(world, robot=believed(world.cell, source).config.robot.model)
    with _attributed_to(source, "robot"):
        robot: RobotModel = load_robot(world.robot)
    with _attributed_to(source, "tool"):
        robot = load_robot(world.robot, tool=world.tool)
    robot = robot if world.cell is None else believed(world.cell, source, world.robot).scene
    for i, placed in enumerate(world.effects):
        if effect(placed.effect).family == "camera":
            continue  # cameras are those of the recordings
        with _attributed_to(source, f"effects[{i}].where"):
            place(effect(placed.effect), placed.where, robot)
    return world


def model_files(source: str) -> tuple[str, ...]:
    """Return the model file, and the robot's file that it names if it can be read."""
    try:
        return source, load_model(source).robot
    except UserError:  # reported when the model is read
        return (source,)


def _refuse_object(world: World) -> None:
    """Raise UserError if a model is a free object instead of a robot."""
    if is_object(world.robot):
        raise UserError("a free object: vispeg diagnose reads its tosses", key="model", expected="a robot or a cell")


@contextmanager
def _attributed_to(file: str | Path, key: str) -> Iterator[None]:
    """Attribute a UserError in the body of `with` to a key of this file, which names the faulty thing."""
    try:
        yield
    except UserError as error:
        raise UserError(str(error), file=file, key=key) from error


def _of_robot(rec: Recording, world: World, path: Path) -> Recording:
    """Return the recording with the model's robot; raise UserError if the two name different robots.

    If the model leaves the cell to the recordings, each keeps its own robot.
    """
    if world.cell is not None and world.cell.open:
        return _placed(rec, world, load_robot(rec.robot))
    is_file = Path(world.robot).suffix != ""
    if not is_file and Path(rec.robot).suffix == "" and rec.robot != world.robot:
        raise UserError(
            "another robot than the model's",
            file=path / "recording.yaml",
            key="robot",
            expected=world.robot,
            got=rec.robot,
        )
    return _placed(replace(rec, robot=world.robot), world, load_robot(world.robot))


def _placed(rec: Recording, world: World, robot: RobotModel) -> Recording:
    """Return the recording in the model's cell, with joints in the robot's order and cameras posed by its file."""
    rec = replace(in_order(rec, robot.joints), cell=cell_of(world, rec) or rec.cell)
    return rec if rec.frames is None else replace(rec, frames=posed(rec.frames, robot))


def _of_recordings(world: World, recordings: Sequence[Recording]) -> World:
    """Return the model; if it leaves the cell to the recordings, with their robot. Raises UserError: they differ."""
    if world.cell is None or not world.cell.open or not recordings:
        return world
    first = recordings[0]
    for rec in recordings:
        if rec.robot != first.robot:
            file = rec.path / "recording.yaml"
            raise UserError("of another robot", file=file, key="robot", expected=first.robot, got=rec.robot)
    return replace(world, robot=first.robot)


def _with_tool(world: World, recordings: Sequence[Recording]) -> World:
    """Return an arm's model with the tool that all recordings declare, if it declares none itself.

    Each recording is compared with its own tool. A note names those that declare another one than the model, or none.
    """
    if world.cell is not None or not recordings:
        return world
    carried = [None if rec.tool is None else stated(rec.tool) for rec in recordings]
    if world.tool is None:
        equal = carried[0] is not None and all(map(partial(_same_tool, carried[0]), carried))
        return replace(world, tool=recordings[0].tool) if equal else world
    model_tool = declared(world.robot, world.tool)
    numbers = None if model_tool is None else stated(model_tool)
    others = [rec.name for rec, tool in zip(recordings, carried, strict=True) if not _same_tool(numbers, tool)]
    if others:
        note(f"{', '.join(others)}: the recording's `tool` is not the model's; it is compared with its own")
    return world


def _same_tool(one: ToolNumbers | None, other: ToolNumbers | None) -> bool:
    """Return whether two tools have the same mass, centre and inertia, or are both none."""
    if one is None or other is None:
        return one is other
    return all(np.allclose(a, b, rtol=1e-6, atol=1e-9) for a, b in zip(one, other, strict=True))
