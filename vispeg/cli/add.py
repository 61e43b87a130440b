"""Adds an effect to a model file, or sets the values of one that is there.

MODEL is left as it is unless --out names it and --overwrite is given. Parameters that are not set keep the model's
value, or take the effect's typical size where it is new.

Example:
    vispeg add iiwa14 coulomb_friction joint4 --set torque=1.2 --out model.yaml
    vispeg add model.yaml payload flange --set mass=0.6 z=0.07 --out model2.yaml
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg add`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF."""
    effect: tyro.conf.Positional[str]
    """Name of the effect; `vispeg effects` lists them."""
    where: tyro.conf.Positional[str]
    """Where it acts: a joint, a link, `flange`, `base`, or `all`."""
    out: Path
    """The model file to write."""
    set: tuple[str, ...] = ()
    """Values, such as torque=1.2 velocity=0.05."""
    overwrite: bool = False
    """Replace OUT if it is there."""

    def run(self) -> int:
        """Writes the model file and prints what is in it."""
        import os
        from dataclasses import replace

        from vispeg.cli.inputs import read_model
        from vispeg.core.effect import EffectInstance, effect
        from vispeg.core.errors import UserError
        from vispeg.core.files import write_text_atomic
        from vispeg.robots.model import load
        from vispeg.worlds.model_file import load_model, model_text
        from vispeg.worlds.words import place, values

        if self.out.suffix.lower() not in (".yaml", ".yml"):
            raise UserError("not a model file", key="--out", expected="a name that ends in .yaml", got=str(self.out))
        world = read_model(self.model)
        if self.overwrite and self.out.is_file():
            load_model(self.out)  # what is no model is not replaced
        kind, robot = effect(self.effect), load(world.robot, tool=world.tool)
        where, given = place(kind, self.where, robot), values(kind, self.set)
        typical = {name: param.start for name, param in kind.params.items()}
        here = [e for e in world.effects if (e.effect, e.where) == (self.effect, where)]
        placed = (here[0] if here else EffectInstance.of(self.effect, where, **typical)).with_values(**given)
        world = world.add(placed)
        if Path(world.robot).suffix:  # a model file names its robot relative to itself
            world = replace(world, robot=os.path.relpath(Path(world.robot).resolve(), self.out.resolve().parent))
        write_text_atomic(self.out, model_text(world), overwrite=self.overwrite)
        shown = ", ".join(f"{k} {v.value:g} {kind.params[k].unit}" for k, v in placed.params.items())
        print(f"{self.out}: {world.label}")
        print(f"{placed.label}: {shown}")
        return 0
