"""Find the OpenGL backend that MuJoCo can use on this machine, and test that it draws."""

from __future__ import annotations

import ctypes
import os
import sys
from dataclasses import dataclass

from vispeg.core.broken import run
from vispeg.core.errors import UserError

# MUJOCO_GL -> libraries that MuJoCo's binding loads at import, and the packages that provide them
LIBRARIES: dict[str, tuple[tuple[str, ...], str]] = {
    "egl": (("libEGL.so.1", "libOpenGL.so.0"), "libegl1 libopengl0 libgl1-mesa-dri"),
    "osmesa": (("libOSMesa.so.8",), "libosmesa6"),
    "glfw": ((), ""),
    "glx": ((), ""),
}
# values of MUJOCO_GL that name no backend
WITHOUT = ("disable", "disabled", "off", "false", "0", "enable", "enabled", "on", "true", "1")
APT_LINE = "sudo apt-get install -y libegl1 libopengl0 libgl1-mesa-dri"
# Runs in a separate process, because a driver may crash, and because MuJoCo reads MUJOCO_GL at import.
_PROBE = """
import os
import mujoco
xml = '<mujoco><worldbody><light pos="0 0 3"/><geom size=".2" rgba="1 0 0 1"/></worldbody></mujoco>'
model = mujoco.MjModel.from_xml_string(xml)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
renderer = mujoco.Renderer(model, 48, 64)
renderer.update_scene(data)
image = renderer.render()
if image.std() == 0:
    raise SystemExit("the picture is blank")
from OpenGL import GL
name = GL.glGetString(GL.GL_RENDERER).decode()
renderer.close()
print("\\n" + name, flush=True)
os._exit(0)  # ignore what OSMesa prints while Python ends
"""


@dataclass(frozen=True)
class Probe:
    """Whether a backend (`egl`, `osmesa`, `glfw`) draws, and the renderer's name or the reason why not."""

    backend: str
    ok: bool
    detail: str


def probe(backend: str, timeout: float = 60.0) -> Probe:
    """Render a small picture with a backend in another process, within `timeout` s."""
    return Probe(backend, *run([sys.executable, "-c", _PROBE], {**os.environ, "MUJOCO_GL": backend}, timeout))


def check_backend() -> None:
    """Refuse a MUJOCO_GL that is unknown or whose library is missing, because `import mujoco` would fail.

    Raises:
        UserError: the error names the choices, or how to get the library.
    """
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    if not chosen or not sys.platform.startswith("linux"):
        return
    if chosen not in (*LIBRARIES, *WITHOUT):
        raise UserError("no such renderer", key="MUJOCO_GL", got=chosen, choices=[*LIBRARIES])
    libraries, package = LIBRARIES.get(chosen, ((), ""))
    if missing := [name for name in libraries if not has_library(name)]:
        expected = f"sudo apt-get install -y {package}, or another MUJOCO_GL; see `vispeg doctor`"
        raise UserError(f"the library {missing[0]} is missing", key="MUJOCO_GL", got=chosen, expected=expected)


def choose_backend() -> None:
    """Set MUJOCO_GL=egl on a Linux machine without a display, if EGL exists and MUJOCO_GL is not set.

    Otherwise MuJoCo would look for a window system. If EGL is missing, nothing is set: `import mujoco` would fail with
    it, and without it everything but pictures works.
    """
    headless = sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    if headless and "MUJOCO_GL" not in os.environ and all(map(has_library, ("libEGL.so.1", "libOpenGL.so.0"))):
        os.environ["MUJOCO_GL"] = "egl"


def has_library(name: str) -> bool:
    """Return whether the system's loader finds a shared library."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True
