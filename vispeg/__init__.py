"""Finds what a robot model is missing, and trains peg insertion that transfers.

The names in `__all__` are the public face. Each is imported when it is first used, so that `import vispeg` is quick.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vispeg import effects
    from vispeg.api.compare import compare
    from vispeg.api.diagnose import diagnose
    from vispeg.api.fit import fit
    from vispeg.api.inputs import load_recording
    from vispeg.task.world_file import load_world
    from vispeg.worlds.world import World

__version__ = "0.1.0"
__all__ = ["World", "compare", "diagnose", "effects", "fit", "load_recording", "load_world"]

LIBRARY = ("vispeg.effects",)  # rooms that enrol effects, see vispeg.core.registry
_PLACES = {
    "World": "vispeg.worlds.world",
    "compare": "vispeg.api.compare",
    "diagnose": "vispeg.api.diagnose",
    "fit": "vispeg.api.fit",
    "load_recording": "vispeg.api.inputs",
    "load_world": "vispeg.task.world_file",
}


def __getattr__(name: str) -> object:
    """A name of the public face, on its first use."""
    if name == "effects":
        return import_module("vispeg.effects")
    if name not in _PLACES:
        raise AttributeError(f"module 'vispeg' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_PLACES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if "gymnasium" in sys.modules:  # `gymnasium.make("vispeg:PegInHole-v0")` imports this and looks in its own registry
    import_module("vispeg.task")  # enrols the task; otherwise left to whoever needs it, as it takes time
