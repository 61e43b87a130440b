"""The contact channel: the wrench at the wrist that keeps the hand on its measured path."""

from __future__ import annotations

import numpy as np

from vispeg.api.inputs import Inputs
from vispeg.contact.phases import NAMES
from vispeg.contact.record import COLUMNS
from vispeg.contact.run import begun, evidence_of, unsearched
from vispeg.contact.selection.search import ContactSearch
from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.beginning import Beginning
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.judge import Judge
from vispeg.recordings.differentiate import bridged
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.view.diagnose.standing import Field, Track
from vispeg.view.diagnose.subject import Say, Subject, field, over_time
from vispeg.worlds.world import World


class Contact(Subject):
    """Compare recorded wrenches with the model of a robot in its cell; arguments as for `Joints`."""

    columns, units, unit = COLUMNS, ("N",) * 3 + ("N m",) * 3, "N"
    shows = "Force and torque at the wrist that the model misses"

    def __init__(self, inputs: Inputs, threads: int, say: Say, progress: Progress | None):
        self.both, self.threads = (inputs.fitted, inputs.held_out), threads
        self.judged, self.search = evidence_of(inputs.fitted if progress is None else inputs.held_out, threads), None
        if progress is not None:
            self.search = ContactSearch(evidence_of(inputs.fitted, threads), Judge(self.judged), say, progress)

    @property
    def floor(self) -> float:
        """RMS noise of the force, N."""
        return self.judged.floor

    @property
    def body(self) -> Scene:
        """The robot in its cell."""
        return self.judged.items[0].source.scene

    def begin(self, world: World) -> Beginning:
        """Return the model with its partial effects freed, so that the search fits them again."""
        return begun(world)

    def unsearched(self, first: World, now: World) -> tuple[EffectInstance, ...]:
        """Return the excess noise of the wrench, and the damping that impacts show."""
        assert isinstance(self.search, ContactSearch)
        return unsearched(first, now, self.search.evidence, self.judged, self.both, self.threads).effects

    def error(self, world: World) -> float:
        """Return the RMS error of the force on the judged recordings, N."""
        return self.judged.errors([world])[0]

    def tracks(self, first: World, now: World) -> tuple[Track, ...]:
        """Return one track per episode, with one row per block of time."""
        out = []
        for item, before, after in zip(self.judged.items, *self._predicted(first, now), strict=True):
            rec = item.recording
            posture = np.nan_to_num(bridged(rec.time, rec.q, rec.episode)[item.segment.rows])
            values = [np.where(item.valid, v, np.nan) for v in (item.measured, before, after)]
            cameras = () if rec.frames is None else tuple(rec.frames.names)
            out.append(Track(item.name, item.segment.time, posture, *values, cameras=cameras))
        return tuple(out)

    def maps(self, first: World, now: World) -> dict[str, Field]:
        """Return the errors, as multiples of the noise, by phase of contact and over time."""
        items = self.judged.items

        def white(predicted: list[np.ndarray]) -> np.ndarray:
            rows = zip(items, predicted, strict=True)
            return np.concatenate([np.where(i.valid, self.judged.whiten(i, y), np.nan) for i, y in rows])

        moment = np.concatenate([_moments(k, item.segment.time) for k, item in enumerate(items)])
        before, after = map(white, self._predicted(first, now))
        code = np.concatenate([item.phase.code for item in items])
        edges = np.arange(len(NAMES) + 1, dtype=float)
        return {
            "contact": field(edges, code, before, after, moment, NAMES),
            "time": over_time(before, after, moment),
        }

    def recorded(self, track: int) -> tuple[Recording, float]:
        """Return a track's recording, and the recording's time (s) at the track's zero."""
        item = self.judged.items[track]
        return item.recording, float(item.recording.time[item.segment.rows[0]] - item.segment.time[0])

    def _predicted(self, first: World, now: World) -> tuple[list[np.ndarray], list[np.ndarray]]:
        before, after = self.judged.simulated([first]), self.judged.simulated([now])
        return [y[0] for y in before], [y[0] for y in after]


def _moments(track: int, time: np.ndarray) -> np.ndarray:
    return np.column_stack([np.full(len(time), float(track)), time])
