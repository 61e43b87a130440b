"""Contact tasks: an arm under operational space control, a cell, a goal, and what may differ between worlds."""

from vispeg.task import peg as peg  # enrols its environments with gymnasium
