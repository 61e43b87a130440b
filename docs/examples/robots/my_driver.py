"""A driver to fill in: `vispeg run POLICY --robot python:my_driver:Robot`, with this file on PYTHONPATH."""

import numpy as np

from vispeg.recordings.cell import WrenchSensor
from vispeg.trials.driver import Connected, Reading


class Robot:
    """An arm of seven joints with a wrist sensor."""

    def connect(self, interface, seed):
        """Hold the present pose: an episode begins."""
        return Connected(wrench=WrenchSensor(frame="flange", acts_on="flange", tared="weight"))  # or None

    def read(self, cameras=()):
        """Return the newest reading at once, with pictures of these cameras."""
        return Reading(time=0.0, q=np.zeros(7), dq=np.zeros(7), wrench=np.zeros(6), pictures={})

    def command(self, pose):
        """Hold the flange at (7,) m, w x y z in the base."""

    def stop(self):
        """Come to rest; return what the robot knows of the outcome, or None."""
