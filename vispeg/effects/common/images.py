"""The images that appearance effects use: the user's own if there are any, otherwise those that vispeg brings.

`VISPEG_TEXTURES` names a folder of the user's images. Without it, images of the wanted kind in `textures/user/` of a
checkout are used, or else those that `scripts/make_textures.py` made. Files are sorted by their paths below the folder,
so a sampled world keeps its images as long as the folder does not change. If a folder has images both below a subfolder
`training/` and elsewhere, the former are for worlds that policies are trained in, the others for other worlds.
"""

from __future__ import annotations

import hashlib
import json
import os
from functools import lru_cache
from pathlib import Path

import numpy as np

from vispeg.core.assets import PACKAGE
from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.core.provenance import digest as file_digest
from vispeg.formats.guard import refuse_special

FOLDER, TRAINING = "VISPEG_TEXTURES", "training"
PICTURES, ENVIRONMENTS = (".png", ".jpg", ".jpeg"), (".hdr",)
PIXELS = 40_000_000  # no larger image is read
RADIANCE = (b"#?RADIANCE", b"#?RGBE")

Stamp = tuple[int, int]  # of a file, as `_stamp`; an argument of cached functions, so that a changed file is read again


def images(endings: tuple[str, ...], training: bool = False) -> tuple[Path, ...]:
    """Return the images with one of these file name endings, sorted.

    Args:
        endings: lower case, with their dots.
        training: True for images below `training/`, False for the others; if there are none such, all are returned.

    Raises:
        UserError: `VISPEG_TEXTURES` names no folder, or one without such an image; or vispeg's own images are missing.
    """
    named = os.environ.get(FOLDER)
    if named:
        folder = expanded(named)
        if not folder.is_dir():
            raise UserError(f"{FOLDER} does not name a folder", file=named)
        paths = _below(folder, endings, training)
        if not paths:
            raise UserError(f"no image in the folder that {FOLDER} names", file=named, expected=" ".join(endings))
        return paths
    for root in (PACKAGE / "_textures", PACKAGE.parent / "textures"):
        user = _below(root / "user", endings, training) if root.is_dir() else ()
        paths = user or (_below(root, endings, training) if root.is_dir() else ())
        if paths:
            return paths
    raise UserError("the textures folder is missing; install vispeg again", file=PACKAGE)


def digest(endings: tuple[str, ...]) -> str:
    """Return a digest (hex) of the images with these endings, in training and elsewhere: names and bytes, in order.

    A process reads each of them once, and again if it has changed since.

    Raises:
        UserError: as `images` does, or an image cannot be read.
    """
    lists = [
        [(path.name, _content(path, _stamp(path))) for path in images(endings, training)] for training in (False, True)
    ]
    return hashlib.sha256(json.dumps(lists).encode()).hexdigest()


def picked(endings: tuple[str, ...], share: float, training: bool = False) -> Path:
    """Return the image at place `share` of the sorted list, from 0 (first) to 1 (last)."""
    paths = images(endings, training)
    return paths[min(int(share * len(paths)), len(paths) - 1)]


def picture(path: Path, size: int) -> np.ndarray:
    """Return the middle square of a PNG or JPEG, resized to (size, size, 3) float32 in [0, 1], sRGB.

    Raises:
        UserError: it cannot be read, or is larger than `PIXELS`.
    """
    return _picture(path, _stamp(path), size)


def environment(path: Path, rows: int = 128) -> np.ndarray:
    """Return the linear light of a Radiance .hdr, (rows, 2 rows, 3) float32 RGB; its top row is the zenith.

    Raises:
        UserError: it is not a Radiance file, is damaged, or is larger than `PIXELS`.
    """
    return _environment(path, _stamp(path), rows)


@lru_cache(maxsize=64)
def _picture(path: Path, stamp: Stamp, size: int) -> np.ndarray:
    import cv2

    head = _head(path)
    if not head.startswith((b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")):
        raise UserError("is not an image", file=path, expected="a PNG or JPEG")
    refuse_huge(path, _area(path, head))
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise UserError("cannot be read as an image", file=path, expected="a PNG or JPEG")
    h, w = image.shape[:2]
    edge = min(h, w)
    top, left = (h - edge) // 2, (w - edge) // 2
    square = image[top : top + edge, left : left + edge, ::-1]
    method = cv2.INTER_AREA if edge > size else cv2.INTER_LINEAR
    return cv2.resize(np.ascontiguousarray(square), (size, size), interpolation=method).astype(np.float32) / 255


@lru_cache(maxsize=32)
def _environment(path: Path, stamp: Stamp, rows: int) -> np.ndarray:
    import cv2

    head = _head(path)
    if not head.startswith(RADIANCE):
        raise UserError("is not a Radiance HDR image", file=path, expected="a file that begins with #?RADIANCE")
    refuse_huge(path, _radiance_area(path, head))
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.float32 or image.ndim != 3 or not np.isfinite(image).all():
        raise UserError("cannot be read as a Radiance HDR image", file=path)
    return np.maximum(cv2.resize(image[..., 2::-1], (2 * rows, rows), interpolation=cv2.INTER_AREA), 0)


def refuse_huge(path: Path, area: int) -> None:
    """Raise a UserError if an image's number of pixels, `area`, is larger than `PIXELS`."""
    if area > PIXELS:
        raise UserError("is too large for a texture", file=path, expected=f"at most {PIXELS:,} pixels", got=area)


@lru_cache(maxsize=65_536)
def _content(path: Path, stamp: Stamp) -> str:
    return file_digest(path)


def _stamp(path: Path) -> Stamp:
    """Return when a file was last modified, ns, and its size: while they stay, what was read of it is kept."""
    try:
        stat = path.stat()
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror}", file=path) from error
    return stat.st_mtime_ns, stat.st_size


def _below(folder: Path, endings: tuple[str, ...], training: bool) -> tuple[Path, ...]:
    """Return the images in a folder and its subfolders; arguments as in `images`."""
    every = (p for p in folder.rglob("*") if p.suffix.lower() in endings and p.is_file())
    paths = sorted(every, key=lambda p: p.relative_to(folder).as_posix())
    chosen = [p for p in paths if (TRAINING in p.relative_to(folder).parts[:-1]) == training]
    return tuple(chosen or paths)


def _head(path: Path) -> bytes:
    """Return the first 64 KiB of a file."""
    refuse_special(path)
    try:
        with path.open("rb") as file:
            return file.read(65536)
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror}", file=path) from error


def _area(path: Path, head: bytes) -> int:
    """Read the number of pixels of a PNG (IHDR) or JPEG (frame header: ITU-T T.81, B.2.2) without decoding it."""
    if head.startswith(b"\x89PNG"):
        return int.from_bytes(head[16:20], "big") * int.from_bytes(head[20:24], "big")
    data, at = path.read_bytes(), 2
    while at + 9 < len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            return int.from_bytes(data[at + 5 : at + 7], "big") * int.from_bytes(data[at + 7 : at + 9], "big")
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    raise UserError("cannot be read as an image", file=path, expected="a PNG or JPEG")


def _radiance_area(path: Path, head: bytes) -> int:
    """Read the number of pixels from the resolution line, such as `-Y 512 +X 1024`, after the blank line."""
    try:
        line = head.split(b"\n\n", 1)[1].split(b"\n", 1)[0].split()
        return int(line[1]) * int(line[3])
    except (IndexError, ValueError) as error:
        raise UserError("is a Radiance file without a resolution", file=path) from error
