"""Colour and depth images of the same cameras, with one encoder for each."""

from __future__ import annotations

from vispeg.learn.modalities import Modality, enrol
from vispeg.learn.modalities.depth import DepthEncoder
from vispeg.learn.modalities.rgb import RgbEncoder
from vispeg.learn.networks.nets import ConvEncoder
from vispeg.render.image_kinds import DEPTH, kind_of


def encoder(key: str, shape: tuple[int, int, int]) -> ConvEncoder:
    """Make the encoder of one image, depth or colour by its key."""
    return DepthEncoder(shape) if kind_of(key) is DEPTH else RgbEncoder(shape)


enrol(Modality("rgbd", "rgbd", ("depth", "rgb"), encoder, "proprioception, colour and depth from the wrist"))
