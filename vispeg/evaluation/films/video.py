"""Frames to an H.264 video, which every browser plays."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError

FPS = 6.25  # as many as the policy's steps a second


def write_video(path: Path, frames: np.ndarray) -> Path:
    """Write (T, H, W, 3) uint8 RGB frames; return the path, with the suffix .mp4.

    Raises:
        UserError: frames of another shape, no ffmpeg, or one that fails.
    """
    if frames.ndim != 4 or frames.shape[-1] != 3 or frames.dtype != np.uint8 or not len(frames):
        raise UserError("not a video", expected="(T, H, W, 3) uint8", got=f"{frames.shape} {frames.dtype}")
    frames = frames[:, : frames.shape[1] // 2 * 2, : frames.shape[2] // 2 * 2]  # 4:2:0 wants even sides
    program, target = ffmpeg(), path.with_suffix(".mp4")
    if program is None:
        raise UserError("no ffmpeg here", expected="ffmpeg, see `vispeg doctor`", file=target)
    path.parent.mkdir(parents=True, exist_ok=True)
    size = f"{frames.shape[2]}x{frames.shape[1]}"
    raw_input = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", str(FPS), "-i", "-"]
    made = ["-c:v", "libx264", "-crf", "26", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    command = [program, "-y", "-loglevel", "error", *raw_input, *made, str(target)]
    done = subprocess.run(command, input=np.ascontiguousarray(frames).tobytes(), capture_output=True)
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise UserError("ffmpeg failed", file=target, got=said[-1] if said else f"exit code {done.returncode}")
    return target


def ffmpeg() -> str | None:
    """Give the ffmpeg that imageio-ffmpeg brings, or this machine's; None without either."""
    from imageio_ffmpeg import get_ffmpeg_exe

    try:
        return get_ffmpeg_exe()
    except RuntimeError:
        return None


def write_image(path: Path, image: np.ndarray) -> Path:
    """Write an RGB image (H, W, 3) uint8, as its suffix says: .png, or .jpg, which is smaller."""
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 90] if path.suffix == ".jpg" else []  # PNG warns of keys that it does not know
    ok, data = cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), quality)
    if not ok:
        raise UserError("not a picture", got=image.shape)
    path.write_bytes(data.tobytes())
    return path
