"""The cell that a user believes in, built: the MuJoCo scene, the task's settings, and the effects that are believed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.recordings.cell import OPEN_CELL, CellBelief
from vispeg.recordings.recording import Recording
from vispeg.robots.declared import carried
from vispeg.robots.model import RobotModel, load
from vispeg.robots.scene import Scene
from vispeg.task.config import TaskConfig
from vispeg.task.registry import config_of, task_of
from vispeg.task.world_file import load_world
from vispeg.task.world_robot import declared
from vispeg.worlds.model_file import read_placed
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.words import place
from vispeg.worlds.world import World

DEFAULT = "nominal"  # the world of a belief that names none


@dataclass(frozen=True, eq=False)
class Believed:
    """A belief, built.

    Attributes:
        scene: arm, tool, what it holds, fixture and table, all of them nominal; `scene.nominal` is the arm with what it
            carries alone.
        config: the task's settings: geometry and contact, and its controller.
        world: the robot and the believed effects, to be placed on the scene.
    """

    scene: Scene
    config: TaskConfig
    world: World


def believed(cell: CellBelief | None, file: str | Path | None = None) -> Believed:
    """Builds a belief; None and OPEN_CELL stand for the default cell. The same belief gives the same scene.

    Args:
        cell: what is believed.
        file: where it was stated, for errors.

    Raises:
        UserError: no such world, an unknown key, geometry that cannot be, no such effect or place.
    """
    cell = cell or CellBelief()
    at = str(file) if file is not None else None
    named = DEFAULT if cell.world in ("", OPEN_CELL) else cell.world
    try:
        world = load_world(named)
    except UserError as error:
        raise UserError(str(error), file=at, key="cell.world") from error
    settings = {**world.task, **cell.task}
    try:
        if cell.robot is not None:
            settings["robot"] = declared(cell.robot, Path(at or "."), {})
        config = config_of(settings, at)
        scene = task_of(config).cell(config)
    except UserError as error:
        raise UserError(str(error), key="cell") from error
    effects = [*fixed(world.world), *_effects(cell.effects, scene, at)]
    return Believed(scene, config, World(config.robot.model, None).add(*effects))


def fixed(world: RandomizedWorld) -> list[EffectInstance]:
    """The effects of a world that are the same in every episode; what is drawn is nobody's belief."""
    same = [r for r in world.ranges if r.chance == 1.0 and all(isinstance(v, int | float) for v in r.params.values())]
    return [*world.base.effects, *(EffectInstance.of(r.effect, r.where, **dict(r.params)) for r in same)]  # type: ignore[arg-type]


def _effects(stated: tuple[Mapping[str, Any], ...], scene: Scene, file: str | None) -> list[EffectInstance]:
    out = []
    for i, entry in enumerate(stated):
        key = f"cell.effects[{i}]"
        placed = read_placed(entry, Path(file or "."), key)
        try:
            place(effect(placed.effect), placed.where, scene)
        except UserError as error:
            raise UserError(str(error), file=file, key=f"{key}.where") from error
        out.append(placed)
    return out


def cell_of(world: World, rec: Recording) -> CellBelief | None:
    """The cell of a recording under a model: the model's, or where that leaves it open (OPEN_CELL) the recording's.

    None where the model is of an arm alone.
    """
    if world.cell is None:
        return None
    return (rec.cell or CellBelief(DEFAULT)) if world.cell.open else world.cell


def of_world(name: str) -> World:
    """The model that a world's name or file is: its arm with what the arm carries, and its cell as the belief.

    Raises:
        UserError: as for `believed`.
    """
    cell = CellBelief(str(Path(name).resolve()) if Path(name).suffix else name)
    belief = believed(cell, name)
    tool = carried(belief.scene.nominal.compile())
    return World(belief.config.robot.model, tool, cell=cell)


def robot_of_world(world: World) -> RobotModel:
    """What a model's effects are placed on: the scene of its cell, or the arm alone."""
    return load(world.robot, tool=world.tool) if world.cell is None else believed(world.cell).scene
