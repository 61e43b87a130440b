"""The effect `block_matching`: depth from a rendered pair of stereo cameras, computed as a stereo depth camera does.

Both cameras of the pair ("eyes") are rendered at a multiple of the image's resolution, to reach the focal length of the
matcher. They are wider to the left by the largest disparity, so that each pixel of the image has a counterpart. A
projector half-way between the eyes lights the scene with a speckle pattern. Read-out noise is added, and the images are
rounded to 8 bits. OpenCV's semi-global matcher with left-right check finds disparities d to 1/16 px; depth is f B / d
with focal length f and baseline B. Each image pixel takes the median of the fine readings in it, or no reading where
fewer than half of them are valid.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.effects.common.field import normal
from vispeg.effects.common.light import LUMA, to_linear
from vispeg.render.backends.backend import Renderer, Shot
from vispeg.render.backends.warp import Warp
from vispeg.render.cameras.camera import Camera
from vispeg.render.look import dress
from vispeg.render.snapshot import Snapshot
from vispeg.robots.scene import Scene
from vispeg.worlds.world import World

NAME = "block_matching"
SPECKLE = 512  # px, side of the pattern, which repeats beyond it
MARGIN = 8  # px on the right, where the matcher's blocks would reach beyond the picture
GRAIN = 1.5  # size of a speckle, in px of the eyes
SPURIOUS = 40  # px; regions of similar disparity smaller than this are discarded as wrong matches


class Matcher:
    """Block matching by the cameras of a renderer, in the worlds that have the effect.

    Args:
        renderer: the renderer, dressed in the look of the present world.
        scene: its scene.
        backend: the renderer's backend. Filament draws no eyes: they have many pixels and need no physically based
            materials, so that a faster backend draws them.
    """

    def __init__(self, renderer: Renderer, scene: Scene, backend: str):
        self.renderer, self.scene, self.separate_eyes = renderer, scene, backend == "filament"
        self._settings: dict[str, dict[str, float]] = {}
        self._eyes: Renderer | None = None

    def begin(self, world: World, bodies: Mapping[str, Any]) -> None:
        """Begin an episode in a sampled world, with bodies at these poses (see `dress`)."""
        found = {c.name: settings(world, c.name) for c in self.renderer.cameras}
        self._settings = {name: p for name, p in found.items() if p is not None}
        if self._settings and self.separate_eyes:
            self._eyes = self._eyes or Renderer(self.scene, self.renderer.nominal, "auto")
            dress(self._eyes, self.scene, world, bodies)

    def depths(self, seed: int, snapshot: Snapshot) -> dict[str, np.ndarray]:
        """Return the depth (H, W) float32 m of each camera that has the effect, in the state just rendered.

        Args:
            seed: seed of the look, for the read-out noise.
            snapshot: the state.
        """
        renderer = self.renderer
        if self._settings and self._eyes is not None:
            renderer = self._eyes
            renderer.render(snapshot.qpos, snapshot.bodies)
        return {
            name: depth(renderer, name, p, stream(seed, "eyes", name, snapshot.count), snapshot.qpos)
            for name, p in self._settings.items()
        }

    def close(self) -> None:
        """Free the renderer of the eyes."""
        if self._eyes is not None:
            self._eyes.close()


def settings(world: World, camera: str) -> dict[str, float] | None:
    """Return the effect's parameter values for a camera in a sampled world; None if depth is rendered as usual."""
    stated = None
    for placed in world.effects:
        if placed.effect == NAME and placed.where in ("all", camera):
            stated = {k: v.value for k, v in placed.params.items()}
    return stated if stated and stated["on"] > 0.5 else None


def depth(
    renderer: Renderer,
    camera: str,
    p: Mapping[str, float],
    rng: np.random.Generator,
    qpos: np.ndarray | None = None,
) -> np.ndarray:
    """Return the depth image that block matching finds, in the pixels of the camera with its own lens.

    The images of a camera with lens distortion are rectified: depth is computed in those of a pinhole, of which each
    pixel takes the nearest.

    Args:
        renderer: the renderer, with the world's look; its cameras are restored afterwards.
        camera: name of the camera whose depth is computed. It is the left eye; the right eye is added.
        p: values of the effect's parameters, from `settings`; missing ones take their start values.
        rng: generator of the read-out noise.
        qpos: (nq,) configuration; default: the present one.

    Returns:
        (H, W) float32 planar depth in m, 0 where there is no match.

    Raises:
        UserError: the renderer has no such camera.
    """
    cameras = {c.name: c for c in renderer.cameras}
    if camera not in cameras:
        raise UserError("no such camera", got=camera, choices=cameras)
    full = {k: q.start for k, q in effect(NAME).params.items()} | dict(p)
    warp = Warp(cameras[camera]) if any(cameras[camera].distortion) else None
    rectified = warp.pinhole if warp else cameras[camera]
    scale = max(1, round(full["focal"] / rectified.fx))
    left, right, span = eyes(rectified, scale, full["baseline"], full["nearest"])
    aimed = renderer.cameras
    renderer.aim([left, right])
    try:
        shots = renderer.render(qpos)
    finally:
        renderer.aim(aimed)
    offset = {left.name: -full["baseline"] / 2, right.name: full["baseline"] / 2}
    gray = [_eye_image(shots[c.name], c, offset[c.name], full, rng) for c in (left, right)]
    d = _match(gray[0], gray[1], span, int(full["window"]))[:, span:-MARGIN]
    fine = np.divide(np.float32(left.fx * full["baseline"]), d, out=np.zeros_like(d), where=d > 0)
    found = _median(fine, scale)
    return warp.nearest(found) if warp else found


