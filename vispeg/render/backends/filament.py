"""MuJoCo's physically based renderer, Filament, without a display: through Vulkan, on a CPU by Mesa's lavapipe.

Materials, lights and reflections are those of real-time PBR, so its pictures differ from OpenGL's as another camera's
do. Ids and normals come from rays through the same pixels. About ten times slower than OpenGL on a CPU. Colours carry
a dither of about one level that goes by the number of frames drawn; balls and cylinders are faceted more coarsely.
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
HEADLIGHT = 1.2e5  # lux of a headlight of full white: the nominal cell comes out as bright as in OpenGL
# The library ends the process where there is no driver, so another process tries first.
_TRY = "import mujoco.studio; from mujoco import mjrf; mjrf.Context(mjrf.ContextConfig()); print('vispeg-drawn')"


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the library's own log, which it writes past Python, from standard output and error while it works.

    It tells of its inner state ("EBR Stall Warning: Component Manager ..."), which no user can change, on every command
    and into what a program may parse.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    kept, nowhere = [os.dup(1), os.dup(2)], os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in (1, 2):
            os.dup2(nowhere, stream)
        yield
    finally:
        for stream, at in zip((1, 2), kept, strict=True):
            os.dup2(at, stream)
        for descriptor in (*kept, nowhere):
            os.close(descriptor)


class Filament:
    """Draws with Filament; arguments as for `Classic`. Edited textures and materials are taken over by `upload`."""

    name = "filament"

    def __init__(self, model: mujoco.MjModel, width: int = 0, height: int = 0, shadows: bool = False):
        if reason := unusable():
            raise UserError(f"no physically based pictures here: {reason}", expected=HINT)
        import mujoco.studio  # noqa: F401 - first, or the module beneath finds no library
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
        self._parts: tuple[Any, Any, Any, Any] | None = None
        self._drawn = b""
        self.remembers = False

    @_quiet()
    def draw(self, data: mujoco.MjData, views: Sequence[View], ids: bool) -> list[Picture]:
        """One picture a view, in order; `data` has its kinematics and lights done."""
        scene, lights, things = self._prepare()
        self.remembers = True  # the dither of its colours goes by the number of frames drawn
        groups = self.model.geom_group.copy()
        self.model.geom_group[~is_visible(self.model)] = HIDDEN
        try:
            lights.update(data)
            things.update(data)
            return [self._one(scene, data, view, ids) for view in views]
        finally:
            self.model.geom_group[:] = groups

    def upload(self, texture: int) -> None:
        """Take over edited textures at the next picture."""
        self._parts = None

    @_quiet()
    def close(self) -> None:
        """Frees the scene, then the context."""
        self._parts, self._targets, self._context = None, {}, None

    def _prepare(self) -> tuple[Any, Any, Any]:
        """Scene, lights and things, built anew where materials, textures or shapes changed: they are read only then."""
        m = self.model
        fields = (m.mat_rgba, m.mat_texid, m.mat_texrepeat, m.mat_roughness, m.mat_metallic, m.mat_specular)
        fields += (m.mat_shininess, m.geom_rgba, m.geom_matid, m.geom_size, m.light_castshadow, m.light_active)
        state = b"".join(array.tobytes() for array in fields)
        if self._parts is not None and state == self._drawn:
            return self._parts[:3]
        mjrf, self._parts = self._mjrf, None
        scene = self._context.create_scene(mjrf.SceneParams())
        scene.configure_from_model(m)
        resources = mjrf.ModelResources(self._context, m)
        things = mjrf.ModelRenderables(scene, resources)
        things.set_options(self._option)
        self._parts, self._drawn = (scene, mjrf.ModelLights(scene, resources), things, resources), state
        return self._parts[:3]

    def _one(self, scene: Any, data: mujoco.MjData, view: View, ids: bool) -> Picture:
        height, width = view.camera.height, view.camera.width
        rgb, buffer = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        for out, depth in ((rgb, False), (buffer, True)):  # the library takes one read a render
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
        frustum = view.frustum()
        request.scene, request.target = scene, target
        request.camera = mjrf.Camera(**{**frustum, "orthographic": False})
        request.viewport.left = request.viewport.bottom = 0
        request.viewport.width, request.viewport.height = view.camera.width, view.camera.height
        request.draw_mode = getattr(mjrf.DrawMode, "DRAW_MODE_DEPTH" if depth else "DRAW_MODE_DEFAULT")
        request.shadows, request.reflections, request.haze = self.shadows, False, False
        head = self.model.vis.headlight
        request.headlight = bool(head.active) and not (self.model.light_intensity > 0).any()  # photometric lights rule
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
    """Why Filament cannot draw here, or nothing where it can; tried once, in another process (about a second)."""
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
