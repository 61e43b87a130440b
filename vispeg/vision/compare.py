"""Compare a model's pictures with a recording's, frame by frame: borders in px, depth in mm, light in grey levels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.effect import Effect, effect
from vispeg.core.errors import UserError
from vispeg.effects.common.camera import CameraEffect
from vispeg.recordings.frames.frames import RecordedFrame
from vispeg.recordings.frames.joints import joints_at
from vispeg.recordings.recording import Recording
from vispeg.render.backends.backend import BackendName
from vispeg.robots.scene import Scene
from vispeg.vision.board import Corners, board_of, corners_in, look_at, view_of_board
from vispeg.vision.borders import Borders
from vispeg.vision.depth import DepthQuality, DepthResidual, depth_quality, depth_residual
from vispeg.vision.eye import camera_of
from vispeg.vision.photometry import LightResidual, light_residual
from vispeg.vision.predict import Predictor, Rendering, through_sensor
from vispeg.vision.search import Displacements, search
from vispeg.vision.shutter import DRAWN, Path, Shutter, exposed_borders
from vispeg.worlds.world import World

WINDOW = 8.0  # px to either side of a border, in which its edge is searched
FLAT = "table"  # the flat part of a cell, to which a plane is fitted


@dataclass(frozen=True, eq=False)
class Compared:
    """One frame, measured and predicted; what a camera does not deliver is None.

    Attributes:
        recording: name.
        frame: as measured.
        rendering: as predicted.
        borders, displacements: predicted, and where the picture has them.
        depth, quality: residual and figures of depth.
        light: residual of colour.
        corners: of the cell's board, where the frame shows it.
    """

    recording: str
    frame: RecordedFrame
    rendering: Rendering
    borders: Borders
    displacements: Displacements | None
    depth: DepthResidual | None
    quality: DepthQuality | None
    light: LightResidual | None
    corners: Corners | None = None

    @property
    def corner_rms(self) -> float | None:
        """RMS displacement of the board's corners, along each of u and v, px."""
        return _rms(None if self.corners is None else self.corners.away)

    @property
    def border_rms(self) -> float | None:
        """RMS displacement of the borders, px."""
        return _rms(None if self.displacements is None else self.displacements.along)

    @property
    def depth_error(self) -> np.ndarray:
        """(n,) mm, of the interior pixels that have a reading."""
        if self.depth is None:
            return np.zeros(0)
        error = self.depth.error[self.depth.interior]
        return 1e3 * error[np.isfinite(error)]

    @property
    def depth_rms(self) -> float | None:
        """RMS error of depth on the interior, mm."""
        return _rms(self.depth_error)

    @property
    def light_rms(self) -> float | None:
        """RMS error of colour after gain and offset, grey levels."""
        return _rms(None if self.light is None else self.light.error)

    def row(self) -> dict[str, object]:
        """Return the frame's entry of a record."""
        quality = self.quality
        return {
            "recording": self.recording,
            "camera": self.frame.camera.name,
            "time": self.frame.time,
            "episode": self.frame.episode,
            "border_px": self.border_rms,
            "borders": 0 if self.displacements is None else int(np.isfinite(self.displacements.along).sum()),
            "corner_px": self.corner_rms,
            "corners": 0 if self.corners is None else len(self.corners.away),
            "depth_mm": self.depth_rms,
            "grey": self.light_rms,
            "fill_rate": None if quality is None else quality.fill_rate,
            "z_accuracy": None if quality is None else quality.z_accuracy,
            "plane_fit_rms_mm": None if quality is None else quality.plane_fit_rms_mm,
            "distance": None if quality is None else quality.distance,
        }


def _rms(values: np.ndarray | None) -> float | None:
    if values is None or not np.isfinite(values).any():
        return None
    return float(np.sqrt(np.nanmean(np.square(values, dtype=np.float64))))


def compare_frames(
    rec: Recording,
    scene: Scene,
    world: World,
    *,
    backend: BackendName = "auto",
    progress: Callable[[float], None] = lambda share: None,
) -> list[Compared]:
    """Compare each frame of a recording with its prediction at the measured joint angles.

    Frames at whose time the joints are not known (a gap in the log, a window that was not chosen) are left out.

    Args:
        rec: with frames; its cameras state where they sit.
        scene: the cell as its user believes it, whose cameras are the recording's.
        world: the effects that the model has.
        backend: of the renderer.
        progress: called with the share that is done.

    Raises:
        UserError: a camera without a pose, or no frame whose joint angles are known.
    """
    if rec.frames is None or not len(rec.frames):
        raise UserError("has no frames", file=rec.path)
    frames = rec.frames
    cameras = [camera_of(frames.cameras[name]) for name in frames.names]
    done: list[Compared] = []
    with Predictor(scene, cameras, backend) as predictor:
        predictor.see(world)
        shutters = {camera.name: Shutter.of(predictor.world, camera.name) for camera in cameras}
        corners = _corners(rec, predictor, shutters)
        for i, frame in enumerate(frames):
            shutter, path = shutters[frame.camera.name], _path(rec, frame.episode)
            if np.isfinite(path(frame.time + shutter.span)).all():
                compared = compare_one(rec.name, frame, predictor, shutter, path)
                done.append(replace(compared, corners=corners.get(i)))
            progress((i + 1) / len(frames))
    if not done:
        raise UserError("no frame lies where the joint angles are known", file=rec.path)
    return done


