"""Name the tensors of networks and of Adam, to store them without pickle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor

from vispeg.core.errors import UserError


def adam(optimizer: torch.optim.Optimizer, name: str) -> dict[str, Tensor]:
    """Return Adam's state as {`adam.NAME.PARAMETER.KEY`: tensor}, not copied; only parameters that had a gradient."""
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    return {
        f"adam.{name}.{number}.{key}": value
        for number, parameter in enumerate(parameters)
        for key, value in optimizer.state.get(parameter, {}).items()
    }


def wake(optimizer: torch.optim.Optimizer) -> None:
    """Create Adam's moments as zeros, without changing a weight, so that `fill` can set them."""
    for group in optimizer.param_groups:
        for parameter in group["params"]:
            optimizer.state[parameter] = {
                "step": torch.zeros((), dtype=torch.float32, device=parameter.device if group["fused"] else "cpu"),
                "exp_avg": torch.zeros_like(parameter),
                "exp_avg_sq": torch.zeros_like(parameter),
            }


def write(path: Path, tensors: Mapping[str, Tensor]) -> None:
    """Write tensors on any device to a safetensors file."""
    save_file({name: value.detach().cpu().contiguous() for name, value in tensors.items()}, path)


def fill(wanted: Mapping[str, Tensor], stored: Mapping[str, Tensor], file: Path) -> None:
    """Copy the stored values into the tensors of the same names; moments that were not stored stay as they are.

    Args:
        wanted: tensors to fill, by name.
        stored: values, by name.
        file: file of the values, for the error.

    Raises:
        UserError: a tensor is missing, has another shape, or is not wanted; then nothing was copied.
    """
    expected = {name: value for name, value in wanted.items() if name in stored or not name.startswith("adam.")}
    if {k: v.shape for k, v in expected.items()} != {k: v.shape for k, v in stored.items()}:
        raise UserError("holds networks with other shapes or settings", file=file)
    with torch.no_grad():
        for name, value in expected.items():
            value.copy_(stored[name])
