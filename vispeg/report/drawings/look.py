"""Draw what a camera or appearance effect does: the same view without and with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from io import BytesIO
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
from vispeg.report.drawings.figures import new_figure, styled
from vispeg.task.eyes import resized
from vispeg.task.start import home
from vispeg.worlds.split import moving
from vispeg.worlds.words import place
from vispeg.worlds.world import World

SIZE = 240  # px, side of a view
SPEED = 0.5  # rad/s of the first joint, for what depends on motion


@dataclass(frozen=True)
class Seen:
    """What a camera sees: its name, colour and drawn depth (H, W, 3) uint8, and the range of the depth's colours, m."""

    camera: str
    colour: np.ndarray
    depth: np.ndarray
    near: float
    far: float


def draw(kind: Effect, where: str | None, scene: Any, path: Path, *, overwrite: bool = False) -> bool:
    """Write a PNG with colour and depth of two cameras of an arm that moves: nominal above, with effect below.

    Arguments are as in `looks`; `path` is the picture's, and `overwrite` replaces an existing one.

    Returns:
        Whether the effect changes anything there; without a change no picture is written.
    """
    placed, without, seen = looks(kind, where, scene)
    pairs = zip(without, seen, strict=True)
    if all(np.array_equal(a.colour, b.colour) and np.array_equal(a.depth, b.depth) for a, b in pairs):
        return False
    picture = BytesIO()
    sizes = ", ".join(f"{k} {v.value:g} {kind.params[k].unit}".removesuffix(" 1") for k, v in placed.params.items())
    with styled():
        figure = new_figure(5.0, 8.6)
        grid = figure.subplots(2, 2 * len(seen), squeeze=False)
        for row, (name, views) in enumerate((("without", without), ("with the effect", seen))):
            grid[row, 0].set_ylabel(name)
            for k, view in enumerate(views):
                title = f"{view.camera}: depth\n{view.near:.2f} m red, {view.far:.2f} m blue"
                drawn = (view.colour, view.camera), (view.depth, title)
                for ax, (image, text) in zip(grid[row, 2 * k : 2 * k + 2], drawn, strict=True):
                    ax.imshow(image, interpolation="nearest")
                    ax.set(xticks=[], yticks=[])
                    ax.spines[:].set_visible(False)
                    if row == 0:
                        ax.set_title(text)
        figure.suptitle(f"{placed.label}\n{sizes}", x=0.01, ha="left", fontsize=10, fontweight="bold")
        figure.savefig(picture, format="png", dpi=160)
    write_bytes_atomic(path, picture.getvalue(), overwrite=overwrite)
    return True


def looks(kind: Effect, where: str | None, scene: Any) -> tuple[EffectInstance, list[Seen], list[Seen]]:
    """Return the effect, and what two cameras of an arm that moves see without and with it.

    The cameras are the external one and the wide one on the wrist, or in its place the one on which the effect acts.

    Args:
        kind: the effect, at its typical values.
        where: the effect's place; by default everywhere.
        scene: the robot in its cell.
    """
    where = place(kind, where or "all", scene)
    placed = EffectInstance.of(kind.name, where, **{k: p.start for k, p in kind.params.items()})
    by_name = {c.name: c for c in standard_cameras(scene.tip, scene.config.fixture)}
    shown = ["external", where if where in by_name and where != "external" else "wrist_wide"]
    cameras = [resized(by_name[name], SIZE) for name in shown]
    out = []
    shadows, moves = kind.name == "shadows", moving(World(effects=(placed,)))
    with Renderer(scene, cameras, shadows=shadows, moving=moves) as renderer:
        posture = home(scene)
        qpos = np.concatenate([posture, np.zeros(renderer.model.nq - len(posture))])
        qvel = np.append(SPEED, np.zeros(renderer.model.nv - 1))
        matcher = Matcher(renderer, scene, renderer.backend)
        for world in (World(), World(effects=(placed,))):
            dress(renderer, scene, world)
            matcher.begin(world, {})
            shots = renderer.render(qpos, qvel=qvel)
            depths = matcher.depths(seed=0, snapshot=Snapshot(qpos, qvel, {}))
            views = [replace(shots[c.name], depth=depths.get(c.name, shots[c.name].depth)) for c in cameras]
            out.append([_seen(view, shots[c.name].depth, c, world) for c, view in zip(cameras, views, strict=True)])
    return placed, out[0], out[1]


def _seen(shot: Shot, truth: np.ndarray, camera: Camera, world: World) -> Seen:
    """Return what a camera with its effects sees; missing depth is black.

    `truth` (H, W) m is depth as rendered, which also scales the colours of depth.
    """
    rgb, velocity = shot.rgb[None].astype(np.float32) / 255, shot.velocity[None]
    bodies, twists = (None if a is None else a[None] for a in (shot.bodies, shot.twists))
    K, depth = camera.K[None], shot.depth[None]
    frame = Frame(rgb, depth, K, truth=truth[None], velocity=velocity, bodies=bodies, twists=twists)
    out = Pipeline([world], camera.name).run(frame, [stream(0, "look", camera.name)])
    assert out.rgb is not None and out.depth is not None  # the frame had both
    colour = np.round(255 * np.clip(out.rgb[0], 0, 1)).astype(np.uint8)
    near, far = (float(np.percentile(truth[truth > 0], q)) for q in (2, 90))
    far = max(far, near + 1e-6)
    return Seen(camera.name, colour, depth_picture(out.depth[0], near, far), near, far)
