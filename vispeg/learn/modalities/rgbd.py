"""Colour and depth images of the same cameras, an encoder each."""

from __future__ import annotations

from vispeg.learn.modalities import Modality, enrol
from vispeg.learn.modalities.depth import DepthEncoder
from vispeg.learn.modalities.rgb import RgbEncoder
from vispeg.learn.nets import ConvEncoder


def encoder(key: str, shape: tuple[int, int, int]) -> ConvEncoder:
    """Encoder of one image, by its key's kind."""
    return DepthEncoder(shape) if key.startswith("depth") else RgbEncoder(shape)


enrol(Modality("rgbd", "rgbd", ("depth", "rgb"), encoder, "proprioception, colour and depth from the wrist"))
