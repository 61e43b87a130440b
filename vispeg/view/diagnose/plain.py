"""Channels without a class of their own on the diagnosis page: their signal of each joint, measured and predicted."""

from __future__ import annotations

import numpy as np

from vispeg.api.inputs import Inputs
from vispeg.channels.channel import Channel, How
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.plain import PlainSearch
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.view.diagnose.standing import Field, Track
from vispeg.view.diagnose.subject import Say, Subject, over_time
from vispeg.view.diagnose.telling import track
from vispeg.worlds.world import World


class Plain(Subject):
    """Compare a channel's signal with the model's prediction; arguments other than `channel` as for `Joints`.

    Attributes:
        judged: the held-out recordings; the fitted ones if there is no `progress`, so no search.
    """

    shows = "Error of the predicted signal"

    def __init__(self, channel: Channel, inputs: Inputs, threads: int, say: Say, progress: Progress | None):
        recordings = inputs.fitted, inputs.held_out if progress is not None else ()
        evidence, judged = channel.evidence(inputs.world, recordings, How(seconds=0.0, threads=threads))
        self.judged = evidence if judged is None else judged
        self.search = None if judged is None else PlainSearch(evidence, judged, say, progress)
        self.unit, self.columns = self.judged.unit, self.joints
        self.units = (self.unit,) * len(self.columns)

    @property
    def floor(self) -> float:
        """RMS noise of the signal, in `unit`."""
        return self.judged.floor

    @property
    def body(self) -> RobotModel:
        """The arm."""
        return self.judged.items[0].robot

    def error(self, world: World) -> float:
        """Return the RMS error over all joints on the judged recordings, in `unit`."""
        return self.judged.errors([world])[0]

    def tracks(self, first: World, now: World) -> tuple[Track, ...]:
        """Return one track per compared segment of a judged recording."""
        before, after = self.judged.simulated([first]), self.judged.simulated([now])
        return tuple(track(i, a[0], b[0]) for i, a, b in zip(self.judged.items, before, after, strict=True))

    def maps(self, first: World, now: World) -> dict[str, Field]:
        """Return one map: the errors of all joints, as multiples of the noise, over time in the segment."""
        items, rows = self.judged.items, []
        for world in (first, now):
            predicted = zip(items, self.judged.simulated([world]), strict=True)
            scaled = [np.where(i.valid, self.judged.whiten(i, y[0]), np.nan)[:, : i.nj] for i, y in predicted]
            rows.append(np.concatenate(scaled))
        time = [item.segment.time for item in items]
        moment = np.concatenate([np.column_stack([np.full(len(t), float(k)), t]) for k, t in enumerate(time)])
        return {"time": over_time(rows[0], rows[1], moment)}

    def recorded(self, track: int) -> tuple[Recording, float]:
        """Return the recording of a track, given by its index, and the time (s) in it at which the track begins."""
        item = self.judged.items[track]
        return item.recording, float(item.recording.time[item.segment.rows[0]])
