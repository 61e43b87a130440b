"""A diagnosis driven by hand, in a worker process: compare, screen, fit one effect or let the search go on, take back.

It answers from, and adds to, the progress that `vispeg diagnose` keeps beside its result, and writes down what was
done; a killed one does it again in a moment, and the command goes on from there.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from vispeg.api.compare import compared_pictures
from vispeg.api.diagnose import diagnose, progress_of
from vispeg.api.inputs import Inputs, read_inputs
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.diagnosis.judge import Judge
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.screen import Score
from vispeg.diagnosis.search import Search
from vispeg.diagnosis.state import State, Trial
from vispeg.identify.inverse import evidence_for
from vispeg.recordings.windows import SECONDS
from vispeg.report import effect_words
from vispeg.robots.model import load
from vispeg.view.standing import Candidate, Pictured, Rung, Standing, Tried
from vispeg.view.telling import key as key_of
from vispeg.view.telling import maps, named, size, spelt, track, words
from vispeg.vision.show import side_by_side
from vispeg.worlds.model_file import model_text, placed_dict
from vispeg.worlds.words import parse
from vispeg.worlds.world import World

SHOWN = 12  # candidates
STEPS = "steps.json"  # in the folder of the progress


class Study:
    """What the page's worker holds.

    Args:
        tell: is told "say" (a sentence), "standing", "candidates", "tried" and "pictured", see `vispeg.view.standing`.
        model: as `vispeg diagnose` takes it.
        fitted, held_out: folders of recordings; without `held_out` the model is only compared with the others.
        out: folder of results; what was worked out is kept in `found.part` in it, or `found-2.part` where that is of
            other recordings.
        threads: of the simulation.
    """

    def __init__(
        self,
        tell: Callable[[str, Any], None],
        model: str,
        fitted: tuple[Path, ...],
        held_out: tuple[Path, ...],
        out: Path,
        threads: int = 2,
    ):
        self.tell, self.threads = tell, threads
        self.asked = model, fitted, held_out
        tell("say", "reading recordings")
        judged = bool(held_out)
        given = read_inputs(model, fitted or held_out, held_out if fitted else (), need_validate=False)
        self.world, self.judged = given.world, judged and bool(fitted)
        tell("say", "simulating")
        self.evidence = evidence_for(given.world, given.fitted, threads) if self.judged else None
        against = given.held_out if self.judged else given.fitted
        self.against = evidence_for(given.world, against, threads, h_max=1e-3)
        self.given = len(self.world.effects)
        self.search, self.state, self.before = None, None, list[tuple[State, list[Rung]]]()
        self.rungs = [Rung("the model as given", self._error(self.world))]
        self.scores: dict[str, Score] = {}
        self.done, self.part = list[list[str]](), out / "found.part"
        if self.evidence is not None:
            progress = _progress(given, out)
            self.part = progress.file.parent if progress.file else self.part
            self.search = Search(self.evidence, Judge(self.against), lambda text: tell("say", text), progress)
            self.state = self.search.start(self.world)
            for step in self._claimed():
                self._again(step)

    def show(self) -> None:
        """Tells where the search stands."""
        self.tell("standing", self.standing())

    def screen(self) -> None:
        """Scores every candidate and tells the best."""
        search, state = self._searching()
        self.tell("say", f"scoring candidates beside {state.world.label}")
        missing = search.missing(state.world)
        near, rest, together = search.places(state, missing)
        scores = search.screened(state.world, state.residual, state.fit, near, missing, together)
        self.scores = {key_of(s): s for s in scores}
        self.tested = len(near) + len(rest)
        total = float(state.residual @ state.residual)
        found = [(size(s), Candidate(key_of(s), words(s), min(s.gain / max(total, 1e-12), 1.0))) for s in scores]
        found.sort(key=lambda at: (-round(at[1].share, 2), at[0]))  # of equals the simplest first
        self.tell("candidates", [candidate for _, candidate in found[:SHOWN]])

    def fit(self, key: str, anyway: bool = False) -> None:
        """Fits one candidate, or any `EFFECT:WHERE`; it is added where it passes, or `anyway`."""
        search, state = self._searching()
        score = self.scores.get(key) or self._typed(key)
        for member in score.members:
            if any((e.effect, e.where) == (member.effect, member.where) for e in state.world.effects):
                raise UserError("is in the model already", key=key)
        self.tell("say", f"fitting {words(score)}")
        before = self._error(state.world)
        missing = search.missing(state.world)
        near, rest, _ = search.places(state, missing)
        (trial,) = search.try_all(state, [score], self.given, len(near) + len(rest))
        self.tell("tried", self._tried(trial, before))
        if trial.rejected and not anyway:
            return
        self._remember()
        search.take(state, trial, [trial], self.given)
        self._rung(f"+ {words(score)}")
        self._did("fit", spelt(score))
        self.show()

    def advance(self) -> bool:
        """One step of the search by itself; False where nothing more earns its place."""
        search, state = self._searching()
        if not search.worth_it(state, self.given):
            self.tell("say", "the error is near the sensor noise: nothing more can be named")
            return False
        self._remember()
        steps, before, was = len(state.steps), self._error(state.world), {e.label for e in state.world.effects}
        went_on = search.advance(state, self.given)
        trials = state.last if len(state.steps) == steps else state.steps[steps][1]
        for trial in trials:
            self.tell("tried", self._tried(trial, before))
        if len(state.steps) == steps:
            self.before.pop()
            self.tell("say", "no candidate earns its place on the held-out recordings")
            return False
        new = [e for e in state.world.effects if e.label not in was]
        gone = was - {e.label for e in state.world.effects}
        words = [f"+ {effect_words.named(placed_dict(e))}" for e in new] + [f"− {label}" for label in sorted(gone)]
        self._rung("; ".join(words) or "refitted")
        self._did("advance")
        self.show()
        return went_on

    def run(self) -> None:
        """The search by itself, until nothing more earns its place."""
        while self.advance():
            pass

    def picture(self, track: int, moment: float, camera: str) -> None:
        """Tells "pictured": the camera's frame nearest to a moment, s, of a track, and as the model renders it.

        Raises:
            UserError: the camera took no picture, or its pose or the joint angles at that time are not known.
        """
        item = self.against.items[track]
        rec, start = item.recording, float(item.recording.time[item.segment.rows[0]])
        if rec.frames is None or camera not in rec.frames.names:
            raise UserError("took no picture", key="camera", got=camera)
        frames = rec.frames.of(camera)
        k = int(np.argmin(np.abs(frames.times - start - moment)))
        world = self.world if self.state is None else self.state.world
        self.tell("say", f"rendering what {camera} sees")
        (one,) = compared_pictures(replace(rec, frames=frames.some(np.array([k]))), world)
        self.tell("pictured", Pictured(camera, float(frames.times[k]) - start, side_by_side(one)))

    def undo(self) -> None:
        """Takes the last step back."""
        if not self.before:
            raise UserError("there is nothing to take back")
        self.state, self.rungs = self.before.pop()
        self.done.pop()
        self._write()
        self.scores = {}
        self.show()

    def report(self) -> str:
        """Runs what is left of `vispeg diagnose` and writes its folder; returns its path."""
        out = self.part.with_suffix("")
        result = diagnose(*self.asked, threads=self.threads, part=self.part, say=lambda text: self.tell("say", text))
        return str(result.save(out))

    def save(self, file: Path, overwrite: bool) -> str:
        """Writes the model with what was added; returns the path."""
        world = self.world if self.state is None else self.state.world
        return str(write_text_atomic(file, model_text(world), overwrite=overwrite))

    def standing(self) -> Standing:
        """Where the search stands, with what the page draws of it."""
        state, judged = self.state, self.against
        world = self.world if state is None else state.world
        item = judged.items[0]
        first, now = judged.simulated([self.world]), judged.simulated([world])
        tracks = [track(i, a[0], b[0]) for i, a, b in zip(judged.items, first, now, strict=True)]
        return Standing(
            robot=self.world.robot,
            tool=self.world.tool,
            joints=tuple(item.robot.joints),
            unit=judged.unit,
            floor=judged.floor,
            ladder=tuple(self.rungs),
            effects=tuple(named(e) for e in world.effects[self.given :]),
            given=tuple(named(e) for e in world.effects[: self.given]),
            tracks=tuple(tracks),
            maps=maps(judged, first, now),
            judged=self.judged,
            enough=self.search is not None and state is not None and not self.search.worth_it(state, self.given),
        )

    def _searching(self) -> tuple[Search, State]:
        if self.search is None or self.state is None:
            expected = "one recording to fit, and another to judge on"
            raise UserError("there is no recording to judge on", expected=expected)
        return self.search, self.state

    def _typed(self, key: str) -> Score:
        robot = load(self.world.robot, tool=self.world.tool)
        first, *beside = [e for text in key.split(" + ") for e in parse(text.strip(), robot)]
        return Score(first, 0.0, tuple(beside))

    def _error(self, world: World) -> float:
        return self.against.angle_rms(self.against.residuals([world])[0])

    def _tried(self, trial: Trial, before: float) -> Tried:
        added = trial.fit.world.effects[len(trial.fit.world.effects) - trial.score.count :]
        sizes = [effect_words.size(placed_dict(e)) for e in added]
        size = sizes[0] if len(sizes) == 1 else ""
        return Tried(words(trial.score), size, before, self._error(trial.fit.world), trial.rejected)

    def _remember(self) -> None:
        state = copy(self._searching()[1])
        state.steps, state.last = [*state.steps], [*state.last]
        self.before.append((state, [*self.rungs]))

    def _rung(self, words: str) -> None:
        self.rungs.append(Rung(words, self._error(self._searching()[1].world)))

    def _did(self, *step: str) -> None:
        self.scores = {}
        self.done.append([*step])
        self._write()

    def _claimed(self) -> list[list[str]]:
        """What was done in this folder before; from now on it is this search's."""
        steps = _read(self.part)["steps"]
        if not steps:
            self._write()
        return steps

    def _write(self) -> None:
        record = {"key": self._searching()[0].progress.key, "steps": self.done}
        write_text_atomic(self.part / STEPS, json.dumps(record) + "\n", overwrite=True)

    def _again(self, step: list[str]) -> None:
        """Repeats what an earlier process did; its progress has the answers."""
        self.tell("say", f"going on: {' '.join(step)}")
        if step[0] == "fit":
            self.fit(step[1], anyway=True)
        else:
            self.advance()


def _progress(given: Inputs, out: Path) -> Progress:
    """The progress of these inputs, in the first folder that is theirs or nobody's."""
    for name in ("found", *(f"found-{n}" for n in range(2, 1000))):
        part = out / f"{name}.part"
        progress = progress_of(given, SECONDS, 0, part)
        ours = _read(part)["key"] in ("", progress.key) or progress.resumed
        if ours and not (out / name).exists():
            return progress
    raise UserError("holds too many results", file=out, expected="another --out")


class _Search(TypedDict):
    """The key of the search that a folder belongs to, and its steps."""

    key: str
    steps: list[list[str]]


def _read(part: Path) -> _Search:
    """What a folder says of its search; empty where it is nobody's."""
    try:
        data = json.loads((part / STEPS).read_text(encoding="utf-8"))
        return {"key": str(data["key"]), "steps": [[str(word) for word in step] for step in data["steps"]]}
    except (OSError, ValueError, TypeError, KeyError):
        return {"key": "x" if part.exists() else "", "steps": []}