def _corners(rec: Recording, predictor: Predictor, shutters: Mapping[str, Shutter]) -> dict[int, Corners]:
    """Return by frame the corners of the cell's board, its pose estimated from all frames of a camera."""
    board, out = board_of(rec.cell, rec.path / "recording.yaml"), {}
    if board is None or rec.frames is None:
        return out
    for name, shutter in shutters.items():
        looks = {}
        for i, frame in enumerate(rec.frames):
            (q,) = _path(rec, frame.episode)(np.array([frame.time - shutter.delay]))
            rgb = frame.rgb if frame.camera.name == name and np.isfinite(q).all() else None
            if rgb is not None and (view := view_of_board(rgb, board)) is not None:
                looks[i] = look_at(predictor.geometry, name, q, view)
        out |= corners_in(predictor.geometry, name, board, looks)
    return out


def _path(rec: Recording, episode: int) -> Path:
    """Map times (n,) s of an episode to measured angles (n, nj) rad, NaN where they are not known."""
    return lambda time: joints_at(rec, time, np.full(len(time), episode))


def compare_one(recording: str, frame: RecordedFrame, predictor: Predictor, shutter: Shutter, path: Path) -> Compared:
    """Compare one frame with what a predictor draws along measured joint angles, in its present world.

    Args:
        recording: name.
        frame: as measured.
        predictor: of the cell.
        shutter: of the frame's camera.
        path: times (n,) s -> measured angles (n, nj) rad.
    """
    drawn, borders = exposed_borders(predictor, frame.camera.name, shutter, path, frame.time)
    rendering = _delivered(predictor.world, drawn)
    rgb, depth = frame.rgb, frame.depth
    residual = None if depth is None else depth_residual(depth, rendering)
    flat = 1 + list(predictor.scene.parts).index(FLAT) if FLAT in predictor.scene.parts else None
    return Compared(
        recording,
        frame,
        rendering,
        borders,
        None if rgb is None else search(rgb, borders, WINDOW),
        residual,
        None if depth is None or residual is None else depth_quality(depth, rendering, residual, flat),
        None if rgb is None else light_residual(rgb, rendering),
    )


def _delivered(world: World, rendering: Rendering) -> Rendering:
    """Return the picture after the sensor effects of a world that are the same in every frame, so without noise."""

    def steady(kind: Effect) -> bool:
        return isinstance(kind, CameraEffect) and kind.name not in DRAWN and not kind.random

    world = world.only(lambda e: steady(effect(e.effect)))
    if not world.effects:
        return rendering
    rgb, depth = through_sensor(world, rendering, 0, bend=False)
    return replace(rendering, rgb=rgb, depth=depth)


def summary(compared: Sequence[Compared]) -> list[dict[str, object]]:
    """Return the figures of each camera over all its frames; None where nothing was measured."""
    out = []
    for name in dict.fromkeys(c.frame.camera.name for c in compared):
        mine = [c for c in compared if c.frame.camera.name == name]
        along = [c.displacements.along for c in mine if c.displacements is not None]
        depth = [c.depth_error for c in mine if c.depth is not None]
        quality = [c.quality for c in mine if c.quality is not None]
        light = [c.light for c in mine if c.light is not None]
        corners = [c.corners.away.ravel() for c in mine if c.corners is not None]
        out.append(
            {
                "camera": name,
                "frames": len(mine),
                "border_px": _pooled(along),
                "border_median_px": _median(along, size=True),
                "border_found": float(np.mean(np.isfinite(np.concatenate(along)))) if along else None,
                "corner_px": _pooled(corners),
                "corner_median_px": _median(corners, size=True),
                "depth_mm": _pooled(depth),
                "depth_median_mm": _median(depth, size=True),
                "depth_bias_mm": _median(depth),
                "grey": _pooled([x.error.ravel() for x in light]),
                "gain": np.median([x.gain for x in light], axis=0).tolist() if light else None,
                **{key: _middle([getattr(q, key) for q in quality]) for key in QUALITY},
            }
        )
    return out


def border_rms(compared: Sequence[Compared]) -> float | None:
    """Return the RMS displacement of the borders in all frames, px."""
    return _pooled([c.displacements.along for c in compared if c.displacements is not None])


QUALITY = ("fill_rate", "z_accuracy", "plane_fit_rms", "plane_fit_rms_mm", "subpixel_rms")


def _pooled(parts: Sequence[np.ndarray]) -> float | None:
    """Return the RMS over all parts; None without any."""
    return _rms(np.concatenate(parts)) if parts else None


def _median(parts: Sequence[np.ndarray], size: bool = False) -> float | None:
    """Return the median over all parts, of absolute values if `size`; None without any."""
    values = np.concatenate(parts) if parts else np.zeros(0)
    values = values[np.isfinite(values)]
    return float(np.median(np.abs(values) if size else values)) if len(values) else None


def _middle(values: Sequence[float | None]) -> float | None:
    """Return the median of the values that are not None."""
    present = [v for v in values if v is not None]
    return float(np.median(present)) if present else None
