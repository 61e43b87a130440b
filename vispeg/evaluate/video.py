"""Frames to a video that browsers play: H.264 where there is an ffmpeg, else VP8 by OpenCV."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError


def write_video(path: Path, frames: np.ndarray, fps: float = 6.25) -> Path:
    """Writes (T, H, W, 3) uint8 RGB frames; returns the path, its suffix .mp4 or .webm by what this machine can.

    Raises:
        UserError: frames of another shape, or no encoder.
    """
    if frames.ndim != 4 or frames.shape[-1] != 3 or frames.dtype != np.uint8 or not len(frames):
        raise UserError("not a video", expected="(T, H, W, 3) uint8", got=f"{frames.shape} {frames.dtype}")
    frames = frames[:, : frames.shape[1] // 2 * 2, : frames.shape[2] // 2 * 2]  # 4:2:0 wants even sides
    path.parent.mkdir(parents=True, exist_ok=True)
    program = ffmpeg()
    if program is not None:
        target = path.with_suffix(".mp4")
        size = f"{frames.shape[2]}x{frames.shape[1]}"
        given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", str(fps), "-i", "-"]
        made = ["-c:v", "libx264", "-crf", "26", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
        command = [program, "-y", "-loglevel", "error", *given, *made, str(target)]
        if subprocess.run(command, input=np.ascontiguousarray(frames).tobytes(), capture_output=True).returncode == 0:
            return target
    return _by_opencv(path.with_suffix(".webm"), frames, fps)


def ffmpeg() -> str | None:
    """The ffmpeg of this machine, or the one that imageio-ffmpeg brings; None without either."""
    found = shutil.which("ffmpeg")
    if found is None:
        try:
            from imageio_ffmpeg import get_ffmpeg_exe

            found = get_ffmpeg_exe()
        except (ImportError, RuntimeError):
            return None
    return found


def _by_opencv(path: Path, frames: np.ndarray, fps: float) -> Path:
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"VP80"), fps, frames.shape[2:0:-1])
    if not writer.isOpened():
        raise UserError("no video encoder here", expected="ffmpeg, or OpenCV with VP8", file=path)
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    writer.release()
    return path


def write_image(path: Path, image: np.ndarray) -> Path:
    """Writes an RGB image (H, W, 3) uint8, as its suffix says: .png, or .jpg, which is smaller."""
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    ok, data = cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 90])
    if not ok:
        raise UserError("not a picture", got=image.shape)
    path.write_bytes(data.tobytes())
    return path
