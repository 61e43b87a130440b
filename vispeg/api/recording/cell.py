"""Motions of the flange in a cell, by name or from a table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.task.belief import model_cell
from vispeg.task.registry import FIRST, task, task_of
from vispeg.task.rig import table
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.expert import EXPERT
from vispeg.task.rig.motions import motion
from vispeg.worlds.world import World


def motions_of(world: World | None = None) -> tuple[str, ...]:
    """Return the names of the motions for a world's cell, or for the built-in task without one, and `expert`."""
    offered = task(FIRST) if world is None or world.cell is None else task_of(model_cell(world).config)
    return *offered.motions, EXPERT


def cell_motion(world: World, name: str, *, rate_hz: float, seed: int, force_limit: float | None = None) -> CellMotion:
    """Return a commanded motion for the cell of a world, by name or from a table.

    Args:
        world: a world with a cell.
        name: name of a motion, or a .csv or .parquet file with `time` and `ee_cmd` columns.
        rate_hz: control rate, Hz.
        seed: seed of small variations of places, forces and speeds.
        force_limit: force limit, N, in place of the motion's.

    Raises:
        UserError: no such motion or file, or a motion that the arm cannot make.
    """
    cell = model_cell(world)
    if Path(name).suffix:
        return table.read(Path(name), cell.scene.joints, rate_hz, force_limit)
    paths = task_of(cell.config).motions
    if name not in paths:
        raise UserError("not a motion of a cell", key="--motion", got=name, choices=(*paths, EXPERT))
    commanded = motion(name, cell.scene, cell.config, rate_hz, stream(seed, "record", name), paths)
    return commanded if force_limit is None else replace(commanded, force_limit=force_limit)
