"""Colour images, 0 to 255."""

from __future__ import annotations

from torch import Tensor

from vispeg.learn.modalities import Modality, enrol
from vispeg.learn.networks.nets import ConvEncoder


class RgbEncoder(ConvEncoder):
    """uint8 colours in, scaled to -1 to 1."""

    def forward(self, x: Tensor) -> Tensor:
        """(n, 3, H, W) in 0-255 -> (n, features)."""
        return super().forward(x.float() * (2 / 255) - 1)


def encoder(key: str, shape: tuple[int, int, int]) -> ConvEncoder:
    """Make the encoder of one colour camera."""
    return RgbEncoder(shape)


enrol(Modality("rgb", "rgb", ("rgb",), encoder, "proprioception and colour from the wrist"))
