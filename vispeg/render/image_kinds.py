"""Kinds of images in observations: a table of their type, range, storage and display.

The key of an image in an observation is KIND_CAMERA, such as `depth_wrist_wide`. A new kind needs a renderer that
supplies it and one entry here. A mode of observation is a list of kinds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.frame import Frame

FAR = 4.0  # m, greatest depth in the observation
SHOWN = (0.02, 0.40)  # m, range of depths in a picture for people
LEVEL = 0.002  # m per grey level of depth; chosen for wrist cameras, which see the goal from 0.05 to 0.4 m
STEP = 5e-5  # m, unit of stored depth; 16 bits reach 3.27 m


@dataclass(frozen=True)
class ImageKind:
    """One kind of image, (C, H, W) in an observation.

    Attributes:
        name: name of the kind.
        channels, dtype, high: number of channels, type and greatest value of the image; the least value is 0.
        unit: unit of the values.
        deliver: function from a Frame to images (n, C, H, W), or to None if the frame has no image of this kind.
        stored: type in which replays store the image.
        pack, unpack: functions to the stored type and back.
        picture: function from an image (C, H, W) to a picture (H, W, 3) uint8 for people.
        gaps: whether NaN means that there is no reading; otherwise NaN is an error.
    """

    name: str
    channels: int
    dtype: type
    high: float
    unit: str
    deliver: Callable[[Frame], np.ndarray | None]
    stored: type
    pack: Callable[[np.ndarray], np.ndarray]
    unpack: Callable[[np.ndarray], np.ndarray]
    picture: Callable[[np.ndarray], np.ndarray]
    gaps: bool = False

    def shape(self, height: int, width: int) -> tuple[int, int, int]:
        """Return the shape (C, H, W) of an image."""
        return self.channels, height, width


def depth_picture(depth: np.ndarray, near: float = SHOWN[0], far: float = SHOWN[1]) -> np.ndarray:
    """Return a picture (H, W, 3) uint8 of depth (H, W) in m: near is red, far is blue, no reading is black."""
    import cv2

    reading = np.isfinite(depth) & (depth > 0)
    share = np.clip((far - np.where(reading, depth, far)) / (far - near), 0, 1)
    colour = cv2.applyColorMap(np.round(255 * share).astype(np.uint8), cv2.COLORMAP_TURBO)[..., ::-1]
    return np.where(reading[..., None], colour, 0).astype(np.uint8)


def grey_depth(depth: np.ndarray) -> np.ndarray:
    """Return depth in m as grey levels, uint8 of the same shape: 2 mm per level, at most 255; 0 for no reading."""
    reading = np.isfinite(depth) & (depth > 0)
    levels = np.clip(np.rint(np.where(reading, depth, 0.0) / LEVEL), 1, 255)
    return np.where(reading, levels, 0).astype(np.uint8)


def _metres(frame: Frame) -> np.ndarray | None:
    return None if frame.depth is None else np.clip(np.nan_to_num(frame.depth), 0, FAR)[:, None]


def _colours(frame: Frame) -> np.ndarray | None:
    if frame.rgb is None:
        return None
    return np.moveaxis(np.round(255 * np.clip(frame.rgb, 0, 1)).astype(np.uint8), -1, 1)


def _steps(depth: np.ndarray) -> np.ndarray:
    steps = np.rint(np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0) / STEP)
    return np.clip(steps, 0, 65535).astype(np.uint16)


DEPTH = ImageKind(
    name="depth",
    channels=1,
    dtype=np.float32,
    high=FAR,
    unit="m, 0 = no reading",
    deliver=_metres,
    stored=np.uint16,
    pack=_steps,
    unpack=lambda steps: steps.astype(np.float32) * np.float32(STEP),
    picture=lambda image: depth_picture(image[0]),
    gaps=True,
)
RGB = ImageKind(
    name="rgb",
    channels=3,
    dtype=np.uint8,
    high=255,
    unit="sRGB",
    deliver=_colours,
    stored=np.uint8,
    pack=lambda image: image,
    unpack=lambda image: image,
    picture=lambda image: np.moveaxis(image, 0, -1),
)
KINDS = {kind.name: kind for kind in (DEPTH, RGB)}
MODES: dict[str, tuple[ImageKind, ...]] = {  # modes of observation: the kinds of images in each
    "state": (),
    "proprio": (),
    "depth": (DEPTH,),
    "rgb": (RGB,),
    "rgbd": (RGB, DEPTH),
}
GOAL_TOLD = ("state",)  # modes whose policy is given the estimated goal position; others get the nominal one


def enrol(kind: ImageKind, mode: str) -> ImageKind:
    """Add a kind, and a mode of observation with this kind alone; return the kind.

    Raises:
        UserError: a kind or mode of that name exists, or the kind's name contains an underscore.
    """
    for name, names in ((kind.name, KINDS), (mode, MODES)):
        if name in names:
            raise UserError("two kinds of images share a name", got=name, choices=names)
    if "_" in kind.name:
        raise UserError("not a name of a kind: KIND_CAMERA is split at the first _", got=kind.name)
    KINDS[kind.name], MODES[mode] = kind, (kind,)
    return kind


def kind_of(key: str) -> ImageKind | None:
    """Return the kind of the image with this key in an observation; None if the key is not one of an image."""
    kind, _, camera = key.partition("_")
    return KINDS.get(kind) if camera else None


def camera_of(key: str) -> str:
    """Return the camera's name in the key of an image."""
    return key.partition("_")[2]


def key_of(kind: ImageKind, camera: str) -> str:
    """Return the key KIND_CAMERA of an image in an observation."""
    return f"{kind.name}_{camera}"


def picture_of(key: str, image: np.ndarray) -> np.ndarray:
    """Return an observed image (C, H, W) as a picture (H, W, 3) uint8 for people; ValueError if it is not an image."""
    kind = kind_of(key)
    if kind is None:
        raise ValueError(f"{key} is not an image")
    return kind.picture(image)
