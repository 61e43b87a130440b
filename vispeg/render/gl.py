"""An OpenGL context without a window, from whichever library this machine has."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

from vispeg.core.errors import UserError

ONE_THREAD = 256 * 256  # px
HINT = "sudo apt-get install -y libegl1 libopengl0 libgl1-mesa-dri; `vispeg doctor` tells more"


def offscreen(width: int, height: int) -> Any:
    """A context to draw `width` x `height` px in, not yet current; freed by its `free()`.

    MUJOCO_GL decides where it is set. Elsewhere on Linux without a display EGL is tried, then OSMesa; MuJoCo reads the
    variable when the first picture is drawn, so it is set here to what was found. Mesa's software driver hands tiles of
    64 x 64 px to threads, which only costs time in small pictures: LP_NUM_THREADS becomes 0 then, unless it is set.

    Raises:
        UserError: nothing here can draw.
    """
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    if width * height <= ONE_THREAD:
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
