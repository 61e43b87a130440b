"""Exports a policy to ONNX, for controllers without torch.

Example:
    vispeg export runs/peg-depth/20261121-0900_s0/checkpoints/best --out policy.onnx
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, Told


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg export`."""

    policy: tyro.conf.Positional[Path]
    """A policy's folder, or the name of one that comes with the package."""
    out: Path
    """The ONNX file."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: Told = Output()

    def run(self) -> int:
        """Writes the file and names its inputs."""
        from vispeg.core.errors import UserError
        from vispeg.learn.onnx import export
        from vispeg.learn.policy import load

        if self.out.suffix.lower() != ".onnx":
            raise UserError("not an ONNX file", key="--out", expected="a name that ends in .onnx", got=str(self.out))
        policy = load(self.policy)
        export(policy, self.out, self.overwrite)
        shapes = ", ".join(f"{key} {list(shape)}" for key, shape in policy.actor.layout.shapes.items())
        inputs = {key: list(shape) for key, shape in policy.actor.layout.shapes.items()}
        record = {"onnx": str(self.out), "modality": policy.modality, "inputs": inputs}
        self.output.give(record, [f"{self.out}: {policy.modality}, inputs {shapes}"])
        return 0
