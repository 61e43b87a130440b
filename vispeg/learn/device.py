"""The device on which networks run and their batches lie."""

from __future__ import annotations

import torch

from vispeg.core.errors import UserError


def device_of(asked: str) -> str:
    """Return the device for `cpu`, `cuda` or `auto`; `auto` is `cuda` where there is one, else `cpu`.

    Raises:
        UserError: CUDA was asked for, and PyTorch finds no device.
    """
    there = torch.cuda.is_available()
    if asked.startswith("cuda") and not there:
        raise UserError("PyTorch finds no CUDA device here", key="device", expected="cpu or auto", got=asked)
    return ("cuda" if there else "cpu") if asked == "auto" else asked
