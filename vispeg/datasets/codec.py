"""Encode and decode pictures without loss: PNG for colour and labels, floating-point TIFF for depth."""

from __future__ import annotations

import numpy as np

from vispeg.core.errors import UserError

TYPES = ("uint8", "uint16", "float32")  # pixel types that are written without loss
DEPTH_STEP = 1e-4  # m, step of 16-bit depth pictures (0.1 mm; they reach 6.5535 m)


def encode(image: np.ndarray) -> bytes:
    """Encode a picture as PNG or, if it is float32, as TIFF.

    Args:
        image: (H, W, 3) uint8 RGB, (H, W) uint8 labels, (H, W) uint16 depth in steps, or (H, W) float32 depth in m.

    Raises:
        ValueError: another type, which OpenCV would convert to 8 bits, or not the shape of a picture.
    """
    import cv2

    if image.dtype not in TYPES:
        raise ValueError(f"a picture of {image.dtype}; it must be {', '.join(TYPES)}")
    if image.dtype == np.float32:  # deflate with the floating-point predictor: 40 % less than the raw numbers
        options = [cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_ADOBE_DEFLATE]
        options += [cv2.IMWRITE_TIFF_PREDICTOR, cv2.IMWRITE_TIFF_PREDICTOR_FLOATINGPOINT]
        ok, data = cv2.imencode(".tiff", image, options)
    else:
        ok, data = cv2.imencode(".png", image[..., ::-1] if image.ndim == 3 else image)
    if not ok:
        raise ValueError(f"not a picture: {image.shape} {image.dtype}")
    return data.tobytes()


def decode(data: bytes, where: str = "") -> np.ndarray:
    """Decode a picture; the result is bit for bit what `encode` was given.

    Raises:
        UserError: the bytes are not a picture; the error names `where`.
    """
    import cv2

    image = None
    if data:
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:  # a header with more pixels than OpenCV allows
            image = None
    if image is None:
        raise UserError("is not a picture, or is cut short", key=where or None, got=f"{len(data)} bytes")
    return np.ascontiguousarray(image[..., ::-1]) if image.ndim == 3 else image


def to_steps(depth: np.ndarray) -> np.ndarray:
    """Convert depth in m to uint16 steps of 0.1 mm; missing readings and those beyond 6.5535 m become 0."""
    steps = np.round(np.nan_to_num(depth) / DEPTH_STEP)
    return np.where((steps > 0) & (steps <= 65535), steps, 0).astype(np.uint16)
