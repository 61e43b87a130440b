"""Collect pictures for a recording; each is written to a file at once, so that a long log needs little memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.frames.png import write_colour, write_steps
from vispeg.recordings.recording import Recording

DEPTH_UNIT = 1e-3  # m per step of a 16-bit depth image
Row = tuple[float, str, int, str, Path]  # time in s, camera, episode, `rgb` or `depth`, file of the picture


class Album:
    """Collection of pictures, which are added one by one and become the frames of a recording.

    Args:
        folder: existing folder for the picture files, needed until the recording is written.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self.rows: list[Row] = []
        self.size: dict[str, tuple[int, int]] = {}
        self.unit: dict[str, float] = {}

    def add(self, camera: str, time: float, image: np.ndarray, episode: int = 0, unit: float = DEPTH_UNIT) -> None:
        """Add a picture of a camera.

        Args:
            camera: name of the camera.
            time: s, in the clock of the recording.
            image: (H, W, 3) uint8 colour, or (H, W) depth in m with 0 or NaN for no reading.
            episode: number of the episode.
            unit: m, step in which depth is stored.

        Raises:
            UserError: its size, or its unit of depth, differs from that of the camera's other pictures.
        """
        size = image.shape[1], image.shape[0]
        if self.size.setdefault(camera, size) != size:
            expected = f"{self.size[camera][0]} x {self.size[camera][1]} px, as before"
            raise UserError(
                f"pictures of '{camera}' change their size", expected=expected, got=f"{size[0]} x {size[1]}"
            )
        file = self.folder / f"{len(self.rows):06d}.png"
        if image.ndim == 3:
            write_colour(file, image)
        else:
            if self.unit.setdefault(camera, unit) != unit:
                raise UserError(
                    f"depth pictures of '{camera}' change their unit",
                    expected=f"{self.unit[camera]:g} m per step, as before",
                    got=f"{unit:g} m",
                )
            write_steps(file, image, unit)
        self.rows.append((time, camera, episode, "rgb" if image.ndim == 3 else "depth", file))

    def frames(self, rec: Recording, cameras: Mapping[str, RecordedCamera]) -> Frames | None:
        """Return the frames within the time span of a recording; None if no picture was added.

        Colour and depth of one time form one frame.

        Raises:
            UserError: a camera without intrinsics or with another stated image size; no picture within the time span.
        """
        described = {}
        for name, (width, height) in self.size.items():
            if name not in cameras:
                expected = "its intrinsics: a CameraInfo topic beside it, or --cameras FILE"
                raise UserError(f"nothing is known of camera '{name}'", expected=expected, choices=cameras)
            stated = cameras[name]
            if (stated.width, stated.height) != (width, height):
                got = f"{width} x {height}"
                expected = f"{stated.width} x {stated.height} px"
                raise UserError(f"pictures of '{name}' have another size than stated", expected=expected, got=got)
            described[name] = replace(stated, depth_unit=self.unit.get(name, stated.depth_unit))
        frames: dict[tuple[int, float, str], RecordedFrame] = {}
        for time, name, episode, kind, file in _together(self.rows):
            current = frames.get((episode, time, name), RecordedFrame(time, described[name], episode=episode))
            frames[episode, time, name] = replace(current, **{f"{kind}_source": file})
        inside = [frame for frame in _order(rec, frames.values()) if _covered(rec, frame)]
        if frames and not inside:
            span = f"{float(rec.time.min()):g} to {float(rec.time.max()):g} s"
            raise UserError("no picture lies within the times of the samples (another clock?)", expected=span)
        return Frames(described, tuple(inside)) if inside else None


def _together(rows: Sequence[Row]) -> list[Row]:
    """Give depth pictures the time of their nearest colour picture, at most half the median colour period away.

    Of several depth pictures with the same nearest colour picture, only the nearest one gets its time. A device stamps
    its two streams at slightly different times.
    """
    streams: dict[tuple[str, int], dict[str, list[Row]]] = {}
    for row in rows:
        streams.setdefault((row[1], row[2]), {"rgb": [], "depth": []})[row[3]].append(row)
    out: list[Row] = []
    for kinds in streams.values():
        colour, depth = kinds["rgb"], kinds["depth"]
        out += colour
        clock = np.sort([row[0] for row in colour])
        near = 0.5 * float(np.median(np.diff(clock))) if len(clock) > 1 else 0.0
        taken: dict[float, Row] = {}
        for row in depth:
            at = float(clock[np.abs(clock - row[0]).argmin()]) if len(clock) else row[0]
            other = taken.get(at)
            if abs(at - row[0]) > near or (other is not None and abs(other[0] - at) <= abs(row[0] - at)):
                out.append(row)
                continue
            if other is not None:
                out.append(other)
            taken[at] = row
        out += [(at, *row[1:]) for at, row in taken.items()]
    return out


def _order(rec: Recording, frames: Iterable[RecordedFrame]) -> list[RecordedFrame]:
    place = {} if rec.episode is None else {number: k for k, number in enumerate(dict.fromkeys(rec.episode.tolist()))}
    return sorted(frames, key=lambda f: (place.get(f.episode, 0), f.time))


def _covered(rec: Recording, frame: RecordedFrame) -> bool:
    clock = rec.time if rec.episode is None else rec.time[rec.episode == frame.episode]
    return len(clock) > 0 and float(clock[0]) <= frame.time <= float(clock[-1])
