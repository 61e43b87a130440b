"""A simulated robot whose time goes on only while the run loop waits: the loop, and nothing else, in no time."""

import numpy as np

from vispeg.interface.builder import Picture
from vispeg.trials.driver import Connected, Reading
from vispeg.trials.loop import Clock
from vispeg.trials.simulated import SimulatedRobot


class Lockstep(Clock):
    """Driver and clock at once; `late` is time that somebody took since it last waited, s."""

    def __init__(self, world: str, mode: str = "state", **settings):
        self.robot = SimulatedRobot(world, mode, settings)
        self.stopped, self.commands, self.late = 0, [], 0.0

    def now(self) -> float:
        return self.robot.time + self.late

    def wait(self, until: float) -> None:
        until = max(until, self.now())
        while self.robot.time < until - 1e-9:
            self.robot.tick()
        self.late = 0.0

    def connect(self, interface, seed):
        start = self.robot.begin(seed)
        file = self.robot.env.file
        return Connected(start=start, world={"name": file.name, "hash": file.hash})

    def read(self, cameras=()):
        told = {}
        for key, image in self.robot.pictures(cameras).items():
            told[key.partition("_")[2]] = Picture(depth=image) if image.ndim == 2 else Picture(rgb=image)
        return Reading(self.robot.time + 77.0, *(x.copy() for x in self.robot.reading().values()), told)

    def ended(self):
        return self.robot.over()

    def command(self, pose):
        self.commands.append(np.array(pose))
        self.robot.hold(pose)

    def stop(self):
        self.stopped += 1
        self.robot.rest()
        return self.robot.outcome()
