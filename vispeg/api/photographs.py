"""Find the images for a calibration, and poses of the flange: in a folder, or in a recording with frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.frames.frames import Frames
from vispeg.recordings.frames.joints import joints_at
from vispeg.recordings.load import load
from vispeg.recordings.recording import Recording
from vispeg.render.calibration.detect import pictures
from vispeg.render.calibration.poses import read_poses
from vispeg.render.calibration.rigid import from_quaternion
from vispeg.sim.compiled import flange_pose
from vispeg.sim.recorded import with_robot


@dataclass(frozen=True)
class Photographs:
    """Images for a calibration.

    Attributes:
        files: the image files.
        flange: function from file names (n) to the poses base_T_flange (n, 4, 4), m; None if they are unknown.
    """

    files: list[Path]
    flange: Callable[[Sequence[str]], np.ndarray] | None


def photographs(images: str | Path, poses: str | Path | None, camera: str) -> Photographs:
    """Return the images of a folder or recording.

    Args:
        images: a folder of images, or a recording with frames.
        poses: file or folder of the flange's poses, for a folder of images.
        camera: name of the camera, for a recording with several.

    Raises:
        UserError: no image, a recording without colour frames of the camera at measured angles, or `poses` with a
            recording.
    """
    root = Path(images)
    if (root / "recording.yaml").is_file():
        return _recorded(root, poses, camera)
    return Photographs(pictures(root), None if poses is None else partial(read_poses, Path(poses)))


def _recorded(root: Path, poses: str | Path | None, camera: str) -> Photographs:
    """Return the colour frames of a recording, with the flange's poses from its joints."""
    if poses is not None:
        raise UserError("the poses of a recording follow from its joints", key="--poses", expected="none", got=poses)
    rec, robot = with_robot(load(root))
    frames = _frames_of(rec, camera)
    q = joints_at(rec, frames.times, frames.episodes)
    place = flange_pose(robot, q)
    poses_of_frames = from_quaternion(place[:, :3], place[:, 3:])
    measured = np.flatnonzero(np.isfinite(q).all(axis=1))
    flange: dict[Path, np.ndarray] = {}
    for i in measured:
        file = frames[int(i)].rgb_source
        if isinstance(file, Path):  # None for a frame without colour
            flange[file] = poses_of_frames[i]
    if not flange:
        raise UserError("no colour frames at measured joint angles", file=root)
    by_name = {file.name: pose for file, pose in flange.items()}
    if len(by_name) < len(flange):
        raise UserError(
            "two pictures have one file name", file=root, key="frames/index.csv", expected="names that differ"
        )
    return Photographs(list(flange), lambda wanted: np.stack([by_name[name] for name in wanted]))


def _frames_of(rec: Recording, camera: str) -> Frames:
    """Return the frames of the camera of this name, or of the only camera. Raises UserError: no such camera."""
    names = [] if rec.frames is None else list(rec.frames.names)
    if rec.frames is None or not names or (len(names) > 1 and camera not in names):
        raise UserError("no such camera", file=rec.path, key="--name", got=camera, choices=names, expected="frames")
    return rec.frames.of(camera if camera in names else names[0])
