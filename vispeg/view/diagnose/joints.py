"""Joints: angles in closed loop, or torques by inverse dynamics."""

from __future__ import annotations

from vispeg.api.inputs import Inputs
from vispeg.diagnosis.beginning import Beginning, of_joints
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.identify.inverse import evidence_for
from vispeg.identify.loops.soft import near
from vispeg.view.diagnose.plain import Plain
from vispeg.view.diagnose.standing import Field
from vispeg.view.diagnose.subject import Say
from vispeg.view.diagnose.telling import maps
from vispeg.worlds.world import World


class Joints(Plain):
    """Recordings of joints.

    Args:
        inputs: model and recordings.
        threads: of the simulation.
        say: called with a line on each step.
        progress: of the search; None where there is nothing to judge on.
    """

    shows = "Torque that the model lacks"

    def __init__(self, inputs: Inputs, threads: int, say: Say, progress: Progress | None):
        self.recordings = (*inputs.fitted, *inputs.held_out)
        judging = inputs.fitted if progress is None else inputs.held_out
        self.judged = near(evidence_for(inputs.world, judging, threads, h_max=1e-3), inputs.world)
        self.search = None
        if progress is not None:
            evidence = near(evidence_for(inputs.world, inputs.fitted, threads), inputs.world)
            self.search = Search(evidence, Judge(self.judged), say, progress)
        self.unit, self.columns = self.judged.unit, self.joints
        self.units = (self.unit,) * len(self.columns)

    def begin(self, world: World) -> Beginning:
        """With the steps of encoders; partial effects are fitted anew."""
        return of_joints(world, self.recordings, self.unit)

    def maps(self, first: World, now: World) -> dict[str, Field]:
        """Missing torque over speed, load, position, phase, time."""
        return maps(self.judged, self.judged.simulated([first]), self.judged.simulated([now]))
