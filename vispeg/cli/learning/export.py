"""Exports a policy to ONNX, or a model to MJCF or URDF.

ONNX is for controllers without torch; its metadata say what goes in, what comes out, and of which arm. An MJCF holds
the effects that MuJoCo has elements for: friction, damping, rotor inertia, springs, inertials, gravity, motor gain,
bias and limit. A URDF holds masses, centres, inertias, damping and dry friction. Other effects are named, and listed
with their values in the file's first lines. Meshes are copied.

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

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg export`."""

    source: tyro.conf.Positional[str]
    """A policy's folder or name; with --to mjcf or urdf a model file, a robot's name, or a path to an MJCF or URDF."""
    out: Path
    """The file to write: .onnx, .xml, or .urdf."""
    to: Literal["onnx", "mjcf", "urdf"] = "onnx"
    """The format."""
    world: str | None = None
    """With --to onnx: the world on whose arm the policy is to be played; default: the training world."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Write the file and say what is in it."""
        if self.to == "onnx":
            from vispeg.api.export.policy import export_policy

            result = export_policy(self.source, self.out, world=self.world, overwrite=self.overwrite)
        else:
            from vispeg.api.export.model import export_model

            result = export_model(self.source, self.out, self.to, overwrite=self.overwrite)
        self.output.give(result.record, result.summary)
        return 0
