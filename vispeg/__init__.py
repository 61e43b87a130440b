"""Finds what a robot model is missing, and trains peg insertion that transfers."""

import importlib
import sys

__version__ = "0.1.0"

if "gymnasium" in sys.modules:  # `gymnasium.make("vispeg:PegInHole-v0")` imports this and looks in its own registry
    importlib.import_module("vispeg.task")  # enrols the task; otherwise left to whoever needs it, as it takes time
