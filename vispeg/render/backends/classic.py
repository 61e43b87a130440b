"""MuJoCo's OpenGL renderer, without what makes it slow by default.

One render gives colour and depth. No multisampling, no reflections, no haze; shadows only where asked, on a small map;
what a camera cannot see is not sent to the driver (unless it may cast a shadow into the picture).
"""

from __future__ import annotations

import atexit
import importlib
import os
import sys
import threading
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.render.backends.picture import HIDDEN, Picture, is_visible
from vispeg.render.cameras.view import View, planar

SHADOW_MAP = 512  # px
LARGEST_CASTER = 0.5  # m: tables, walls and floors catch shadows, and would cost most as casters
SLICES = 40  # of a drawn cylinder or sphere: its facets then lie within 0.025 mm of an 8 mm part's surface
ZERO_FAR = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value
OFFSCREEN = mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value
R, V = mujoco.mjtRndFlag, mujoco.mjtVisFlag
HINT = "sudo apt-get install -y libegl1 libopengl0 libgl1-mesa-dri; `vispeg doctor` tells more"
_OPEN: dict[tuple[int, int], Any] = {}  # (process, thread) -> its context


class Classic:
    """Draws with OpenGL. Every call makes its context current first, so that several, and other programs', take turns.

    Args:
        model: what is drawn, the caller's to spare: its quality settings are changed, its visual fields may be.
        width, height: of the largest picture, px.
        shadows: whether lights with `light_castshadow` cast them.
    """

    name = "classic"
    remembers = False

    def __init__(self, model: mujoco.MjModel, width: int, height: int, shadows: bool):
        self.model, self.shadows = model, shadows
        self._gl: Any = shared(width, height)
        self._gl.make_current()
        quality, size = model.vis.quality, model.vis.global_
        quality.offsamples, quality.shadowsize, quality.numslices = 0, SHADOW_MAP if shadows else 0, SLICES
        size.offwidth, size.offheight = width, height
        try:
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
        except mujoco.FatalError as error:
            raise UserError(f"OpenGL cannot draw {width} x {height} px here", got=str(error)) from error
        mujoco.mjr_setBuffer(OFFSCREEN, self._context)
        self._context.readDepthMap = ZERO_FAR  # pyright: ignore[reportAttributeAccessIssue]
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 16)
        self._option, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_USER.value
        self._option.flags[:] = 0
        self._option.flags[[V.mjVIS_STATIC.value, V.mjVIS_TEXTURE.value, V.mjVIS_SKIN.value]] = 1
        self._option.sitegroup[:] = 0
        self._option.geomgroup[:] = 1
        self._option.geomgroup[HIDDEN] = 0
        self._scene.flags[:] = 0
        self._scene.flags[[R.mjRND_SKYBOX.value, R.mjRND_CULL_FACE.value]] = 1
        self._scene.flags[R.mjRND_SHADOW.value] = shadows

    def draw(self, data: mujoco.MjData, views: Sequence[View], ids: bool) -> list[Picture]:
        """One picture a view, in order; `data` has its kinematics and lights done."""
        self._gl.make_current()
        mujoco.mjr_setBuffer(OFFSCREEN, self._context)  # another renderer's framebuffer may be bound
        groups = self.model.geom_group.copy()
        lit = self.shadows and bool((self.model.light_castshadow & self.model.light_active).any())
        show = is_visible(self.model)
        try:
            return [self._one(data, view, show, lit, ids) for view in views]
        finally:
            self.model.geom_group[:] = groups

    def upload(self, texture: int) -> None:
        """Hands a texture's changed pixels to the driver."""
        self._gl.make_current()
        mujoco.mjr_uploadTexture(self.model, self._context, texture)

    def close(self) -> None:
        """Frees driver memory; further calls do nothing."""
        if self._gl is not None:
            self._gl.make_current()
            self._context.free()
            self._gl = None

    def _one(self, data: mujoco.MjData, view: View, show: np.ndarray, lit: bool, ids: bool) -> Picture:
        model = self.model
        visible = show if lit else show & view.in_sight(data.geom_xpos, model.geom_rbound)
        model.geom_group[:] = np.where(visible, 0, HIDDEN)
        frustum = view.frustum()
        for camera in self._scene.camera:  # one an eye; both alike
            for key, value in frustum.items():
                setattr(camera, key, value)
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, data, self._option, None, self._camera, every, self._scene)
        if lit:
            for geom in self._scene.geoms[: self._scene.ngeom]:
                if not 0 < model.geom_rbound[geom.objid] <= LARGEST_CASTER:
                    geom.category = mujoco.mjtCatBit.mjCAT_DECOR.value  # drawn and shaded, but casting none
        height, width = view.camera.height, view.camera.width
        rect = mujoco.MjrRect(0, 0, width, height)
        rgb, buffer = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(rgb, buffer, rect, self._context)
        geom_ids = self._ids(rect, width, height) if ids else None
        return Picture(np.ascontiguousarray(rgb[::-1]), planar(buffer[::-1]), geom_ids)

    def _ids(self, rect: mujoco.MjrRect, width: int, height: int) -> np.ndarray:
        """(H, W) int32 geom ids, -1 where there is none: a second render, each geom in a flat colour of its own."""
        flags, coded = self._scene.flags.copy(), np.empty((height, width, 3), np.uint8)
        self._scene.flags[[R.mjRND_SEGMENT.value, R.mjRND_IDCOLOR.value]] = 1
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(coded, None, rect, self._context)
        self._scene.flags[:] = flags
        table = np.full(self._scene.ngeom + 1, -1, np.int32)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM.value:
                table[geom.segid + 1] = geom.objid
        code = coded[::-1].astype(np.int32) @ np.array([1, 256, 65536], np.int32)
        return table[np.minimum(code, len(table) - 1)]


