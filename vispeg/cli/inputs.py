"""What several commands read: a model and recordings, checked against each other."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from vispeg.cli.reading import size_of, told
from vispeg.core.errors import UserError
from vispeg.recordings.load import load, needed
from vispeg.recordings.recording import Recording
from vispeg.recordings.schema import Header
from vispeg.recordings.windows import SECONDS, choose
from vispeg.worlds.model_file import load_model
from vispeg.worlds.world import World


def read_inputs(
    model: str,
    recording: Sequence[Path],
    validate: Sequence[Path],
    need_validate: bool = True,
    seconds: float = SECONDS,
    signals: Callable[[Header], Collection[str]] | None = needed,
) -> tuple[World, list[Recording], list[Recording]]:
    """The world and the fitted and held-out recordings.

    The model's robot takes the place of the recordings' where it is a file of the user's own. One recording after the
    other is read and cut to its windows, so that only one long one is in memory.

    Args:
        model: a model file, a robot's name, or a path to an MJCF or URDF.
        recording: to fit.
        validate: to judge on.
        need_validate: whether there must be one to judge on.
        seconds: of a longer recording the windows that show the most, this long in all; 0 uses all.
        signals: header -> what is kept of a recording beside `q`; None keeps all.

    Raises:
        UserError: none given, one given twice or on both sides, or another robot's.
    """

    world = read_model(model)
    if not recording:
        raise UserError("no recording given", key="--recording", expected="at least one folder")
    if need_validate and not validate:
        raise UserError("no recording to judge on", key="--validate", expected="at least one folder that is not fitted")
    for flag, paths in (("--recording", recording), ("--validate", validate)):
        _once(flag, paths)
    both = {p.resolve() for p in recording} & {p.resolve() for p in validate}
    if both:
        raise UserError("fitted and held out at once", file=sorted(both)[0], expected="different recordings")
    if not 0 <= seconds < float("inf"):
        raise UserError("is no length", key="--seconds", expected="seconds, or 0 for all", got=seconds)
    fitted, held_out = ([_read(p, world, seconds, signals) for p in paths] for paths in (recording, validate))
    for path, held in zip(validate, held_out, strict=True):
        for other, fit in zip(recording, fitted, strict=True):
            if np.array_equal(held.q, fit.q):
                raise UserError(f"a copy of {other}, which is fitted", file=path, expected="different recordings")
    return world, fitted, held_out


def _read(path: Path, world: World, seconds: float, signals: Callable[[Header], Collection[str]] | None) -> Recording:
    with told(f"reading {path}", size_of(path)) as share:
        rec = load(path, signals, share)
    return choose(_named(rec, world, path), seconds)


def read_model(source: str) -> World:
    """The world of a model file, a robot's name or a path; its robot, its tool and its effects' places are there.

    Raises:
        UserError: as `load_model`, and for a robot, tool or place that does not exist, with the file and key at fault.
    """
    from vispeg.core.effect import effect
    from vispeg.robots.model import load as load_robot
    from vispeg.worlds.words import place

    world = load_model(source)
    if Path(source).suffix.lower() not in (".yaml", ".yml"):
        return world
    with _said_of(source, "robot"):
        robot = load_robot(world.robot)
    with _said_of(source, "tool"):
        robot = load_robot(world.robot, tool=world.tool)
    for i, placed in enumerate(world.effects):
        with _said_of(source, f"effects[{i}].where"):
            place(effect(placed.effect), placed.where, robot)
    return world


@contextmanager
def _said_of(file: str | Path, key: str) -> Iterator[None]:
    """A mistake in what a file names is a mistake in that file."""
    try:
        yield
    except UserError as error:
        raise UserError(str(error), file=file, key=key) from error


def _once(flag: str, paths: Sequence[Path]) -> None:
    """Raises UserError for a recording given twice: the same noise would count as new evidence."""
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise UserError("given twice", file=path, key=flag, expected="each recording once")
        seen.add(path.resolve())


def _named(rec: Recording, world: World, path: Path) -> Recording:
    is_file = Path(world.robot).suffix != ""
    if not is_file and Path(rec.robot).suffix == "" and rec.robot != world.robot:
        raise UserError(
            "another robot than the model's",
            file=path / "recording.yaml",
            key="robot",
            expected=world.robot,
            got=rec.robot,
        )
    return replace(rec, robot=world.robot)
