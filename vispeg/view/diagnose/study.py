"""A diagnosis by hand, in a worker process: compare, screen, fit one effect or let the search continue, undo.

It uses and extends the progress that `vispeg diagnose` saves beside its result, and it records each step. If the
worker is killed, the next one repeats the steps in a moment; `vispeg diagnose` can continue from the same progress.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from vispeg.api.diagnose import diagnose, progress_of
from vispeg.api.inputs import Inputs, read_inputs, windows
from vispeg.channels.channel import CHANNELS, How
from vispeg.channels.conduct import part_of
from vispeg.channels.pictures import compared_pictures
from vispeg.channels.resolve import resolve
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.diagnosis.beginning import ANEW
from vispeg.diagnosis.findings import Score, Trial
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.state import State
from vispeg.recordings.windows import SECONDS
from vispeg.report.text import effect_words
from vispeg.view.diagnose.borders import Borders
from vispeg.view.diagnose.contact import Contact
from vispeg.view.diagnose.joints import Joints
from vispeg.view.diagnose.plain import Plain
from vispeg.view.diagnose.standing import Candidate, Pictured, Rung, Standing, Tried
from vispeg.view.diagnose.subject import Steps
from vispeg.view.diagnose.telling import changed, named, size, spelt, words
from vispeg.view.diagnose.telling import key as key_of
from vispeg.vision.show import side_by_side
from vispeg.worlds.model_file import placed_dict, write_model
from vispeg.worlds.world import World

SHOWN = 12  # number of candidates shown
SUBJECTS = {"joints": Joints, "contact": Contact, "pictures": Borders}
STEPS = "steps.json"  # name of the file with the steps, in the folder of the progress


class Study:
    """The object that the page's worker owns.

    Args:
        tell: called with "say" (a sentence), "model" (MjModel, whether it is a cell), "standing", "candidates",
            "tried" and "pictured", see `vispeg.view.diagnose.standing`.
        model: a model in any form that `vispeg diagnose` accepts.
        fitted, held_out: folders of recordings to fit and to judge on; unless both are given, the model is only
            compared.
        out: folder of results. Progress is kept in its `found.part`, or in `found-2.part` and so on if that belongs to
            other inputs.
        threads: number of threads for the simulation.
        channel: the channel to compare; by default the first that the model and recordings have.
    """

    def __init__(
        self,
        tell: Callable[[str, Any], None],
        model: str,
        fitted: tuple[Path, ...],
        held_out: tuple[Path, ...],
        out: Path,
        threads: int = 2,
        channel: str | None = None,
    ):
        self.tell, self.threads = tell, threads
        self.asked = model, fitted, held_out  # for `report`
        tell("say", "reading recordings")
        sides = fitted or held_out, held_out if fitted else ()
        inputs = read_inputs(model, *sides, need_validate=False, **windows(model, SECONDS, *sides))
        self.world, self.judged = inputs.world, bool(inputs.held_out)
        self.done, self.part, self.key, progress = list[list[str]](), out / "found.part", "", None
        if self.judged:
            progress = _progress(inputs, out)
            self.part, self.key = progress.file.parent if progress.file else self.part, progress.key
        tell("say", "simulating")
        given = self.given = inputs.world
        both = inputs.fitted, inputs.held_out
        self.channels = resolve(given, *both)
        self.channel = self.channels[0] if channel is None else channel
        self.others = list[list[str]]()  # steps of other channels in the same folder
        if progress is not None and len(self.channels) > 1:
            progress = part_of(progress, self.channel, given)
        looked_in, how = CHANNELS[self.channel], How()
        fit, judge = (tuple(looked_in.read(rec, given, how) for rec in side) for side in both)
        inputs = replace(inputs, world=looked_in.part(given), fitted=fit, held_out=judge)
        self.world = inputs.world
        # effects of the given model that this channel leaves out
        self.aside = tuple(e for e in given.effects if e not in self.world.effects)
        subject = SUBJECTS.get(self.channel, partial(Plain, looked_in))
        self.subject = subject(inputs, threads, lambda text: tell("say", text), progress)
        self.search = self.subject.search
        begin = self.subject.begin(self.world)
        self.world, self.n_given, self.n_fixed = begin.world, begin.n_given, begin.n_fixed
        self.state, self.before = None, list[tuple[State, list[Rung], tuple[EffectInstance, ...]]]()
        # `before` holds the state, the ladder and `unsearched` before each step, for `undo`
        self.unsearched: tuple[EffectInstance, ...] = ()  # effects found without a search
        self.rungs = [Rung("the initial model", self.subject.error(self.world))]
        self.scores: dict[str, Score] = {}
        tell("model", (self.subject.model, self.subject.cell))
        if self.search is not None:
            if begin.read:
                label = ", ".join(effect_words.named(placed_dict(e)) for e in begin.read)
                self.rungs.append(Rung(f"+ {label}", self.subject.error(begin.first)))
            self.state = self.search.start(begin.first, begin.n_fixed)
            if begin.n_given < len(begin.world.effects):
                self._rung(ANEW)
            for step in self._claimed():
                self._again(step)
        else:  # nothing is fitted
            self.n_given = len(self.world.effects)

    def show(self) -> None:
        """Send the state of the search."""
        self.tell("standing", self.standing())

    def screen(self) -> None:
        """Score every candidate and send the best."""
        search, state = self._searching()
        self.tell("say", f"scoring candidates beside {state.world.label}")
        scores = [s for s in search.scored(state) if s.gain > 0]
        self.scores = {key_of(s): s for s in scores}
        total = float(state.residual @ state.residual)
        candidates = [(size(s), Candidate(key_of(s), words(s), min(s.gain / max(total, 1e-12), 1.0))) for s in scores]
        # the largest share first, of equal ones that with the fewest parameters
        candidates.sort(key=lambda at: (-round(at[1].share, 2), at[0]))
        self.tell("candidates", [candidate for _, candidate in candidates[:SHOWN]])

    def fit(self, key: str, anyway: bool = False) -> None:
        """Fit one candidate, or any `EFFECT:WHERE`; add it if it passes, or if `anyway`."""
        search, state = self._searching()
        if not self.scores:
            search.scored(state)  # a fit may depend on the scores of its step
        score = self.scores.get(key) or self._typed(key)
        for member in score.members:
            if any((e.effect, e.where) == (member.effect, member.where) for e in state.world.effects):
                raise UserError("the model has this effect already", key=key)
        self.tell("say", f"fitting {words(score)}")
        before = self.subject.error(state.world)
        (trial,) = search.try_all(state, [score], search.tested(state))
        self.tell("tried", self._tried(trial, before))
        if trial.rejected and not anyway:
            return
        self._remember()
        search.take(state, trial, [trial])
        search.bound(state)
        self._rung(f"+ {words(score)}")
        self._did("fit", spelt(score))
        self.show()

    def advance(self) -> bool:
        """Let the search make one move by itself, as the command does; return False once it has ended."""
        search, state = self._searching()
        self._remember()
        was, had, before = self.before[-1][0], self._present(), self.subject.error(state.world)
        moved = search.move(state)
        if not moved:
            self.unsearched = self.subject.unsearched(self.world, state.world)
            moved = self._present() != had
        trials = [] if state.last is was.last else state.last
        new = [step for step in state.steps if not any(step is old for old in was.steps)]
        for trial in (*trials, *(t for _, tried in new for t in tried)):
            self.tell("tried", self._tried(trial, before))
        if self._present() == had:
            self.before.pop()
        else:
            self._rung(changed(had, self._present()))
            self._did("advance")
            self.show()
        if not moved:
            near = not search.worth_it(state)
            end = "the error is near the sensor noise: nothing more can be named"
            self.tell("say", end if near else "no candidate earns its place on the held-out recordings")
        return moved

    def run(self) -> None:
        """Let the search make its moves by itself until it ends."""
        while self.advance():
            pass

    def picture(self, track: int, moment: float, camera: str) -> None:
        """Send a camera's frame nearest to a moment (s) of a track, beside the model's rendering of it.

        Raises:
            UserError: the camera took no picture, or its pose or the joint angles at that time are unknown.
        """
        rec, start = self.subject.recorded(track)
        if rec.frames is None or camera not in rec.frames.names:
            raise UserError("took no picture", key="camera", got=camera)
        frames = rec.frames.of(camera)
        k = int(np.argmin(np.abs(frames.times - start - moment)))
        world = self._whole(self.world if self.state is None else self.state.world)
        self.tell("say", f"rendering what {camera} sees")
        (comparison,) = compared_pictures(replace(rec, frames=frames.some(np.array([k]))), world)
        self.tell("pictured", Pictured(camera, float(frames.times[k]) - start, side_by_side(comparison)))

    def undo(self) -> None:
        """Undo the last step. Raises UserError: there is none."""
        if not self.before:
            raise UserError("there is nothing to take back")
        search, _ = self._searching()
        self.state, self.rungs, self.unsearched = self.before.pop()
        search.back_to(self.state)
        self.done.pop()
        self._write()
        self.scores = {}
        self.show()

    def report(self) -> str:
        """Run the rest of `vispeg diagnose` and write its folder of results; return the folder's path."""
        out = self.part.with_suffix("")
        result = diagnose(*self.asked, threads=self.threads, part=self.part, say=lambda text: self.tell("say", text))
        return str(result.save(out, overwrite=True))  # safe to overwrite: the name was free at the start

    def save(self, file: Path, overwrite: bool) -> str:
        """Write the model with the added effects; return the file's path."""
        world = self._present()
        # effects that were partial in the given model stay so, because the remainder was not judged here
        partial = {e.label for e in self.world.effects if e.partial}
        effects = tuple(replace(e, partial=e.label in partial) for e in world.effects)
        return str(write_model(file, self._whole(replace(world, effects=effects)), overwrite))

    def _present(self) -> World:
        """Return the present model of this channel."""
        return self.world if self.state is None else self.state.world.add(*self.unsearched)

    def _whole(self, world: World) -> World:
        """Return this channel's world, completed with the cell and effects of the given model that it left out."""
        return replace(world, cell=self.given.cell, effects=(*self.aside, *world.effects))

    def standing(self) -> Standing:
        """Return the state of the search as the page draws it."""
        state, subject = self.state, self.subject
        world = self.world if state is None else state.world
        return Standing(
            joints=subject.joints,
            columns=subject.columns,
            units=subject.units,
            shows=subject.shows,
            unit=subject.unit,
            floor=subject.floor,
            ladder=tuple(self.rungs),
            effects=tuple(named(e) for e in self._present().effects[self.n_given :]),
            initial=tuple(named(e) for e in world.effects[: self.n_given]),
            tracks=subject.tracks(self.world, world),
            maps=subject.maps(self.world, world),
            judged=self.judged,
            channels=self.channels,
            channel=self.channel,
            enough=self.search is not None and state is not None and not self.search.worth_it(state),
        )

    def _searching(self) -> tuple[Steps, State]:
        if self.search is None or self.state is None:
            expected = "one recording to fit, and another to judge on"
            raise UserError("there is no recording to judge on", expected=expected)
        return self.search, self.state

    def _typed(self, key: str) -> Score:
        """Return the candidate whose members are written as `EFFECT:WHERE`, joined by ` + `."""
        first, *beside = [e for text in key.split(" + ") for e in self.subject.parse(text.strip())]
        return Score(first, 0.0, tuple(beside))

    def _tried(self, trial: Trial, before: float) -> Tried:
        added = trial.fit.world.effects[len(trial.fit.world.effects) - trial.score.count :]
        sizes = [effect_words.size(placed_dict(e)) for e in added]
        size = sizes[0] if len(sizes) == 1 else ""
        return Tried(words(trial.score), size, before, self.subject.error(trial.fit.world), trial.rejected)

    def _remember(self) -> None:
        """Keep a copy of the state, the ladder and the effects found without a search, for `undo`."""
        state = self._searching()[1]
        kept = replace(state, steps=[*state.steps])
        self.before.append((kept, [*self.rungs], self.unsearched))

    def _rung(self, words: str) -> None:
        """Add the present state to the ladder."""
        self.rungs.append(Rung(words, self.subject.error(self._searching()[1].world)))

    def _did(self, *step: str) -> None:
        """Save a step; the scores are those of the state before it, so they are dropped."""
        self.scores = {}
        self.done.append([*step])
        self._write()

    def _claimed(self) -> list[list[str]]:
        """Return the steps saved in this folder, and claim the folder for this search if it had none."""
        done = read_steps(self.part)["steps"]
        if len(self.channels) > 1:
            self.others = [step for step in done if step[0] != self.channel]
            done = [step[1:] for step in done if step[0] == self.channel]
        if not done:
            self._write()
        return done

    def _write(self) -> None:
        done = [[self.channel, *step] for step in self.done] if len(self.channels) > 1 else self.done
        write_steps(self.part, self.key, [*self.others, *done])

    def _again(self, step: list[str]) -> None:
        """Repeat a step of an earlier process, using its saved progress; skip effects already in the model."""
        self.tell("say", f"going on: {' '.join(step)}")
        if step[0] != "fit":
            self.advance()
            return
        has = {(e.effect, e.where) for e in self._searching()[1].world.effects}
        if not has.issuperset((e.effect, e.where) for e in self._typed(step[1]).members):
            self.fit(step[1], anyway=True)


