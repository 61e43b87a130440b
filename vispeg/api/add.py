"""Add an effect to a model file, as `vispeg add` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from vispeg.api.inputs import read_model
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.core.paths import expanded
from vispeg.core.several import several
from vispeg.render.cameras.model_camera import cameras_of
from vispeg.render.cameras.standard import standard_cameras
from vispeg.report.text.summary import Block, Line, Summarised
from vispeg.robots.model import RobotModel, same
from vispeg.robots.scene import Scene
from vispeg.task.belief import robot_of_world
from vispeg.worlds.identified import constant, without_interval
from vispeg.worlds.measurement_file import load_measurement
from vispeg.worlds.model_file import load_model, placed_dict, write_model
from vispeg.worlds.places import MANY, acts_on
from vispeg.worlds.words import completed, place, values
from vispeg.worlds.world import World


@dataclass(frozen=True)
class AddedEffects(Summarised):
    """A model file with added effects.

    Attributes:
        file: the model file.
        world: the model.
        added: effects that were added, or got new values.
    """

    file: Path
    world: World
    added: Sequence[EffectInstance]

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg add --json`."""
        added = [placed_dict(instance) for instance in self.added]
        return {"model": str(self.file), "label": self.world.label, "added": added}

    @property
    def summary(self) -> list[Block]:
        """The model, and the values of each added effect."""
        lines = [f"{self.file}: {self.world.label}"]
        for instance in self.added:
            params = effect(instance.effect).params
            each = ", ".join(f"{k} {_shown(v)} {params[k].unit}" for k, v in instance.params.items())
            lines.append(f"{instance.label}: {each}")
        # Warn of measured values that lack an interval. Values that the user stated never have one: no warning.
        measured = [e for e in self.added if any(v.low is not None for v in e.params.values())]
        bare = [Line(constant(e, names), warning=True) for e in measured if (names := without_interval(e))]
        return [*(Line(text, path=True) for text in lines), *bare]


def add(
    model: str,
    name: str,
    out: str | Path,
    *,
    where: str | None = None,
    settings: str | Sequence[str] = (),
    overwrite: bool = False,
) -> AddedEffects:
    """Add an effect, change the values of an existing one, or add the effects of a measurement.

    Args:
        model: a model file, a robot's name, or a path to an MJCF or URDF.
        name: an effect's name (`vispeg effects` lists them), or a measurement file, whose effects are added.
        out: the model file to write.
        where: place: a joint, a link, `flange`, `base`, or `all`; a measurement has its own place.
        settings: values, such as torque=1.2 velocity=0.05; in one text, or each in its own.
        overwrite: replace `out`, if it is a model file.

    Raises:
        UserError: no such model, effect, place or parameter; a measurement of another robot; `out` exists.
    """
    path = expanded(out)
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise UserError("not a model file", key="--out", expected="a name that ends in .yaml", got=str(path))
    world = read_model(model)
    if overwrite and path.is_file():
        load_model(path)  # only a model file may be replaced
    robot = _robot_with_cameras(world)
    if Path(name).suffix.lower() in (".yaml", ".yml"):
        if where is not None or settings:
            raise UserError("a measurement has its own place and values", expected="no WHERE and no --set beside it")
        added = _measured(name, world, robot)
    else:
        added = [_stated(name, where, " ".join(several(settings)).split(), world, robot)]
    world = world.add(*added)
    write_model(path, world, overwrite)
    return AddedEffects(path, world, added)


def _stated(name: str, where: str | None, settings: Sequence[str], world: World, robot: RobotModel) -> EffectInstance:
    """Return the effect with the stated values."""
    kind = effect(name)
    if where is None:
        raise UserError(f"{kind.name} needs a place", expected="WHERE after it", choices=kind.targets(robot))
    at, given_values = place(kind, where, robot), values(kind, settings)
    present = [e for e in world.effects if e.effect == name and acts_on(e.where, [at])]
    if present:  # of two at one place the later one counts
        return replace(present[-1], where=at).with_values(**given_values)
    return EffectInstance.of(name, at, **completed(kind, given_values))


def _measured(file: str, world: World, robot: RobotModel) -> list[EffectInstance]:
    """Return the effects of a measurement file, with their intervals."""
    measurement = load_measurement(file)
    if measurement.robot is not None and not same(measurement.robot, world.robot):
        raise UserError("of another robot", file=file, key="robot", expected=world.robot, got=measurement.robot)
    if not measurement.effects:
        raise UserError("holds no effect", file=file, key="effects", expected="one or more")
    for instance in measurement.effects:
        if not effect(instance.effect).targets(robot):
            what = f"{instance.effect} acts on a scene, not on an arm alone"
            raise UserError(what, file=file, key="effects", expected=f"it in a world file: `model: {file}`")
        place(effect(instance.effect), instance.where, robot)
    return list(measurement.effects)


def _robot_with_cameras(world: World) -> RobotModel:
    """Return the arm or cell that effects are placed on; a cell with its cameras and those named in the model."""
    robot = robot_of_world(world)
    if not isinstance(robot, Scene):
        return robot
    extra = [e.where for e in world.effects if effect(e.effect).family == "camera" and e.where not in MANY]
    # only names are used, so the size, (64, 64), is arbitrary
    known = standard_cameras(robot.tip, robot.target) if robot.goal else cameras_of(robot.nominal, (64, 64))
    return replace(robot, cameras=tuple(dict.fromkeys([*(camera.name for camera in known), *extra])))


def _shown(value: Value) -> str:
    interval = "" if value.low is None else f" [{value.low:.4g}, {value.high:.4g}]"
    return f"{value.value:g}{interval}"
