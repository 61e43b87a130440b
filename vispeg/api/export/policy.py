"""Export a policy as ONNX, for controllers without torch, as `vispeg export POLICY` does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vispeg.api.export.ending import check_ending
from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.core.paths import expanded
from vispeg.report.text.summary import Block, Line, Summarised


@dataclass(frozen=True)
class ExportedPolicy(Summarised):
    """A policy in an ONNX file.

    Attributes:
        file: the ONNX file.
        modality: what the policy sees.
        inputs: name of each observation that the network takes -> its shape without the batch's dimension. A recurrent
            network also takes its state, `hidden` and `cell`.
    """

    file: Path
    modality: str
    inputs: Mapping[str, tuple[int, ...]]

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg export --json`."""
        inputs = {name: list(shape) for name, shape in self.inputs.items()}
        return {"onnx": str(self.file), "modality": self.modality, "inputs": inputs}

    @property
    def summary(self) -> list[Block]:
        """The file, the modality and the inputs."""
        inputs = ", ".join(f"{name} {list(shape)}" for name, shape in self.inputs.items())
        return [Line(f"{self.file}: {self.modality}, inputs {inputs}", path=True)]


def export_policy(
    policy: str | Path, out: str | Path, *, world: str | Path | None = None, overwrite: bool = False
) -> ExportedPolicy:
    """Write a policy as an ONNX model that returns its action without exploration noise.

    Args:
        policy: a policy's folder, or a bundled policy's name.
        out: the file to write, .onnx.
        world: world of the arm and cameras that will run the policy, by which the file states what inputs and outputs
            mean; None for the policy's training world.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: no such policy or world, a policy of two networks or one that reads the ground truth, `out` does not
            end in .onnx, or `out` exists.
    """
    check_ending(expanded(out), "onnx")
    require("torch", "export")
    from vispeg.learn import onnx
    from vispeg.learn.interface import interface_of_policy
    from vispeg.learn.policy import load
    from vispeg.learn.record import policy_digest
    from vispeg.learn.shipped import policy_folder

    opened = load(policy)
    try:
        meaning = interface_of_policy(
            opened, None if world is None else str(world), policy_digest(policy_folder(policy))
        )
    except UserError as error:
        raise UserError(str(error), file=policy) from error
    file = onnx.export(opened, out, overwrite, meaning)
    return ExportedPolicy(file, opened.modality, dict(opened.actor.layout.shapes))
