"""Exports a policy to ONNX, for controllers without torch, or a model with its effects to MJCF or URDF.

An MJCF holds the effects that MuJoCo has elements for: friction, damping, rotor inertia, springs, inertials, gravity,
motor gain, bias and limit. A URDF holds masses, centres and inertias, damping and dry friction. The others are named,
and listed in the file's first lines with their values. Meshes are copied beside it.

Example:
    vispeg export runs/depth/20261121-0900_s0/checkpoints/best --out policy.onnx
    vispeg export found/model.yaml --to mjcf --out arm.xml
    vispeg export found/model.yaml --to urdf --out arm.urdf
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, Told

ENDS = {"onnx": ".onnx", "mjcf": ".xml", "urdf": ".urdf"}


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg export`."""

    source: tyro.conf.Positional[str]
    """A policy's folder or name; with --to mjcf or urdf a model file, a robot's name, or a path to an MJCF or URDF."""
    out: Path
    """The file to write: .onnx, .xml, or .urdf."""
    to: Literal["onnx", "mjcf", "urdf"] = "onnx"
    """The format."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: Told = Output()

    def run(self) -> int:
        """Writes the file and says what is in it."""
        from vispeg.core.errors import UserError

        if self.out.suffix.lower() != ENDS[self.to]:
            expected = f"a name that ends in {ENDS[self.to]} (--to {self.to})"
            raise UserError(f"not an {self.to.upper()} file", key="--out", expected=expected, got=str(self.out))
        return self._policy() if self.to == "onnx" else self._model()

    def _policy(self) -> int:
        from vispeg.learn.onnx import export
        from vispeg.learn.policy import load

        policy = load(self.source)
        export(policy, self.out, self.overwrite)
        shapes = ", ".join(f"{key} {list(shape)}" for key, shape in policy.actor.layout.shapes.items())
        inputs = {key: list(shape) for key, shape in policy.actor.layout.shapes.items()}
        record = {"onnx": str(self.out), "modality": policy.modality, "inputs": inputs}
        self.output.give(record, [f"{self.out}: {policy.modality}, inputs {shapes}"])
        return 0

    def _model(self) -> int:
        from vispeg.api.inputs import read_model
        from vispeg.api.urdf import to_urdf
        from vispeg.core.files import write_bytes_atomic, write_text_atomic
        from vispeg.core.marker import apart
        from vispeg.sim.export import to_mjcf

        world = read_model(self.source)
        apart(self.out, (self.source, world.robot))
        made = (to_mjcf if self.to == "mjcf" else to_urdf)(world, f"{self.out.stem}-meshes")
        write_text_atomic(self.out, made.xml, overwrite=self.overwrite)
        for name, file in made.meshes.items():
            write_bytes_atomic(self.out.parent / name, file.read_bytes(), overwrite=True)
        native, rest = ([e.label for e in effects] for effects in (made.native, made.left_out))
        lines = [f"{self.out}: {world.robot}, {len(made.meshes)} meshes beside it"]
        lines += [f"in it: {label}" for label in native]
        who = "MuJoCo" if self.to == "mjcf" else "URDF"
        lines += [f"not in it, {who} has no element for it: {label}" for label in rest]
        record = {self.to: str(self.out), "meshes": [*made.meshes], "native": native, "left_out": rest}
        if rotors := getattr(made, "rotors", {}):
            record["rotor_inertia"] = rotors
            lines.append(f"not in it, URDF has no element for it: rotor inertia of {', '.join(rotors)}")
        self.output.give(record, lines)
        return 0
