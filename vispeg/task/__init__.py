"""Contact tasks: an arm under operational space control, a cell, a goal, and what may differ between worlds.

A task of the package's own is a room here with a file `task.py`; its `__init__` enrols its environments with gymnasium
and says in `TASK` which class it is, as MODULE:CLASS, and in `UNNAMED` whether worlds that name no task are of it.
"""

from importlib import import_module
from pathlib import Path
from types import ModuleType

ROOMS: dict[str, ModuleType] = {
    file.parent.name: import_module(f"{__name__}.{file.parent.name}")
    for file in sorted(Path(__file__).parent.glob("*/task.py"))
}
