"""Apply a camera's sensor effects to many rendered clips at once, as rows of one batched pipeline.

An image effect has a high cost per call and a low cost per image, so clips side by side take less time than one after
the other. A row whose clip has ended takes the next one. The result of a clip depends only on its own world and seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.worlds.world import World

ROWS = 8  # most clips side by side; more are hardly faster. With another number pixels may round otherwise


@dataclass(frozen=True)
class Clip:
    """T >= 1 images of one camera in one look (appearance) of an episode.

    Attributes:
        world: a world without ranges, whose image effects make up the sensor.
        seed: seed of the sensor's noise.
        rgb: (T, H, W, 3) uint8.
        depth: (T, H, W) float32, m, 0 = no reading.
        truth: (T, H, W) float32, m, depth as rendered; where `depth` is rendered too, and not made from two infrared
            pictures by block matching, it is the same array.
        velocity: (T, 6) of the camera in its own axes, m/s and rad/s.
        bodies: (T, H, W), and twists: (T, bodies, 6), as in `vispeg.core.frame.Frame`; None if no effect needs them.
        parts: (T, H, W) uint8, number of the part in each pixel, 0 = none; None without labels.
    """

    world: World
    seed: int
    rgb: np.ndarray
    depth: np.ndarray
    truth: np.ndarray
    velocity: np.ndarray
    parts: np.ndarray | None = None
    bodies: np.ndarray | None = None
    twists: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.rgb)


@dataclass(frozen=True)
class Sensed:
    """A clip's images as the camera delivers them.

    Attributes:
        rgb: (T, H, W, 3) uint8.
        depth: (T, H, W) float32, m, 0 = no reading.
        shown: (T,) int, time step of the clip that each image shows: an earlier one if the image is late.
        parts: (T, H, W) uint8, number of the part in each delivered pixel; None without labels.
    """

    rgb: np.ndarray
    depth: np.ndarray
    shown: np.ndarray
    parts: np.ndarray | None


def sense(camera: Camera, clips: Sequence[Clip], period: float, rows: int = ROWS) -> list[Sensed]:
    """Return each clip's images as the camera delivers them.

    Args:
        camera: the camera with its believed intrinsics.
        clips: rendered clips, without sensor effects.
        period: time between images, s.
        rows: greatest number of clips side by side.

    Raises:
        ValueError: no row, an effect that returned no image, or labels or bodies in some clips only.
    """
    if rows < 1:
        raise ValueError(f"{rows} rows, expected at least 1")
    labelled, moving = _have(clips, "parts"), _have(clips, "bodies")
    n = min(rows, len(clips))
    out = [Sensed(np.empty_like(c.rgb), np.empty_like(c.depth), np.empty(len(c), int), _empty(c.parts)) for c in clips]
    clip_of, step, next_clip = list(range(n)), [0] * n, n  # clip and step of each row
    pipeline = Pipeline([clips[i].world for i in clip_of], camera.name)
    intrinsics = np.repeat(camera.K[None], n, axis=0)
    busy = list(range(n))
    while busy:
        # a row for which no clip is left repeats its last image
        now = [(clips[i], min(t, len(clips[i]) - 1)) for i, t in zip(clip_of, step, strict=True)]
        frame = Frame(
            rgb=np.stack([c.rgb[t] for c, t in now]).astype(np.float32) / 255,
            depth=np.stack([c.depth[t] for c, t in now]),
            K=intrinsics,
            truth=np.stack([c.truth[t] for c, t in now]),
            velocity=np.stack([c.velocity[t] for c, t in now]),
            bodies=np.stack([c.bodies[t] for c, t in now if c.bodies is not None]) if moving else None,
            twists=np.stack([c.twists[t] for c, t in now if c.twists is not None]) if moving else None,
            parts=np.stack([c.parts[t] for c, t in now if c.parts is not None]) if labelled else None,
            time=np.array(step) * period,
        )
        delivered = pipeline.run(frame, [stream(c.seed, "image", camera.name, t) for c, t in now])
        if delivered.rgb is None or delivered.depth is None or delivered.shown is None:
            raise ValueError("an effect took a picture away")
        rgb = np.round(255 * np.clip(delivered.rgb, 0, 1)).astype(np.uint8)
        shown = np.rint(delivered.shown / period).astype(int)
        for row in busy:
            images, t = out[clip_of[row]], step[row]
            images.rgb[t], images.depth[t] = rgb[row], np.nan_to_num(delivered.depth[row])
            images.shown[t] = shown[row]
            if images.parts is not None and delivered.parts is not None:
                images.parts[t] = delivered.parts[row]
            step[row] += 1
        ended = [row for row in busy if step[row] == len(clips[clip_of[row]])]
        for row in ended:
            if next_clip < len(clips):
                clip_of[row], step[row], next_clip = next_clip, 0, next_clip + 1
                pipeline.place([row], [clips[clip_of[row]].world])
            else:
                pipeline.place([row], [World()])  # without effects
                busy.remove(row)
    # labels follow the pixels through lens and shutter; a late image has those of the moment that it shows
    return [s if s.parts is None else replace(s, parts=s.parts[s.shown]) for s in out]


def _empty(like: np.ndarray | None) -> np.ndarray | None:
    return None if like is None else np.empty_like(like)


def _have(clips: Sequence[Clip], name: str) -> bool:
    """Return whether the clips have a value of this name. Raises ValueError: some have one and others do not."""
    found = {getattr(clip, name) is not None for clip in clips}
    if len(found) > 1:
        raise ValueError(f"some clips have {name} and others do not")
    return found == {True}
