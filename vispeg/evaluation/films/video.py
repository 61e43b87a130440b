"""Write frames as an H.264 video, which every browser plays, and single images."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError


def write_video(path: Path, frames: np.ndarray, fps: float) -> Path:
    """Write (T, H, W, 3) uint8 RGB frames, `fps` of them a second; return the path, with .mp4 appended.

    Raises:
        UserError: frames of another shape, no ffmpeg, or one that fails.
    """
    if frames.ndim != 4 or frames.shape[-1] != 3 or frames.dtype != np.uint8 or not len(frames):
        raise UserError("not a video", expected="(T, H, W, 3) uint8", got=f"{frames.shape} {frames.dtype}")
    frames = frames[:, : frames.shape[1] // 2 * 2, : frames.shape[2] // 2 * 2]  # yuv420p needs even sides
    program, target = ffmpeg(), path.with_name(f"{path.name}.mp4")
    if program is None:
        raise UserError("no ffmpeg here", expected="ffmpeg, see `vispeg doctor`", file=target)
    path.parent.mkdir(parents=True, exist_ok=True)
    size = f"{frames.shape[2]}x{frames.shape[1]}"
    raw_input = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", f"{fps:.6g}", "-i", "-"]
    made = ["-c:v", "libx264", "-crf", "26", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    command = [program, "-y", "-loglevel", "error", *raw_input, *made, str(target)]
    done = subprocess.run(command, input=np.ascontiguousarray(frames).tobytes(), capture_output=True)
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise UserError("ffmpeg failed", file=target, got=said[-1] if said else f"exit code {done.returncode}")
    return target


def ffmpeg() -> str | None:
    """Return the path of the ffmpeg that imageio-ffmpeg brings, or of this machine's; None without either."""
    from imageio_ffmpeg import get_ffmpeg_exe

    try:
        return get_ffmpeg_exe()
    except RuntimeError:
        return None


def write_image(path: Path, image: np.ndarray) -> Path:
    """Write an RGB image (H, W, 3) uint8 in the format of the path's suffix, .png or .jpg; return the path."""
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 90] if path.suffix == ".jpg" else []  # the PNG writer warns of a quality
    ok, data = cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), quality)
    if not ok:
        raise UserError("not a picture", got=image.shape)
    path.write_bytes(data.tobytes())
    return path
