"""Draw what a camera or appearance effect does: the same view without and with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.effect import Effect, EffectInstance
from vispeg.core.files import write_bytes_atomic
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render.backends.backend import Renderer, Shot
from vispeg.render.block_matching import Matcher
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.image_kinds import depth_picture
from vispeg.render.look import dress
from vispeg.render.snapshot import Snapshot
from vispeg.task.eyes import resized
from vispeg.task.start import home
from vispeg.worlds.split import moving
from vispeg.worlds.words import place
from vispeg.worlds.world import World

SIZE = 240  # px, side of a view
SPEED = 0.5  # rad/s of the first joint, for what depends on motion


def draw(kind: Effect, where: str | None, scene: Any, path: Path, *, overwrite: bool = False) -> bool:
    """Write a PNG with colour and depth of two cameras of an arm that moves: nominal above, with effect below.

    The cameras are the external one and the wide one on the wrist, or in its place the one on which the effect acts.

    Args:
        kind: the effect, at its typical values.
        where: the effect's place; by default everywhere.
        scene: the robot in its cell.
        path: path of the picture.
        overwrite: replace an existing picture.

    Returns:
        Whether the effect changes anything there; without a change no picture is written.
    """
    where = place(kind, where or "all", scene)
    placed = EffectInstance.of(kind.name, where, **{k: p.start for k, p in kind.params.items()})
    by_name = {c.name: c for c in standard_cameras(scene.tip, scene.config.fixture)}
    shown = ["external", where if where in by_name and where != "external" else "wrist_wide"]
    cameras = [resized(by_name[name], SIZE) for name in shown]
    rows = []
    how: Any = {"shadows": kind.name == "shadows", "moving": moving(World(effects=(placed,)))}
    with Renderer(scene, cameras, **how) as renderer:
        posture = home(scene)
        qpos = np.concatenate([posture, np.zeros(renderer.model.nq - len(posture))])
        qvel = np.append(SPEED, np.zeros(renderer.model.nv - 1))
        matcher = Matcher(renderer, scene, renderer.backend)
        for world in (World(), World(effects=(placed,))):
            dress(renderer, scene, world)
            matcher.begin(world, {})
            shots = renderer.render(qpos, qvel=qvel)
            depths = matcher.depths(0, Snapshot(qpos, qvel, {}))
            views = [replace(shots[c.name], depth=depths.get(c.name, shots[c.name].depth)) for c in cameras]
            seen = [_seen(view, shots[c.name].depth, c, world) for c, view in zip(cameras, views, strict=True)]
            rows.append(np.concatenate(seen, axis=1))
    if np.array_equal(*rows):
        return False
    import cv2

    write_bytes_atomic(path, cv2.imencode(".png", np.concatenate(rows)[..., ::-1])[1].tobytes(), overwrite=overwrite)
    return True


def _seen(shot: Shot, truth: np.ndarray, camera: Camera, world: World) -> np.ndarray:
    """Return colour and depth side by side, (H, 2 W, 3) uint8, with the camera's effects; missing depth is black.

    `truth` (H, W) m is depth as rendered, which also scales the colours of depth.
    """
    rgb, velocity = shot.rgb[None].astype(np.float32) / 255, shot.velocity[None]
    bodies, twists = (None if a is None else a[None] for a in (shot.bodies, shot.twists))
    of_motion = {"velocity": velocity, "bodies": bodies, "twists": twists}
    frame = Frame(rgb, shot.depth[None], camera.K[None], truth=truth[None], **of_motion)
    out = Pipeline([world], camera.name).run(frame, [stream(0, "look", camera.name)])
    assert out.rgb is not None and out.depth is not None  # the frame had both
    colour = np.round(255 * np.clip(out.rgb[0], 0, 1)).astype(np.uint8)
    depth = out.depth[0]
    near, far = (float(np.percentile(truth[truth > 0], q)) for q in (2, 90))
    return np.concatenate([colour, depth_picture(depth, near, max(far, near + 1e-6))], axis=1)
