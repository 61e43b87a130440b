"""OpenGL contexts without a window, from whichever library this machine has."""

from __future__ import annotations

import atexit
import importlib
import os
import sys
import threading
from typing import Any

from vispeg.core.errors import UserError

HINT = "sudo apt-get install -y libegl1 libopengl0 libgl1-mesa-dri; `vispeg doctor` tells more"
_OPEN: dict[tuple[int, int], Any] = {}  # (process, thread) -> its context


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
