"""Lists the effects that a model can have; with a name, explains one and draws what it does to a motion.

The picture shows what the effect, at its typical size, changes in one joint under position control.

Example:
    vispeg effects
    vispeg effects stribeck_friction --where joint2 --out pictures
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg effects`."""

    name: tyro.conf.Positional[str | None] = None
    """The effect to explain; all are listed where not given."""
    where: str | None = None
    """Where the picture puts the effect (a joint, a link, flange, base, all)."""
    robot: str = "iiwa14"
    """A robot's name or a path to an MJCF or URDF: it says which places there are."""
    out: Path = Path(".")
    """Folder for effect-NAME.png."""
    overwrite: bool = False
    """Replace the picture if it is there."""
    json: bool = False
    """Print JSON and draw nothing."""

    def run(self) -> int:
        """Prints the table, or one effect's words, equation and parameters; draws its picture."""
        import vispeg.effects  # noqa: F401  (enrols the library)
        from vispeg.core.effect import ARM, REGISTRY, effect
        from vispeg.core.errors import UserError
        from vispeg.report.catalogue import describe, print_catalogue, print_effect
        from vispeg.robots.model import load
        from vispeg.robots.scene import build

        chosen = [effect(self.name)] if self.name else [REGISTRY[name] for name in sorted(REGISTRY)]
        arm, scene = load(self.robot), build()
        models = [arm if kind.kind in ARM else scene for kind in chosen]
        if self.json:
            print(json.dumps([describe(kind, m) for kind, m in zip(chosen, models, strict=True)], indent=1))
            return 0
        if self.name is None:
            print_catalogue(chosen, models)
            return 0
        if chosen[0].kind == "contact":  # felt, not seen
            print_effect(chosen[0], scene)
            return 0
        path = self.out / f"effect-{self.name}.png"
        if path.exists() and not self.overwrite:
            raise UserError("exists already; name another folder with --out or pass --overwrite", file=path)
        if chosen[0].kind in ("camera", "appearance"):
            from vispeg.report.look import draw

            print_effect(chosen[0], scene)
            draw(chosen[0], self.where, scene, path, overwrite=self.overwrite)
            print(f"picture: {path}")
            return 0
        from vispeg.identify.signature import signature
        from vispeg.report.signature import signature_panels

        s = signature(self.name, self.where, robot=self.robot)
        print_effect(chosen[0], arm)
        sizes = ", ".join(f"{k} {v.value:g} {chosen[0].params[k].unit}" for k, v in s.placed.params.items())
        panels = [
            ("rad", {f"angle of {s.joint}, with less without": s.deviation}),
            ("N m", {f"motor torque of {s.joint}, with less without": s.torque}),
        ]
        over = {f"angle of {s.joint} (rad)": s.angle, f"speed of {s.joint} (rad/s)": s.speed}
        title = f"{s.placed.label}\n{sizes}"
        signature_panels(title, s.time, panels, path, against=over, overwrite=self.overwrite)
        print(f"picture: {path}")
        return 0
