"""What a camera's sensor makes of many looks at once: they are rows of one pipeline, and follow each other in its rows.

An image effect costs much a call and little an image, so that sixteen looks side by side take half the time of sixteen
one after the other. A look's pictures follow from its own world and seed all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.worlds.world import World

ROWS = 8  # looks side by side: more are hardly quicker, and pixels may round otherwise, so that bytes follow from it


@dataclass(frozen=True)
class Clip:
    """T >= 1 pictures of one camera in one look of an episode.

    Attributes:
        world: without ranges; its image effects are the sensor.
        seed: of what the sensor draws.
        rgb: (T, H, W, 3) uint8.
        depth: (T, H, W) float32, m, 0 = no reading.
        velocity: (T, 6) of the camera in its own axes, m/s and rad/s.
    """

    world: World
    seed: int
    rgb: np.ndarray
    depth: np.ndarray
    velocity: np.ndarray

    def __len__(self) -> int:
        return len(self.rgb)


def sense(
    camera: Camera, clips: Sequence[Clip], period: float, rows: int = ROWS
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Each clip's pictures, (T, H, W, 3) uint8 and (T, H, W) float32 m, as the camera delivers them.

    With them comes which of the clip's moments each of them shows, (T,) int: an earlier one where it came late.

    Args:
        camera: as its user believes it.
        clips: as rendered.
        period: s between pictures.
        rows: clips side by side.

    Raises:
        ValueError: an effect that leaves no picture.
    """
    n = min(rows, len(clips))
    out = [(np.empty_like(c.rgb), np.empty_like(c.depth), np.empty(len(c), int)) for c in clips]
    clip_of, step, following = list(range(n)), [0] * n, n  # by row: its clip, the picture of it; the next clip to show
    pipeline = Pipeline([clips[i].world for i in clip_of], camera.name)
    intrinsics = np.repeat(camera.K[None], n, axis=0)
    busy = list(range(n))
    while busy:
        now = [(clips[i], min(t, len(clips[i]) - 1)) for i, t in zip(clip_of, step, strict=True)]
        depth = np.stack([c.depth[t] for c, t in now])
        frame = Frame(
            rgb=np.stack([c.rgb[t] for c, t in now]).astype(np.float32) / 255,
            depth=depth,
            K=intrinsics,
            truth=depth,
            velocity=np.stack([c.velocity[t] for c, t in now]),
            time=np.array(step) * period,
        )
        delivered = pipeline.run(frame, [stream(c.seed, "image", camera.name, t) for c, t in now])
        if delivered.rgb is None or delivered.depth is None or delivered.shown is None:
            raise ValueError("an effect took a picture away")
        rgb = np.round(255 * np.clip(delivered.rgb, 0, 1)).astype(np.uint8)
        shown = np.rint(delivered.shown / period).astype(int)
        for row in busy:
            of, at = out[clip_of[row]], step[row]
            of[0][at], of[1][at], of[2][at] = rgb[row], np.nan_to_num(delivered.depth[row]), shown[row]
            step[row] += 1
        over = [row for row in busy if step[row] == len(clips[clip_of[row]])]
        for row in over:
            if following < len(clips):
                clip_of[row], step[row], following = following, 0, following + 1
                pipeline.place([row], [clips[clip_of[row]].world])
            else:
                pipeline.place([row], [World()])  # shown its last picture on, without an effect
                busy.remove(row)
    return out
