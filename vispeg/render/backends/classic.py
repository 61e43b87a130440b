"""MuJoCo's OpenGL renderer, without its slow defaults.

One render gives colour and depth. There is no multisampling, no reflection and no haze. Shadows are drawn only on
request, with a small shadow map. What cannot be seen is not sent to the driver: geoms outside the view, unless they
may cast a shadow into it, and the sky where geoms fill the picture.
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
from vispeg.render.backends.picture import COLLISION, HIDDEN, Picture, alphas
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.view import View, planar

SHADOW_MAP = 512  # px
LARGEST_CASTER = 0.5  # m, radius: tables, walls and floors receive shadows but cast none, to save time
SLICES = 40  # facets around a cylinder or sphere; they are within 0.025 mm of the surface of an 8 mm part
ZERO_FAR = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value
OFFSCREEN = mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value
R, V = mujoco.mjtRndFlag, mujoco.mjtVisFlag
SKY = R.mjRND_SKYBOX.value
ALL, DECOR = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.mjtCatBit.mjCAT_DECOR.value
HINT = "sudo apt-get install -y libegl1 libopengl0 libgl1-mesa-dri; `vispeg doctor` tells more"
_OPEN: dict[tuple[int, int], Any] = {}  # OpenGL context by (process, thread)


class Classic:
    """The OpenGL backend. Every call first makes its context current, so that it works beside other users of OpenGL.

    Args:
        model: the model to render. Its quality settings are changed here; the caller may edit its visual fields.
        width, height: size of the largest image, px.
        shadows: whether lights with `light_castshadow` cast shadows.

    Raises:
        UserError: OpenGL does not work here, or not in this size.
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
        self._context.readDepthMap = ZERO_FAR
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 16)
        self._option, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_USER.value
        self._option.flags[:] = 0
        self._option.flags[[V.mjVIS_STATIC.value, V.mjVIS_TEXTURE.value, V.mjVIS_SKIN.value]] = 1
        self._option.sitegroup[:] = 0
        self._option.geomgroup[:] = 1
        self._option.geomgroup[HIDDEN] = 0
        self._flags = self._scene.flags
        self._flags[:] = 0
        self._flags[R.mjRND_CULL_FACE.value] = 1
        self._flags[R.mjRND_SHADOW.value] = shadows
        # one per eye of a stereo display; both get the same view
        self._eyes = [(eye, eye.pos, eye.forward, eye.up) for eye in self._scene.camera]
        self._lens: Camera | None = None  # whose optics the eyes have
        self._filled: set[int] = set()  # places in the list of views in which geoms filled the last picture

    def draw(self, data: mujoco.MjData, views: Sequence[View], ids: bool) -> list[Picture]:
        """Return one picture per view, in order; the kinematics and lights of `data` must be computed."""
        self._gl.make_current()
        mujoco.mjr_setBuffer(OFFSCREEN, self._context)  # in case another renderer's framebuffer is bound
        model = self.model
        groups = model.geom_group.copy()
        lit = self.shadows and bool((model.light_castshadow & model.light_active).any())
        alpha, radii = alphas(model), model.geom_rbound
        show = (groups < COLLISION) & (alpha > 0)
        opaque = not model.nskin and not bool((show & (alpha < 1)).any())
        casts = (radii > 0) & (radii <= LARGEST_CASTER)
        pictures = []
        try:
            for k, view in enumerate(views):
                visible = view.in_sight(data.geom_xpos, radii)
                if lit:
                    visible |= casts
                visible &= show
                model.geom_group[:] = np.where(visible, 0, HIDDEN)
                self._look(data, view)
                if lit:
                    for geom in self._scene.geoms[: self._scene.ngeom]:
                        if not casts[geom.objid]:
                            geom.category = DECOR  # this category is drawn but casts no shadow
                pictures.append(self._picture(k, view.camera, opaque, ids))
        finally:
            model.geom_group[:] = groups
        return pictures

    def upload(self, texture: int) -> None:
        """Upload a texture's changed pixels to the driver."""
        self._gl.make_current()
        mujoco.mjr_uploadTexture(self.model, self._context, texture)

    def close(self) -> None:
        """Free driver memory; a second call does nothing."""
        if self._gl is not None:
            self._gl.make_current()
            self._context.free()
            self._gl = None

    def _look(self, data: mujoco.MjData, view: View) -> None:
        """Put the geoms that are not hidden, the lights and a view into the scene."""
        for eye, pos, forward, up in self._eyes:
            pos[:], forward[:], up[:] = view.pos, view.rot[:, 2], -view.rot[:, 1]
            if view.camera is not self._lens:
                for key, value in view.optics.items():
                    setattr(eye, key, value)
        self._lens = view.camera
        mujoco.mjv_updateScene(self.model, data, self._option, None, self._camera, ALL, self._scene)

    def _picture(self, k: int, camera: Camera, opaque: bool, ids: bool) -> Picture:
        """Draw the scene as view number `k`.

        Opaque geoms that filled the last picture usually fill the next. It is then drawn without the sky first, and
        again with it if there is a gap after all, so that the picture does not depend on those before it.
        """
        height, width = camera.height, camera.width
        rect = mujoco.MjrRect(0, 0, width, height)
        rgb, buffer = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        for sky in (False, True) if opaque and k in self._filled else (True,):
            self._flags[SKY] = sky
            mujoco.mjr_render(rect, self._scene, self._context)
            mujoco.mjr_readPixels(rgb, buffer, rect, self._context)
            depth = planar(buffer[::-1])
            if depth.min() > 0:
                self._filled.add(k)
                break
            self._filled.discard(k)
        geom_ids = self._ids(rect, width, height) if ids else None
        return Picture(np.ascontiguousarray(rgb[::-1]), depth, geom_ids)

    def _ids(self, rect: mujoco.MjrRect, width: int, height: int) -> np.ndarray:
        """Return the geom ids (H, W) int32, -1 for none, from a second render with one flat colour per geom."""
        flags, coded = self._flags.copy(), np.empty((height, width, 3), np.uint8)
        self._flags[[R.mjRND_SEGMENT.value, R.mjRND_IDCOLOR.value]] = 1
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(coded, None, rect, self._context)
        self._flags[:] = flags
        table = np.full(self._scene.ngeom + 1, -1, np.int32)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM.value:
                table[geom.segid + 1] = geom.objid
        code = coded[::-1].astype(np.int32) @ np.array([1, 256, 65536], np.int32)
        return table[np.minimum(code, len(table) - 1)]


