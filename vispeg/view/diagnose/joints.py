"""The joints channel: angles simulated in closed loop, or torques computed by inverse dynamics."""

from __future__ import annotations

from functools import cache

from vispeg.api.inputs import Inputs
from vispeg.diagnosis.beginning import Beginning, of_joints
from vispeg.diagnosis.evidence.roles import sides
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.proposal import placed, propose
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.identify.inverse import evidence_for
from vispeg.identify.loops.soft import without_drift
from vispeg.view.diagnose.plain import Plain
from vispeg.view.diagnose.standing import Field
from vispeg.view.diagnose.subject import Say
from vispeg.view.diagnose.telling import maps
from vispeg.worlds.world import World


class Joints(Plain):
    """Compare recorded joint angles or torques with the model.

    Args:
        inputs: the model and the recordings.
        threads: number of threads for the simulation.
        say: called with a line of text at each step.
        progress: saved progress of the search; None without recordings to judge on, so without a search.
    """

    shows = "Torque that the model lacks"

    def __init__(self, inputs: Inputs, threads: int, say: Say, progress: Progress | None):
        self.recordings, self.search = (*inputs.fitted, *inputs.held_out), None
        if progress is None:
            self.judged = without_drift(evidence_for(inputs.fitted, threads, beside=self.recordings), inputs.world)
        else:  # as `vispeg diagnose` does
            parts = sides(inputs.world, inputs.fitted, inputs.held_out, threads)
            if parts.roles is not None:
                say(parts.roles.note)
            self.recordings, self.judged = (*parts.fitted, *parts.held_out), parts.judged
            # computed once, at the first step
            proposed = cache(lambda: placed(propose(inputs.world, parts.fitted, parts.held_out)))
            self.search = Search(parts.evidence, Judge(parts.judged), say, parts.part(progress), proposed)
        self.unit, self.columns = self.judged.unit, self.joints
        self.units = (self.unit,) * len(self.columns)

    def begin(self, world: World) -> Beginning:
        """Return the model with encoder resolutions read from the recordings; effects marked partial are refitted."""
        return of_joints(world, self.recordings, self.unit)

    def maps(self, first: World, now: World) -> dict[str, Field]:
        """Return the missing torque over speed, load, position, phase and time."""
        return maps(self.judged, self.judged.simulated([first]), self.judged.simulated([now]))