def shared(width: int, height: int) -> Any:
    """Give this thread's context, not yet current; opened at the first call and kept until the process ends.

    Renderers share it, each with framebuffers and textures of its own: a driver compiles its shaders once a context,
    which takes far longer than anything else about a renderer. A thread has its own, since a context can be current in
    one thread only; so a renderer is used in the thread that made it.

    Args:
        width, height: of the largest picture, px.

    Raises:
        UserError: nothing here can draw.
    """
    key = os.getpid(), threading.get_ident()
    if key not in _OPEN:
        _OPEN[key] = _open(width, height)
        atexit.register(_OPEN[key].free)  # while Python is whole, and before the library ends
    return _OPEN[key]


def _open(width: int, height: int) -> Any:
    """Give a context from the library that MUJOCO_GL names; else, on Linux without a display, from EGL or OSMesa.

    MuJoCo reads the variable when the first picture is drawn, so it is set here to what was found.

    LP_NUM_THREADS becomes 0 unless it is set: Mesa's software driver then draws in this thread. With threads of its own
    it writes to fences that were freed already (Mesa 22.3.6: 4 zero bytes where a freed 112-byte block's mutex was),
    which ends a process once in five to forty minutes of drawing; in small pictures they only cost time, too.
    """
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    os.environ.setdefault("LP_NUM_THREADS", "0")
    headless = sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    names = [chosen] if chosen else (["egl", "osmesa"] if headless else ["glfw"])
    reasons = []
    for name in names:
        if name in ("disable", "disabled", "off", "false", "0"):
            reasons.append(f"MUJOCO_GL={name}")
            continue
        try:
            context = _class(name)(width, height)
        except Exception as error:  # PyOpenGL and drivers raise what they like, ImportError to AttributeError
            reasons.append(f"{name}: {' '.join(str(error).split())[:100] or type(error).__name__}")
            continue
        os.environ.setdefault("MUJOCO_GL", name)
        return context
    raise UserError(f"no OpenGL here ({'; '.join(reasons)})", expected=HINT)


def _class(name: str) -> Any:
    if name in ("egl", "osmesa"):
        return importlib.import_module(f"mujoco.{name}").GLContext
    return importlib.import_module("mujoco").GLContext
