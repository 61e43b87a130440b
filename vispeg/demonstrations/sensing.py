"""Apply a camera's sensor effects to many rendered clips at once, as rows of one batched pipeline.

An image effect has a high cost per call and a low cost per image, so sixteen clips side by side take half the time of
sixteen one after the other. A row whose clip has ended takes the next one. The result of a clip depends only on its own
world and seed.
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

ROWS = 8  # clips side by side: more are hardly faster. Pixel rounding may depend on it, so it is fixed


@dataclass(frozen=True)
class Clip:
    """T >= 1 images of one camera in one look (appearance) of an episode.

    Attributes:
        world: a world without ranges, whose image effects make up the sensor.
        seed: seed of the sensor's noise.
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
    """Return each clip's images as the camera delivers them, (T, H, W, 3) uint8 and (T, H, W) float32 m.

    The third array, (T,) int, is the time step of the clip that each image shows: an earlier one if the image is late.

    Args:
        camera: the camera with its believed intrinsics.
        clips: rendered clips, without sensor effects.
        period: time between images, s.
        rows: number of clips side by side.

    Raises:
        ValueError: an effect returned no image.
    """
    n = min(rows, len(clips))
    out = [(np.empty_like(c.rgb), np.empty_like(c.depth), np.empty(len(c), int)) for c in clips]
    clip_of, step, following = list(range(n)), [0] * n, n  # clip and step of each row; the next clip
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
                pipeline.place([row], [World()])  # an idle row repeats its last image, without effects
                busy.remove(row)
    return out
