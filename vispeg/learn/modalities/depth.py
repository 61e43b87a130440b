"""Depth images, planar z in metres."""

from __future__ import annotations

import torch
from torch import Tensor

from vispeg.learn.modalities import Modality, enrol
from vispeg.learn.networks.nets import ConvEncoder

NEAR_M, FAR_M = 0.0, 0.4  # depth range of a wrist camera's subject; farther pixels are background


class DepthEncoder(ConvEncoder):
    """Encode depth in metres, in which 0 and NaN stand for no reading.

    Depth from NEAR_M to FAR_M is scaled to -1 to 1. A second channel is 1 where there is a reading, so that a gap is
    not taken for a surface.
    """

    def __init__(self, shape: tuple[int, int, int]):
        super().__init__((2 * shape[0], *shape[1:]))

    def forward(self, x: Tensor) -> Tensor:
        """Return features (n, features) of depth images (n, 1, H, W) in metres."""
        valid = (x > 0).to(x.dtype)  # False for NaN too
        z = torch.nan_to_num(x).clamp(NEAR_M, FAR_M)
        scaled = ((z - NEAR_M) * (2 / (FAR_M - NEAR_M)) - 1) * valid
        return super().forward(torch.cat([scaled, valid], dim=1))


def encoder(key: str, shape: tuple[int, int, int]) -> ConvEncoder:
    """Make the encoder of one depth camera."""
    return DepthEncoder(shape)


enrol(Modality("depth", "depth", ("depth",), encoder, "proprioception and depth from the wrist"))
