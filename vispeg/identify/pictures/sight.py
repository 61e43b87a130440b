"""Frames of one camera in one recording, ready to be compared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.recordings.recording import Recording
from vispeg.render.calibration.board import Board
from vispeg.render.calibration.detect import View
from vispeg.render.cameras.camera import Camera


@dataclass(frozen=True, eq=False)
class Sight:
    """Frames of one camera.

    Attributes:
        name: of the recording.
        camera: as it was calibrated.
        time: (m,) s, when each frame was stamped.
        joints: measured angles (k, nj) rad at times (k,) s of given frames (k,): NaN where nothing was measured.
        rgb: the picture (H, W, 3) uint8 of a frame, or None.
        depth: its depth (H, W) float32 m, 0 where there is no reading, or None.
        board: calibration board in view, None if there is none.
        corners: detected corners of the board in a frame, None if it is not found.
        again: depth (H, W) m of another frame taken from the same place as a given one; None if there is none.
        sensor: kind of depth camera, as stated by the recording, "" if not stated.
        recording: the recording of the frames; None for frames without one.
    """

    name: str
    camera: Camera
    time: np.ndarray
    joints: Callable[[np.ndarray, np.ndarray], np.ndarray]
    rgb: Callable[[int], np.ndarray | None]
    depth: Callable[[int], np.ndarray | None]
    board: Board | None = None
    corners: Callable[[int], View | None] = lambda i: None
    again: Callable[[int], np.ndarray | None] = lambda i: None
    sensor: str = ""
    recording: Recording | None = None

    def __len__(self) -> int:
        return len(self.time)

    def at(self, frames: np.ndarray, late: np.ndarray | float = 0.0) -> np.ndarray:
        """Return the angles (k, nj) rad measured `late` s after the time stamps of some frames (k,)."""
        return self.joints(self.time[frames] + late, frames)

    def only(self, frames: Sequence[int] | np.ndarray) -> Sight:
        """Return the sight with some of the frames, in this order."""
        chosen = np.asarray(frames, int)
        return Sight(
            self.name,
            self.camera,
            self.time[chosen],
            lambda time, i: self.joints(time, chosen[i]),
            lambda i: self.rgb(int(chosen[i])),
            lambda i: self.depth(int(chosen[i])),
            self.board,
            lambda i: self.corners(int(chosen[i])),
            lambda i: self.again(int(chosen[i])),
            self.sensor,
            self.recording,
        )