def shared(width: int, height: int) -> Any:
    """Return this thread's OpenGL context; it is opened at the first call and kept until the process ends.

    All renderers of a thread share the context, each with its own framebuffers and textures. A driver compiles its
    shaders once per context, which is by far the slowest step of opening a renderer. Each thread has its own context,
    since a context can be current in one thread only. A renderer must therefore be used in the thread that made it.
    The caller makes the context current.

    Args:
        width, height: size of the largest image, px; used at the first call only.

    Raises:
        UserError: no OpenGL library works here.
    """
    key = os.getpid(), threading.get_ident()
    if key not in _OPEN:
        _OPEN[key] = _open(width, height)
        atexit.register(_OPEN[key].free)  # runs while Python and the OpenGL library are still loaded
    return _OPEN[key]


def _open(width: int, height: int) -> Any:
    """Open an OpenGL context.

    The library is the one that MUJOCO_GL names. If it is not set, EGL and then OSMesa are tried on Linux without a
    display, and GLFW otherwise. MuJoCo reads the variable when the first image is rendered, so it is set here to the
    library that worked.

    LP_NUM_THREADS is set to 0 unless it is set already: Mesa's software driver then draws in the calling thread. Its
    own threads write to fences that were freed already (Mesa 22.3.6: 4 zero bytes in the place of the mutex of a freed
    112-byte block), which crashes a process every five to forty minutes of drawing. For small images these threads
    save no time either.
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
        except Exception as error:  # PyOpenGL and drivers raise all kinds of errors, from ImportError to AttributeError
            reasons.append(f"{name}: {' '.join(str(error).split())[:100] or type(error).__name__}")
            continue
        os.environ.setdefault("MUJOCO_GL", name)
        return context
    raise UserError(f"no OpenGL here ({'; '.join(reasons)})", expected=HINT)


def _class(name: str) -> Any:
    if name in ("egl", "osmesa"):
        return importlib.import_module(f"mujoco.{name}").GLContext
    return importlib.import_module("mujoco").GLContext
