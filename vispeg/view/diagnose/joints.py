"""Joints: angles in closed loop, or torques by inverse dynamics."""

from __future__ import annotations

from vispeg.api.inputs import Inputs
from vispeg.diagnosis.beginning import Beginning, of_joints
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.identify.inverse import evidence_for
from vispeg.identify.loops.soft import near
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.view.diagnose.standing import Field, Track
from vispeg.view.diagnose.subject import Say, Subject
from vispeg.view.diagnose.telling import maps, track
from vispeg.worlds.world import World


class Joints(Subject):
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

    @property
    def floor(self) -> float:
        """RMS of the sensor noise."""
        return self.judged.floor

    @property
    def body(self) -> RobotModel:
        """The arm."""
        return self.judged.items[0].robot

    def begin(self, world: World) -> Beginning:
        """With the steps of encoders; partial effects are fitted anew."""
        return of_joints(world, self.recordings, self.unit)

    def error(self, world: World) -> float:
        """RMS over joints."""
        return self.judged.angle_rms(self.judged.residuals([world])[0])

    def tracks(self, first: World, now: World) -> tuple[Track, ...]:
        """Give a track a segment."""
        before, after = self.judged.simulated([first]), self.judged.simulated([now])
        return tuple(track(i, a[0], b[0]) for i, a, b in zip(self.judged.items, before, after, strict=True))

    def maps(self, first: World, now: World) -> dict[str, Field]:
        """Missing torque over speed, load, position, phase, time."""
        return maps(self.judged, self.judged.simulated([first]), self.judged.simulated([now]))

    def recorded(self, track: int) -> tuple[Recording, float]:
        """Give a segment's recording and start."""
        item = self.judged.items[track]
        return item.recording, float(item.recording.time[item.segment.rows[0]])
