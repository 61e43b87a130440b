"""Adds an effect to a model file, sets the values of one that is there, or adds the effects of a measurement.

MODEL is replaced only where --out names it and --overwrite is there. Parameters that are not set keep the model's
value. A new effect with no value set has its typical size; with some set, its other sizes are null.

Example:
    vispeg add iiwa14 coulomb_friction joint4 --set torque=1.2 --out model.yaml
    vispeg add model.yaml payload flange --set mass=0.6 z=0.07 --out model2.yaml
    vispeg add model.yaml joint4/measurement.yaml --out model2.yaml
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from vispeg.cli.output import Output, OutputOptions

if TYPE_CHECKING:
    from vispeg.core.effect import EffectInstance, Value
    from vispeg.robots.model import RobotModel
    from vispeg.worlds.world import World


@dataclass(frozen=True, kw_only=True)
class Args:
    """Arguments of `vispeg add`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF."""
    effect: tyro.conf.Positional[str]
    """Name of the effect (`vispeg effects` lists them), or a measurement file, whose effects are added as measured."""
    where: tyro.conf.Positional[str | None] = None
    """Where it acts: a joint, a link, `flange`, `base`, or `all`."""
    out: Path
    """The model file to write."""
    set: tuple[str, ...] = ()
    """Values, such as torque=1.2 velocity=0.05."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Writes the model file and prints what is in it."""
        import os
        from dataclasses import replace

        from vispeg.api.inputs import read_model
        from vispeg.core.effect import effect
        from vispeg.core.errors import UserError
        from vispeg.core.files import write_text_atomic
        from vispeg.worlds.model_file import load_model, model_text, placed_dict

        if self.out.suffix.lower() not in (".yaml", ".yml"):
            raise UserError("not a model file", key="--out", expected="a name that ends in .yaml", got=str(self.out))
        world = read_model(self.model)
        if self.overwrite and self.out.is_file():
            load_model(self.out)  # what is no model is not replaced
        robot = _places(world)
        added = self._measured(world, robot) if _is_file(self.effect) else [self._typed(world, robot)]
        world = world.add(*added)
        if Path(world.robot).suffix:  # a model file names its robot relative to itself
            world = replace(world, robot=os.path.relpath(Path(world.robot).resolve(), self.out.resolve().parent))
        write_text_atomic(self.out, model_text(world), overwrite=self.overwrite)
        lines = [f"{self.out}: {world.label}"]
        for placed in added:
            params = effect(placed.effect).params
            each = ", ".join(f"{k} {_shown(v)} {params[k].unit}" for k, v in placed.params.items())
            lines.append(f"{placed.label}: {each}")
        record = {"model": str(self.out), "label": world.label, "added": [placed_dict(placed) for placed in added]}
        self.output.give(record, lines)
        return 0

    def _typed(self, world: World, robot: RobotModel) -> EffectInstance:
        """The effect that the arguments spell out."""
        from vispeg.core.effect import EffectInstance, effect
        from vispeg.core.errors import UserError
        from vispeg.worlds.words import completed, place, values

        kind = effect(self.effect)
        if self.where is None:
            raise UserError(f"{kind.name} needs a place", expected="WHERE after it", choices=kind.targets(robot))
        where, settings = place(kind, self.where, robot), values(kind, self.set)
        here = [e for e in world.effects if (e.effect, e.where) == (self.effect, where)]
        return (
            here[0].with_values(**settings)
            if here
            else EffectInstance.of(self.effect, where, **completed(kind, settings))
        )

    def _measured(self, world: World, robot: RobotModel) -> list[EffectInstance]:
        """The effects of a measurement file, intervals and all."""
        from vispeg.core.effect import effect
        from vispeg.core.errors import UserError
        from vispeg.worlds.measurement_file import load_measurement
        from vispeg.worlds.words import place

        measurement = load_measurement(self.effect)
        if self.where is not None or self.set:
            raise UserError("a measurement has its own place and values", expected="no WHERE and no --set beside it")
        if measurement.robot not in (None, world.robot) and not Path(measurement.robot or "").suffix:
            raise UserError(
                "of another robot", file=self.effect, key="robot", expected=world.robot, got=measurement.robot
            )
        if not measurement.effects:
            raise UserError("holds no effect", file=self.effect, key="effects", expected="one or more")
        for placed in measurement.effects:
            if not effect(placed.effect).targets(robot):
                expected = f"it in a world file: `model: {self.effect}`"
                what = f"{placed.effect} acts on a scene, not on an arm alone"
                raise UserError(what, file=self.effect, key="effects", expected=expected)
            place(effect(placed.effect), placed.where, robot)
        return list(measurement.effects)


def _places(world: World) -> RobotModel:
    """What effects are placed on: the arm, or the cell with its own cameras and those that the model speaks of."""
    from dataclasses import replace

    from vispeg.core.effect import effect
    from vispeg.render.cameras.standard import standard_cameras
    from vispeg.robots.scene import Scene
    from vispeg.task.belief import robot_of_world

    robot = robot_of_world(world)
    if not isinstance(robot, Scene):
        return robot
    extra = [e.where for e in world.effects if effect(e.effect).family == "camera"]
    standard = [camera.name for camera in standard_cameras(robot.tip, robot.target)]
    return replace(robot, cameras=tuple(dict.fromkeys([*standard, *extra])))


def _is_file(text: str) -> bool:
    return Path(text).suffix.lower() in (".yaml", ".yml")


def _shown(value: Value) -> str:
    interval = "" if value.low is None else f" [{value.low:.4g}, {value.high:.4g}]"
    return f"{value.value:g}{interval}"
