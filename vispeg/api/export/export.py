"""Export a policy to ONNX, or a model to MJCF or URDF, as `vispeg export` does."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from vispeg.api.export.model import ExportedModel
    from vispeg.api.export.policy import ExportedPolicy


def export(
    source: str,
    out: str | Path,
    *,
    to: Literal["onnx", "mjcf", "urdf"] = "onnx",
    world: str | Path | None = None,
    overwrite: bool = False,
) -> ExportedPolicy | ExportedModel:
    """Write a policy or a model in a format of other programs.

    Args:
        source: a policy's folder or name; for MJCF and URDF a model file, a robot's name, or a path to an MJCF or URDF.
        out: the file to write: .onnx, .xml, or .urdf.
        to: the format.
        world: for ONNX: the world with the arm on which the policy will be played; default: the training world.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: as for `export_policy` and `export_model`.
    """
    if to == "onnx":
        from vispeg.api.export.policy import export_policy

        return export_policy(source, out, world=world, overwrite=overwrite)
    from vispeg.api.export.model import export_model

    return export_model(source, out, to, overwrite=overwrite)