def eyes(camera: Camera, scale: int, baseline: float, nearest: float) -> tuple[Camera, Camera, int]:
    """Return the left and the right eye, and the range of disparities in px.

    Args:
        camera: the camera whose depth is computed, a pinhole.
        scale: resolution of the eyes over that of the camera.
        baseline: distance of the eyes, m.
        nearest: least depth to match, m.

    Returns:
        The two eyes, and the disparity at `nearest`, rounded up to a multiple of 16 px. The eyes are wider than the
        image by this range on the left and by MARGIN on the right.
    """
    fx = camera.fx * scale
    span = 16 * int(np.ceil(fx * baseline / nearest / 16))
    left = camera.moved(
        name=f"{camera.name} left eye",
        width=camera.width * scale + span + MARGIN,
        height=camera.height * scale,
        fx=fx,
        fy=camera.fy * scale,
        cx=(camera.cx + 0.5) * scale - 0.5 + span,
        cy=(camera.cy + 0.5) * scale - 0.5,
    )
    shift = camera.rotation @ np.array([baseline, 0.0, 0.0])
    right = left.moved(name=f"{camera.name} right eye", pos=tuple((np.array(camera.pos) + shift).tolist()))
    return left, right, span


def _eye_image(shot: Shot, eye: Camera, offset: float, p: Mapping[str, float], rng: np.random.Generator) -> np.ndarray:
    """Return the grey image (H, W) uint8 of one eye, which is `offset` m to the right of the projector."""
    import cv2

    light = to_linear(shot.rgb.astype(np.float32) / 255) @ LUMA
    if p["pattern"]:
        z = np.where(shot.depth > 0, shot.depth, np.float32(1e3))  # m; the sky is far
        u = np.arange(eye.width, dtype=np.float32) - np.float32(eye.cx)
        v = np.arange(eye.height, dtype=np.float32)[:, None] - np.float32(eye.cy)
        # coordinates, in the pattern, of the projector's ray to the point that each pixel shows
        at_u = (u + np.float32(eye.fx * offset) / z) / np.float32(GRAIN)
        at_v = np.broadcast_to(v * np.float32(eye.fx / eye.fy / GRAIN), z.shape)
        speckle = cv2.remap(
            _speckle(int(p["seed"])), at_u % SPECKLE, np.ascontiguousarray(at_v % SPECKLE), cv2.INTER_LINEAR
        )
        light *= 1 + np.float32(p["pattern"]) * (2 * speckle - 1)
    light += np.float32(p["noise"]) * normal(rng, light.shape)
    return np.round(255 * np.sqrt(np.clip(light, 0, 1))).astype(np.uint8)


@lru_cache(maxsize=4)
def _speckle(seed: int) -> np.ndarray:
    """Return the pattern's brightness (513, 513) float32 in [0, 1], its first row and column repeated at the end."""
    noise = normal(stream(seed, "speckle"), (SPECKLE, SPECKLE))
    value = 1 / (1 + np.exp(-2.5 * noise))
    return np.pad(value, (0, 1), mode="wrap").astype(np.float32)


def _match(left: np.ndarray, right: np.ndarray, span: int, window: int) -> np.ndarray:
    """Return the disparity (H, W) float32, px, of the left eye's image; 0 where no match is found."""
    import cv2

    block = max(1, window | 1)  # px, odd as OpenCV requires
    matcher = cv2.StereoSGBM_create(  # pyright: ignore[reportAttributeAccessIssue]  # not declared by cv2
        minDisparity=0,
        numDisparities=span,
        blockSize=block,
        P1=8 * block**2,
        P2=32 * block**2,
        disp12MaxDiff=1,
        uniquenessRatio=8,
        speckleWindowSize=SPURIOUS,
        speckleRange=1,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    return np.maximum(matcher.compute(left, right), 0).astype(np.float32) / 16


def _median(fine: np.ndarray, scale: int) -> np.ndarray:
    """Return the lower median of the readings in each block of scale x scale px; 0 if fewer than half are valid."""
    height, width = fine.shape[0] // scale, fine.shape[1] // scale
    blocks = fine.reshape(height, scale, width, scale).swapaxes(1, 2).reshape(height, width, scale * scale)
    ordered = np.sort(np.where(blocks > 0, blocks, np.inf), axis=-1)
    count = np.isfinite(ordered).sum(axis=-1)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, axis=-1)[..., 0]
    return np.where(2 * count >= scale * scale, middle, 0).astype(np.float32)
