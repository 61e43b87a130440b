"""The pictures channel on the diagnosis page: distances of image edges from the predicted borders of parts."""

from __future__ import annotations

import numpy as np

from vispeg.api.inputs import Inputs
from vispeg.channels.pictures import border_evidence_of
from vispeg.diagnosis.pictures.borders import BorderSearch
from vispeg.diagnosis.progress import Progress
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.points import Item
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.view.diagnose.standing import Field, Track
from vispeg.view.diagnose.subject import Say, Subject, field, over_time
from vispeg.worlds.world import World


class Borders(Subject):
    """Compare the edges in recorded pictures with the borders of parts in the model; arguments as for `Joints`.

    Attributes:
        judged: the held-out pictures; the fitted ones if there is no `progress`, so no search.
    """

    unit, shows = "px", "Distance of edges from the borders that the model predicts"

    def __init__(self, inputs: Inputs, threads: int, say: Say, progress: Progress | None):
        say("aligning the predicted borders with the pictures")
        evidence, judged = border_evidence_of(
            inputs.world, inputs.fitted, inputs.held_out if progress else (), progress
        )
        self.judged: BorderEvidence = evidence if judged is None else judged
        self.search = None if judged is None else BorderSearch(evidence, judged, say, progress)
        self.columns = tuple(dict.fromkeys(i.sight.camera.name for i in self.judged.items))
        self.units = (self.unit,) * len(self.columns)

    @property
    def floor(self) -> float:
        """RMS measurement noise of an edge, px."""
        return self.judged.floor

    @property
    def body(self) -> Scene:
        """The robot in its cell."""
        return self.judged.scene

    def error(self, world: World) -> float:
        """Return the RMS distance of the judged edges from the borders that a world predicts, px."""
        return self.judged.errors([world])[0]

    def tracks(self, first: World, now: World) -> tuple[Track, ...]:
        """Return one track per recording and camera; its rows are the frames with borders, its values RMS edge errors.

        The errors, px, stand in the camera's column; other columns are NaN.
        """
        out = []
        misplaced = zip(self.judged.items, self.judged.misplaced(first), self.judged.misplaced(now), strict=True)
        for k, (item, before, after) in enumerate(misplaced):
            frames, time = np.unique(item.points.frame), self._time(k)
            errors = [self._placed(item, _per_frame(item, away, frames)) for away in (before, after)]
            name, camera = item.name, item.sight.camera.name
            posture = np.nan_to_num(item.sight.at(frames))
            track = Track(f"{name}, {camera}", time[frames], posture, None, *errors, cameras=(camera,))
            out.append(track)
        return tuple(out)

    def maps(self, first: World, now: World) -> dict[str, Field]:
        """Return the edge errors, as multiples of their noise, over time and by the nearer part at each border."""
        rows: list[list[np.ndarray]] = [[], [], [], []]
        misplaced = zip(self.judged.items, self.judged.misplaced(first), self.judged.misplaced(now), strict=True)
        for k, (item, before, after) in enumerate(misplaced):
            scaled = [np.where(item.valid[:, 0], away / item.sigma[0], np.nan) for away in (before, after)]
            time = self._time(k)[item.points.frame]
            moment = np.column_stack([np.full(len(time), float(k)), time])
            new = (*(self._placed(item, s) for s in scaled), moment, item.points.parts[:, 0])
            for column, values in zip(rows, new, strict=True):
                column.append(values)
        before, after, moment, part = (np.concatenate(r) for r in rows)
        names = ("nothing", *self.body.parts)
        present = np.unique(part)
        edges = np.arange(len(present) + 1, dtype=float)
        labels = tuple(names[int(p)] for p in present)
        return {
            "time": over_time(before, after, moment),
            "part": field(edges, np.searchsorted(present, part), before, after, moment, labels),
        }

    def recorded(self, track: int) -> tuple[Recording, float]:
        """Return the recording of a track, given by its index, and the time of its first sample, s: the track's 0."""
        rec = self.judged.items[track].sight.recording
        assert rec is not None, "frames of a recording"
        return rec, float(rec.time[0])

    def _time(self, track: int) -> np.ndarray:
        """Return the times of a track's frames, (nframe,) s from the first sample of its recording."""
        return self.judged.items[track].sight.time - self.recorded(track)[1]

    def _placed(self, item: Item, values: np.ndarray) -> np.ndarray:
        """Return (n, columns) with the values (n,) in the column of the item's camera and NaN elsewhere."""
        out = np.full((len(values), len(self.columns)), np.nan)
        out[:, self.columns.index(item.sight.camera.name)] = values
        return out


def _per_frame(item: Item, away: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return the RMS edge error of each of `frames`, (len(frames),) px, weighted by the trust in each edge.

    `away` (n,) px are the errors at the item's border points, NaN without an edge; a frame without edges gives 0.
    """
    good = np.isfinite(away)
    trust, at = np.where(good, item.trust, 0.0), np.searchsorted(frames, item.points.frame)
    square = np.bincount(at, trust * np.where(good, away, 0.0) ** 2, len(frames))
    return np.sqrt(square / np.maximum(np.bincount(at, trust, len(frames)), 1e-9))
