"""Contact tasks: an arm under operational space control, a cell, a goal, and what may differ between worlds.

Each task of the package is a subpackage here with a file `task.py`. Its `__init__` registers its environments with
gymnasium and defines `TASK`, its class as MODULE:CLASS, and `UNNAMED`: whether it is the task of worlds that name none.
"""

from importlib import import_module
from pathlib import Path
from types import ModuleType

ROOMS: dict[str, ModuleType] = {  # task's name -> its subpackage
    file.parent.name: import_module(f"{__name__}.{file.parent.name}")
    for file in sorted(Path(__file__).parent.glob("*/task.py"))
}
