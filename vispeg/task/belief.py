"""Build the surroundings of the arm as the user believes them to be: a task's cell, or the scene in the robot's file.

A cell consists of the MuJoCo scene, the task's settings, and the effects that the user believes to be present.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.recordings.cell import OPEN_CELL, CellBelief
from vispeg.recordings.recording import Recording
from vispeg.robots.bench import bench, shows
from vispeg.robots.declare import RobotConfig
from vispeg.robots.declared import carried
from vispeg.robots.model import RobotModel, load, same
from vispeg.robots.scene import Scene
from vispeg.task.config import TaskConfig
from vispeg.task.registry import config_of, task_of
from vispeg.task.world_file import load_world
from vispeg.task.world_robot import declared
from vispeg.worlds.model_file import read_placed
from vispeg.worlds.places import instances
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.words import place
from vispeg.worlds.world import World

DEFAULT = "nominal"  # world of a belief that names no world


@dataclass(frozen=True, eq=False)
class Believed:
    """A belief about the cell, as a model.

    Attributes:
        scene: nominal arm, tool, held part, fixture and table; `scene.nominal` is the arm and what it carries, without
            surroundings.
        config: the task's settings: geometry, contact and controller.
        world: the robot and the believed effects, which are applied to the scene.
    """

    scene: Scene
    config: TaskConfig
    world: World

    @property
    def seen(self) -> Scene:
        """The scene as cameras see it: with the believed effects, which are those that it states."""
        return replace(self.scene, stated=self.world.effects) if self.world.effects else self.scene


def believed(cell: CellBelief | None, file: str | Path | None = None, robot: str | None = None) -> Believed:
    """Build the scene, settings and effects of a belief; None and OPEN_CELL stand for the default cell.

    Equal beliefs give the same scene.

    Args:
        cell: what is believed.
        file: the file that states the belief, for error messages.
        robot: name or path of the robot; a cell that names no robot gets this one.

    Raises:
        UserError: no such world, an unknown key, impossible geometry, no such effect or place, a cell that names
            another robot, or a bench, which has no task.
    """
    cell = cell or CellBelief()
    at = str(file) if file is not None else None
    if cell.bench:
        expected = "a world's name or file: a tool touches and fits in a task's cell"
        raise UserError("a bench has no task", file=at, key="cell.world", expected=expected, got=cell.world)
    named = DEFAULT if cell.world in ("", OPEN_CELL) else cell.world
    try:
        world = load_world(named)
    except UserError as error:
        raise UserError(str(error), file=at, key="cell.world") from error
    settings = {**world.task, **cell.task}
    try:
        if cell.robot is not None:
            settings["robot"] = declared(cell.robot, Path(at or "."), {})
        elif robot not in (None, RobotConfig.model) and "robot" not in settings:
            settings["robot"] = {"model": robot}
        config = config_of(settings, at)
        scene = task_of(config).cell(config)
    except UserError as error:
        raise UserError(str(error), key="cell") from error
    if robot is not None and not same(robot, config.robot.model):
        got, expected = config.robot.model, f"{robot}, or no robot in `cell`"
        raise UserError("the cell belongs to another robot", file=at, key="cell.robot", expected=expected, got=got)
    effects = [*fixed(world.world, scene), *_effects(cell.effects, scene, at)]
    return Believed(scene, config, World(config.robot.model, None).add(*effects))


def recorded_cell(rec: Recording) -> Believed:
    """Build the task's cell that a recording states, with its robot. Raises UserError as `believed` does."""
    return believed(rec.cell, rec.path / "recording.yaml", rec.robot)


def model_cell(world: World) -> Believed:
    """Build the task's cell of a model, with its robot. Raises UserError as `believed` does."""
    return believed(world.cell, robot=world.robot)


def bench_of(world: World) -> Scene:
    """Return the scene of a model without a task's cell: the arm and the surroundings in the robot's own file."""
    return bench(load(world.robot, tool=world.tool))


def scene_of(world: World, rec: Recording) -> Scene:
    """Return the scene that a recording's cameras see according to a model: its cell, or the scene in its robot's file.

    A cell comes with the effects that it states.

    Raises:
        UserError: as `believed`.
    """
    cell = cell_of(world, rec)
    if cell is None:
        return bench_of(world)
    return believed(cell, rec.path / "recording.yaml", world.robot).seen


def fixed(world: RandomizedWorld, scene: Scene) -> list[EffectInstance]:
    """Return the effects of a world that are the same in every episode: a belief has no randomized effects."""
    out = list(world.base.effects)
    for r in world.ranges:
        params = {name: v for name, v in r.params.items() if isinstance(v, int | float)}
        if r.chance == 1.0 and len(params) == len(r.params):
            places = instances(effect(r.effect), r.where, scene)
            out += [EffectInstance.of(r.effect, where, **params) for where in places]
    return out


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
    """Return the cell in which a model places a recording: the model's own, or the recording's if that is OPEN_CELL.

    Return None for the scene in the robot's own file: if the model has no cell, or if its cell is OPEN_CELL and the
    recording states a bench.
    """
    if world.cell is None or (world.cell.open and rec.cell is not None and rec.cell.bench):
        return None
    return (rec.cell or CellBelief(DEFAULT)) if world.cell.open else world.cell


def of_world(name: str) -> World:
    """Return a built-in world or world file as a model: its arm with what it carries, and its cell as the belief.

    Raises:
        UserError: as for `believed`.
    """
    cell = CellBelief(str(Path(name).resolve()) if Path(name).suffix else name)
    belief = believed(cell, name)
    tool = carried(belief.scene.nominal.compile())
    return World(belief.config.robot.model, tool, cell=cell)


def robot_of_world(world: World) -> RobotModel:
    """Return the robot model to which a world's effects apply.

    This is the scene of its cell, else the scene in its robot's file if that shows surroundings, else the arm alone.
    """
    if world.cell is not None:
        return model_cell(world).scene
    scene = bench_of(world)
    return scene if shows(scene) else scene.nominal
