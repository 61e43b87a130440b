"""MuJoCo's physically based renderer, Filament, without a display: it uses Vulkan, on a CPU through Mesa's lavapipe.

Materials, lights and reflections are those of real-time physically based rendering, so images differ from OpenGL's as
if another camera had taken them. Ids and normals come from rays through the same pixels. On a CPU it is about ten times
slower than OpenGL. Colours have a dither of about one level, which depends on the number of frames rendered so far.
Balls and cylinders have fewer facets than in OpenGL.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from vispeg.core.broken import in_words
from vispeg.core.errors import UserError
from vispeg.render.backends.picture import COLLISION, HIDDEN, Picture, is_visible
from vispeg.render.backends.raycast import cast
from vispeg.render.cameras.view import View, planar

HINT = "sudo apt-get install -y libvulkan1 mesa-vulkan-drivers; `vispeg doctor` tells more"
HEADLIGHT = 1.2e5  # lux of a full white headlight; with it the nominal cell is as bright as in OpenGL
# The library ends the process if there is no driver, so this test runs in another process.
_TRY = "import mujoco.studio; from mujoco import mjrf; mjrf.Context(mjrf.ContextConfig()); print('vispeg-drawn')"


@contextmanager
def _quiet() -> Iterator[None]:
    """Discard what the process writes to standard output and standard error, file descriptors 1 and 2, in the block.

    The library logs its internal state there ("EBR Stall Warning: Component Manager ..."). No user can act on it, and
    it would mix with output that a program may parse.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    kept, nowhere = [os.dup(1), os.dup(2)], os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in (1, 2):
            os.dup2(nowhere, stream)
        yield
    finally:
        for stream, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, stream)
        for descriptor in (*kept, nowhere):
            os.close(descriptor)


class Filament:
    """The Filament backend. Edited textures take effect after `upload`."""

    name = "filament"

    def __init__(self, model: mujoco.MjModel, shadows: bool):
        if reason := unusable():
            raise UserError(f"no physically based pictures here: {reason}", expected=HINT)
        import mujoco.studio  # must be imported first, or mjrf does not find its library
        from mujoco import mjrf

        self._mjrf: Any = mjrf
        self.model, self.shadows = model, shadows
        with _quiet():
            self._context: Any = mjrf.Context(mjrf.ContextConfig())
        self._targets: dict[tuple[int, int, bool], tuple[Any, Any]] = {}
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = 1
        self._option.geomgroup[COLLISION:] = 0
        self._option.sitegroup[:] = 0
        self._parts: tuple[Any, Any, Any, Any] | None = None  # scene, lights, renderables, resources
        self._built_from = b""  # the model fields from which they were made
        self.remembers = False  # nothing has been drawn yet

    @_quiet()
    def draw(self, data: mujoco.MjData, views: Sequence[View], ids: bool) -> list[Picture]:
        """Return one picture per view, in order; the kinematics and lights of `data` must be computed."""
        scene, lights, things = self._prepare()
        self.remembers = True  # the dither of colours depends on the number of frames rendered
        groups = self.model.geom_group.copy()
        self.model.geom_group[~is_visible(self.model)] = HIDDEN
        try:
            lights.update(data)
            things.update(data)
            return [self._draw_view(scene, data, view, ids) for view in views]
        finally:
            self.model.geom_group[:] = groups

    def upload(self, texture: int) -> None:
        """Rebuild the scene, with edited textures, at the next `draw`."""
        self._parts = None

    @_quiet()
    def close(self) -> None:
        """Free the scene, then the context."""
        self._parts, self._targets, self._context = None, {}, None

    def _prepare(self) -> tuple[Any, Any, Any]:
        """Return scene, lights and renderables, rebuilt if materials or shapes changed or `upload` was called."""
        m = self.model
        fields = (m.mat_rgba, m.mat_texid, m.mat_texrepeat, m.mat_roughness, m.mat_metallic, m.mat_specular)
        fields += (m.mat_shininess, m.geom_rgba, m.geom_matid, m.geom_size, m.light_castshadow, m.light_active)
        state = b"".join(array.tobytes() for array in fields)
        if self._parts is not None and state == self._built_from:
            return self._parts[:3]
        mjrf, self._parts = self._mjrf, None
        scene = self._context.create_scene(mjrf.SceneParams())
        scene.configure_from_model(m)
        resources = mjrf.ModelResources(self._context, m)
        things = mjrf.ModelRenderables(scene, resources)
        things.set_options(self._option)
        self._parts, self._built_from = (scene, mjrf.ModelLights(scene, resources), things, resources), state
        return self._parts[:3]

    def _draw_view(self, scene: Any, data: mujoco.MjData, view: View, ids: bool) -> Picture:
        height, width = view.camera.height, view.camera.width
        rgb, buffer = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        for out, depth in ((rgb, False), (buffer, True)):  # the library allows one read per render
            target, read = self._target(width, height, depth)
            read.set_buffer(out)
            request = self._request(scene, target, view, depth)
            self._context.wait_for_frame(self._context.render([request], [read]))
        depth = planar(buffer)
        if not ids:
            return Picture(rgb, depth)
        _, geom_ids, normals = cast(self.model, data, view)
        return Picture(rgb, depth, geom_ids, (normals @ view.rot).astype(np.float32))

    def _request(self, scene: Any, target: Any, view: View, depth: bool) -> Any:
        mjrf, request = self._mjrf, self._mjrf.RenderRequest()
        request.scene, request.target = scene, target
        request.camera = mjrf.Camera(**view.frustum())
        request.viewport.left = request.viewport.bottom = 0
        request.viewport.width, request.viewport.height = view.camera.width, view.camera.height
        request.draw_mode = getattr(mjrf.DrawMode, "DRAW_MODE_DEPTH" if depth else "DRAW_MODE_DEFAULT")
        request.shadows, request.reflections, request.haze = self.shadows, False, False
        head = self.model.vis.headlight
        # the headlight is off if any light states a photometric intensity
        request.headlight = bool(head.active) and not (self.model.light_intensity > 0).any()
        request.headlight_color, request.headlight_intensity = head.diffuse.astype(np.float32), HEADLIGHT
        return request

    def _target(self, width: int, height: int, depth: bool) -> tuple[Any, Any]:
        key = (width, height, depth)
        if key not in self._targets:
            mjrf = self._mjrf
            kind = mjrf.PixelFormat.PIXEL_FORMAT_R32F if depth else mjrf.PixelFormat.PIXEL_FORMAT_RGB8
            target = self._context.create_render_target(mjrf.RenderTargetConfig(color_format=kind))
            target.resize(width, height)
            self._targets[key] = target, mjrf.ReadRequest(target=target)
        return self._targets[key]


@lru_cache(maxsize=1)
def unusable() -> str:
    """Return why Filament does not work here, or an empty string if it does.

    It is tried once, in another process, which takes about a second.
    """
    try:
        done = subprocess.run([sys.executable, "-c", _TRY], env=_headless(), capture_output=True, text=True, timeout=60)
    except subprocess.TimeoutExpired:
        return "no answer in 60 s"
    except OSError as error:
        return error.strerror or "it cannot be started"
    if "vispeg-drawn" in done.stdout:
        return ""
    lines = [line.strip() for line in (done.stderr + "\n" + done.stdout).splitlines() if line.strip()]
    reasons = [line for line in lines if line.startswith("reason")]
    return reasons[-1][:160] if reasons else in_words("\n".join(lines)) or "it ended without a word"


def _headless() -> dict[str, str]:
    return {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
