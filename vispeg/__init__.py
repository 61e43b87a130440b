"""Finds what a robot model is missing, and trains policies that transfer.

The names in `__all__` are the public face. Each is imported when it is first used, so that `import vispeg` is quick.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vispeg import effects as effects
    from vispeg.api.calibrate import calibrate as calibrate
    from vispeg.api.compare import compare as compare
    from vispeg.api.datasets import render_dataset as render_dataset
    from vispeg.api.diagnose import diagnose as diagnose
    from vispeg.api.environments import make as make
    from vispeg.api.environments import make_vec as make_vec
    from vispeg.api.evaluate import evaluate as evaluate
    from vispeg.api.films import play as play
    from vispeg.api.fit import fit as fit
    from vispeg.api.gap import gap as gap
    from vispeg.api.inputs import load_recording as load_recording
    from vispeg.api.opened import load as load
    from vispeg.api.policies import load_policy as load_policy
    from vispeg.api.recording.check import check as check
    from vispeg.api.recording.convert import convert as convert
    from vispeg.api.recording.record import record as record
    from vispeg.api.train import train as train
    from vispeg.core.errors import UserError as UserError
    from vispeg.task.world_file import load_world as load_world
    from vispeg.worlds.world import World as World

__version__ = "0.1.0"

_PLACES = {
    "UserError": "vispeg.core.errors",
    "World": "vispeg.worlds.world",
    "calibrate": "vispeg.api.calibrate",
    "check": "vispeg.api.recording.check",
    "compare": "vispeg.api.compare",
    "convert": "vispeg.api.recording.convert",
    "diagnose": "vispeg.api.diagnose",
    "evaluate": "vispeg.api.evaluate",
    "fit": "vispeg.api.fit",
    "gap": "vispeg.api.gap",
    "load": "vispeg.api.opened",
    "load_policy": "vispeg.api.policies",
    "load_recording": "vispeg.api.inputs",
    "load_world": "vispeg.task.world_file",
    "make": "vispeg.api.environments",
    "make_vec": "vispeg.api.environments",
    "play": "vispeg.api.films",
    "record": "vispeg.api.recording.record",
    "render_dataset": "vispeg.api.datasets",
    "train": "vispeg.api.train",
}
if not TYPE_CHECKING:  # type checkers, which cannot read it, take the imports `as` the same name for the public ones
    __all__ = ["effects", *_PLACES]


def __getattr__(name: str) -> object:
    """Return a name of the public face, on its first use."""
    if name == "effects":
        return import_module("vispeg.effects")
    if name not in _PLACES:
        raise AttributeError(f"module 'vispeg' has no attribute {name!r}")
    if "mujoco" not in sys.modules and not _PLACES[name].startswith("vispeg.core."):
        import_module("vispeg.api.machine.graphics").check_backend()  # what `import mujoco` dies of is one line
    value = globals()[name] = getattr(import_module(_PLACES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), "effects", *_PLACES})


if "gymnasium" in sys.modules:  # `gymnasium.make("vispeg:NAME")` imports this and looks in its own registry
    import_module("vispeg.task")  # enrols the tasks; otherwise left to whoever needs it, as it takes time
