"""Read and write PNG files; the header, and whether the file is complete, can be checked without decoding."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import opened, read_bytes

SIGNATURE, END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
LARGEST = 200_000_000  # bytes; 8192 x 8192 px of three colours
COLOURS = {0: 1, 2: 3, 3: 3, 4: 1, 6: 3}  # PNG's colour type -> number of channels without transparency


@dataclass(frozen=True)
class Head:
    """Header of a PNG: size, px, bits per sample, colour channels (1 or 3)."""

    width: int
    height: int
    bits: int
    colours: int


def head(file: Path) -> Head:
    """Read the header of a PNG. Raises UserError: no such file, not a PNG, or truncated."""
    with opened(file) as stream:
        begin = stream.read(33)
        stream.seek(0, 2)
        stream.seek(max(0, stream.tell() - len(END)))
        end = stream.read()
    if len(begin) < 33 or begin[:8] != SIGNATURE or begin[12:16] != b"IHDR":
        raise UserError("is not a PNG", file=file)
    if end != END:
        raise UserError("is cut short", file=file, expected="a whole PNG")
    width, height, bits, kind = struct.unpack(">IIBB", begin[16:26])
    return Head(width, height, bits, COLOURS.get(kind, 0))


def read_colour(file: Path) -> np.ndarray:
    """Read an 8-bit PNG as RGB (H, W, 3) uint8. Raises UserError: a damaged file."""
    return np.ascontiguousarray(_pixels(file, colour=True)[..., ::-1])


def read_steps(file: Path) -> np.ndarray:
    """Read a 16-bit PNG (H, W) uint16. Raises UserError: a damaged file."""
    return _pixels(file, colour=False)


def write_colour(file: Path, rgb: np.ndarray) -> None:
    """Write (H, W, 3) uint8 RGB."""
    _write(file, np.ascontiguousarray(rgb[..., ::-1]))


def write_steps(file: Path, depth: np.ndarray, unit: float) -> None:
    """Write depth (H, W) in m as 16-bit steps of `unit` m; NaN and values beyond 16 bits become 0, no reading."""
    steps = np.rint(np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0) / unit)
    _write(file, np.where((steps > 0) & (steps <= 65535), steps, 0).astype(np.uint16))


def _pixels(file: Path, colour: bool) -> np.ndarray:
    import cv2

    about, flags = head(file), cv2.IMREAD_COLOR if colour else cv2.IMREAD_UNCHANGED
    try:
        image = cv2.imdecode(np.frombuffer(read_bytes(file, LARGEST), np.uint8), flags)
    except cv2.error:
        image = None
    if image is None or image.shape[:2] != (about.height, about.width):
        raise UserError("is a damaged PNG", file=file)
    return image


def _write(file: Path, image: np.ndarray) -> None:
    import cv2

    done, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not done:
        raise ValueError(f"not a picture: {image.shape} {image.dtype}")
    file.write_bytes(data.tobytes())
