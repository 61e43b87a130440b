"""Draw what a camera or appearance effect does: the same view without and with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.effect import Effect, EffectInstance
from vispeg.core.files import write_bytes_atomic
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render.backends.backend import Renderer, Shot
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.image_kinds import depth_picture
from vispeg.render.look import dress
from vispeg.task.eyes import resized
from vispeg.task.start import home
from vispeg.worlds.words import place
from vispeg.worlds.world import World

SIZE = 240  # px, side of a view


def draw(kind: Effect, where: str | None, scene: Any, path: Path, *, overwrite: bool = False) -> None:
    """Write a PNG with colour and depth of the external and the wide wrist camera: nominal above, with effect below.

    Args:
        kind: the effect, at its typical values.
        where: the effect's place; by default everywhere.
        scene: the robot in its cell.
        path: path of the picture.
        overwrite: replace an existing picture.
    """
    where = place(kind, where or "all", scene)
    placed = EffectInstance.of(kind.name, where, **{k: p.start for k, p in kind.params.items()})
    wide, _, external = standard_cameras(scene.tip, scene.config.fixture)
    cameras = [resized(c, SIZE) for c in (external, wide)]
    rows = []
    with Renderer(scene, cameras, shadows=kind.name == "shadows") as renderer:
        posture = home(scene)
        qpos = np.concatenate([posture, np.zeros(renderer.model.nq - len(posture))])
        for world in (World(), World(effects=(placed,))):
            dress(renderer, scene, world)
            shots = renderer.render(qpos)
            rows.append(np.concatenate([_seen(shots[c.name], c.name, c.K, world) for c in cameras], axis=1))
    import cv2

    write_bytes_atomic(path, cv2.imencode(".png", np.concatenate(rows)[..., ::-1])[1].tobytes(), overwrite=overwrite)


def _seen(shot: Shot, camera: str, K: np.ndarray, world: World) -> np.ndarray:
    """Return colour and depth side by side, (H, 2 W, 3) uint8, with the camera's effects; missing depth is black."""
    frame = Frame(shot.rgb[None].astype(np.float32) / 255, shot.depth[None], K[None])
    out = Pipeline([world], camera).run(frame, [stream(0, "look", camera)])
    assert out.rgb is not None and out.depth is not None  # the frame had both
    colour = np.round(255 * np.clip(out.rgb[0], 0, 1)).astype(np.uint8)
    depth = out.depth[0]
    near, far = (float(np.percentile(shot.depth[shot.depth > 0], q)) for q in (2, 90))
    return np.concatenate([colour, depth_picture(depth, near, max(far, near + 1e-6))], axis=1)
