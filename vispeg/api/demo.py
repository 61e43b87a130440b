"""Compare and diagnose a model with bundled recordings, as `vispeg demo` does."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypedDict, cast

import numpy as np

from vispeg.api.compare import ComparisonResult, compare
from vispeg.api.diagnose import DiagnosisResult, diagnose
from vispeg.api.result import Result
from vispeg.core.assets import assets
from vispeg.core.errors import UserError
from vispeg.datasets.codec import encode
from vispeg.diagnosis.schema import DiagnosisRecord
from vispeg.render.backends.backend import BackendName
from vispeg.report.drawings import contact_sheet, robot_picture
from vispeg.report.record import ROBOT, SHEET
from vispeg.report.text import words
from vispeg.report.text.summary import Block, Line
from vispeg.report.text.terminal import effects_table, ladder_table

FITTED, HELD_OUT = ("rig-a", "rig-b"), ("rig-c",)


class Hidden(TypedDict):
    """An effect that was hidden in the recorded robot."""

    effect: str
    where: str
    params: dict[str, float]


@dataclass(frozen=True, repr=False)
class Demonstration(Result):
    """A diagnosis of bundled recordings, and the effects that were hidden in the recorded robot.

    Attributes:
        comparison: the comparison of the nominal model with the held-out recording.
        diagnosis: the effects that the model lacks.
        hidden: the hidden effects.
        pictures: file name -> PNG of the robot in its cell and of a contact sheet; may be empty.
        problem: why pictures are missing; "" if none is.
    """

    comparison: ComparisonResult
    diagnosis: DiagnosisResult
    hidden: Sequence[Hidden]
    pictures: Mapping[str, bytes]
    problem: str = ""
    holds = "demonstration"  # class attribute, see `Result`

    @property
    def record(self) -> Mapping[str, object]:
        """The output of `vispeg demo --json`: diagnosis.json, and the hidden effects."""
        return {**self.diagnosis.record, "hidden": list(self.hidden)}

    @property
    def summary(self) -> list[Block]:
        """The decrease of the error, the verdict, the effects found, and the hidden ones."""
        record = self.diagnosis.record
        effects = [effects_table(record)] if record["effects"] else []
        verdict = Line(words.verdict(record), head=record["verdict"])
        hidden = "; ".join(
            f"{h['effect']}({h['where']}) {', '.join(f'{k} {v:g}' for k, v in h['params'].items())}"
            for h in self.hidden
        )
        truth = Line(f"what was hidden in the robot: {hidden}")
        return [ladder_table(record), Line(words.fall(record)), verdict, *effects, truth]

    def _write(self, folder: Path) -> None:
        for name, picture in self.pictures.items():
            (folder / name).write_bytes(picture)
        self.diagnosis._write(folder)
        (folder / "compared").mkdir()
        self.comparison._write(folder / "compared")


def demo(*, seed: int = 0, threads: int = 2, say: Callable[[str], None] = lambda text: None) -> Demonstration:
    """Compare the nominal iiwa14 with recordings of a robot that hides two effects, and diagnose what it lacks.

    Args:
        seed: seed of everything random.
        threads: number of threads for the simulation.
        say: called with a line of text at each step.
    """
    place = assets() / "recordings"
    fitted, held_out = ([place / name for name in names] for names in (FITTED, HELD_OUT))
    say("comparing")
    before = compare("iiwa14", held_out, threads=threads)
    after = diagnose("iiwa14", fitted, held_out, seed=seed, threads=threads, say=say)
    say("rendering")
    pictures, places, problem = drawn(seed)
    if places:
        record = {**after.record, "picture": {"file": ROBOT, "places": places}}
        after = replace(after, record=cast(DiagnosisRecord, record))
    truth: dict[str, Any] = json.loads((place / "truth.json").read_text(encoding="utf-8"))
    return Demonstration(before, after, truth["hidden"], pictures, problem)


def drawn(
    seed: int, frames: int = contact_sheet.FRAMES, backend: BackendName = "auto"
) -> tuple[dict[str, bytes], dict[str, list[float]], str]:
    """Draw the robot and the contact sheet.

    Args:
        seed: of the looks on the contact sheet.
        frames: number of frames on it.
        backend: the renderer.

    Returns:
        File name -> PNG; place of an effect -> [x, y] in the robot's picture; and the reason if a picture is missing.
    """
    pictures: dict[str, bytes] = {}
    places: dict[str, list[float]] = {}
    try:
        image, places = robot_picture.draw(backend)
        pictures[ROBOT] = encode(np.ascontiguousarray(image))
        pictures[SHEET] = encode(contact_sheet.draw(frames=frames, seed=seed, backend=backend))
    except UserError as error:  # the diagnosis is complete without pictures
        return pictures, places, str(error)
    return pictures, places, ""
