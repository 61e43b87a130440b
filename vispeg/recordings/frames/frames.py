"""Pictures of a recording: when and by which camera each was taken, and its pixels, which are loaded on demand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vispeg.recordings.frames.camera import RecordedCamera, Sensor
from vispeg.recordings.frames.png import read_colour, read_steps

Source = Path | np.ndarray | None


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """One row of `index.csv`: a moment of one camera.

    Attributes:
        time: s, on the clock of the samples (of the episode where there are several).
        camera: as calibrated.
        rgb_source: PNG file, or (H, W, 3) uint8 sRGB, or None.
        depth_source: 16-bit PNG file, or (H, W) float32 m, or None.
        episode: the samples' episode that it belongs to.
    """

    time: float
    camera: RecordedCamera
    rgb_source: Source = None
    depth_source: Source = None
    episode: int = 0

    @property
    def rgb(self) -> np.ndarray | None:
        """(H, W, 3) uint8, sRGB, read anew at each call; None where there is none. Raises UserError: a damaged file."""
        source = self.rgb_source
        return read_colour(source) if isinstance(source, Path) else source

    @property
    def depth(self) -> np.ndarray | None:
        """(H, W) float32, planar distance in m, 0 = no reading; None where there is none. Raises as `rgb`."""
        source = self.depth_source
        if not isinstance(source, Path):
            return source
        return (read_steps(source) * self.camera.depth_unit).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a recording, by episode and time.

    Attributes:
        cameras: as calibrated, by name.
        frames: in order of episode (as the samples have them) and time.
    """

    cameras: Mapping[str, RecordedCamera]
    frames: tuple[RecordedFrame, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[RecordedFrame]:
        return iter(self.frames)

    def __getitem__(self, row: int) -> RecordedFrame:
        return self.frames[row]

    def some(self, rows: np.ndarray) -> Frames:
        """Select frames by indices or by a mask (n,) bool."""
        return Frames(self.cameras, tuple(self.frames[i] for i in np.arange(len(self))[rows]))

    def of(self, camera: str) -> Frames:
        """Select the frames of one camera."""
        return self.some(np.array([frame.camera.name == camera for frame in self], bool))

    def of_kinds(self, kinds: Mapping[str, Sensor]) -> Frames:
        """Return a copy in which the kind of depth camera is set for some cameras, by name."""
        cameras = {n: replace(c, sensor=kinds[n]) if n in kinds else c for n, c in self.cameras.items()}
        frames = tuple(replace(frame, camera=cameras[frame.camera.name]) for frame in self)
        return replace(self, cameras=cameras, frames=frames)

    @property
    def deep(self) -> list[str]:
        """List the cameras that have depth, in the order of `cameras`."""
        there = {frame.camera.name for frame in self if frame.depth_source is not None}
        return [name for name in self.cameras if name in there]

    @property
    def times(self) -> np.ndarray:
        """(n,) s."""
        return np.array([frame.time for frame in self], float)

    @property
    def episodes(self) -> np.ndarray:
        """(n,) int."""
        return np.array([frame.episode for frame in self], np.int64)

    @property
    def names(self) -> list[str]:
        """List the cameras that have a frame, in the order of `cameras`."""
        there = {frame.camera.name for frame in self}
        return [name for name in self.cameras if name in there]
