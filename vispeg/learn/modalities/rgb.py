"""Colour images, 0 to 255."""

from __future__ import annotations

from torch import Tensor

from vispeg.learn.modalities import Modality, enrol
from vispeg.learn.networks.nets import ConvEncoder


class RgbEncoder(ConvEncoder):
    """Encode uint8 colour images, scaled to -1 to 1."""

    def forward(self, x: Tensor) -> Tensor:
        """Return features (n, features) of colour images (n, 3, H, W), 0 to 255."""
        return super().forward(x.float() * (2 / 255) - 1)


def encoder(key: str, shape: tuple[int, int, int]) -> ConvEncoder:
    """Make the encoder of one colour camera."""
    return RgbEncoder(shape)


enrol(Modality("rgb", "rgb", ("rgb",), encoder, "proprioception and colour from the wrist"))
