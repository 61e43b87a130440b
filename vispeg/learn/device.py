"""Where networks run, and with them the batches that they are given."""

from __future__ import annotations

import torch

from vispeg.core.errors import UserError


def device_of(asked: str) -> str:
    """`cpu` or `cuda` for `cpu`, `cuda` or `auto`. Raises UserError where there is no CUDA to be had."""
    there = torch.cuda.is_available()
    if asked.startswith("cuda") and not there:
        raise UserError("PyTorch finds no CUDA device here", key="device", expected="cpu or auto", got=asked)
    return ("cuda" if there else "cpu") if asked == "auto" else asked
