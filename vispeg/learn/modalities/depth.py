"""Depth images, planar z in metres."""

from __future__ import annotations

import torch
from torch import Tensor

from vispeg.learn.modalities import Modality, enrol
from vispeg.learn.networks.nets import ConvEncoder

NEAR_M, FAR_M = 0.0, 0.4  # what a wrist camera looks at; what lies beyond is background


class DepthEncoder(ConvEncoder):
    """Metres in, where 0 and NaN mean no reading; scaled to -1 to 1 over the range of interest, no rounding.

    A second channel says where there was a reading, so that a gap in the image is not a near surface.
    """

    def __init__(self, shape: tuple[int, int, int], features: int = 64):
        super().__init__((2 * shape[0], *shape[1:]), features)

    def forward(self, x: Tensor) -> Tensor:
        """(n, 1, H, W) in metres -> (n, features)."""
        valid = (x > 0).to(x.dtype)  # False for NaN too
        z = torch.nan_to_num(x).clamp(NEAR_M, FAR_M)
        scaled = ((z - NEAR_M) * (2 / (FAR_M - NEAR_M)) - 1) * valid
        return super().forward(torch.cat([scaled, valid], dim=1))


def encoder(key: str, shape: tuple[int, int, int]) -> ConvEncoder:
    """Make the encoder of one depth camera."""
    return DepthEncoder(shape)


enrol(Modality("depth", "depth", ("depth",), encoder, "proprioception and depth from the wrist"))
