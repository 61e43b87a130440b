"""Load the sections of recording.yaml on contact."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.recordings.cell import BENCH, CellBelief, Outcome, WrenchSensor
from vispeg.recordings.schema import CellSection, OutcomeSection, WrenchSection


def cell(section: CellSection | None, file: Path) -> CellBelief | None:
    """Return the belief about the cell, with an absolute world path; its content is checked when the cell is built.

    Args:
        section: the key `cell` of recording.yaml.
        file: the file with that key: base of relative paths, and named in errors.

    Raises:
        UserError: no such world file.
    """
    if section is None:
        return None
    world = section.world
    if world.lower().endswith((".yaml", ".yml")):
        try:
            path = (file.parent / expanded(world, file, "cell.world")).resolve()
            exists = path.is_file()
        except (OSError, ValueError, RuntimeError) as error:
            raise UserError("is not a usable path", file=file, key="cell.world", got=world) from error
        if not exists:
            raise UserError("no such file", file=file, key="cell.world", expected="a world file", got=world)
        world = str(path)
    if world == BENCH:
        for key in ("task", "robot", "effects"):
            if getattr(section, key):
                expected = f"`world: {BENCH}` and `board` alone: all else is in the robot's file"
                raise UserError("is of a task's cell", file=file, key=f"cell.{key}", expected=expected)
    board = None if section.board is None else section.board.model_dump(exclude_unset=True)
    return CellBelief(world, section.task, _robot(section.robot, file), tuple(section.effects), board)


def _robot(stated: Any, file: Path) -> Any:
    """Return the robot that a cell states, with a relative path resolved against the folder of the stating file."""
    model = stated.get("model") if isinstance(stated, Mapping) else stated
    if not isinstance(model, str) or not Path(model).suffix:
        return stated
    path = str((file.parent / expanded(model, file, "cell.robot")).resolve())
    return {**stated, "model": path} if isinstance(stated, Mapping) else path


def wrench(section: WrenchSection | None) -> WrenchSensor | None:
    """Return the convention of the wrench; None if none is stated."""
    if section is None:
        return None
    (x, y, z), (qw, qx, qy, qz) = section.pos_m, section.quat
    return WrenchSensor(section.frame, section.acts_on, section.tared, (x, y, z), (qw, qx, qy, qz))


def outcomes(sections: list[OutcomeSection], episode: np.ndarray | None, file: Path) -> tuple[Outcome, ...]:
    """Return the outcomes of trials. Raises UserError: an outcome's episode is absent or has two outcomes."""
    episodes = {0} if episode is None else {int(number) for number in np.unique(episode)}
    for i, outcome in enumerate(sections):
        if outcome.episode not in episodes:
            got = outcome.episode
            raise UserError(
                "no such episode", file=file, key=f"outcome[{i}].episode", expected=sorted(episodes)[:9], got=got
            )
        if outcome.episode in {other.episode for other in sections[:i]}:
            raise UserError("is given twice", file=file, key=f"outcome[{i}].episode", got=outcome.episode)
    return tuple(Outcome(o.success, o.episode, o.category, o.peak_force_n, o.depth_m) for o in sections)