def _progress(inputs: Inputs, out: Path) -> Progress:
    """Return the saved progress of these inputs, in the first folder that belongs to them or to no search.

    Raises:
        UserError: there are too many such folders.
    """
    for name in ("found", *(f"found-{n}" for n in range(2, 1000))):
        part = out / f"{name}.part"
        progress = progress_of(inputs, SECONDS, 0, part)
        ours = read_steps(part)["key"] in ("", progress.key) or progress.resumed
        if ours and not (out / name).exists():
            return progress
    raise UserError("holds too many results", file=out, expected="another --out")


class Done(TypedDict):
    """The key of the inputs that a folder of progress belongs to, and the steps so far."""

    key: str
    steps: list[list[str]]


def read_steps(part: Path) -> Done:
    """Return the key and steps saved in a folder.

    The key is empty if the folder does not exist, and matches no inputs if the folder has no valid file of steps.
    """
    try:
        data = json.loads((part / STEPS).read_text(encoding="utf-8"))
        return {"key": str(data["key"]), "steps": [[str(word) for word in step] for step in data["steps"]]}
    except (OSError, ValueError, TypeError, KeyError):
        return {"key": "x" if part.exists() else "", "steps": []}


def write_steps(part: Path, key: str, steps: list[list[str]]) -> None:
    """Write the key and steps, replacing the saved ones."""
    write_text_atomic(part / STEPS, json.dumps(Done(key=key, steps=steps)) + "\n", overwrite=True)
