"""Shows the main job on bundled recordings: what is this robot's model missing? About three minutes on two cores.

Compares the nominal model with recordings, diagnoses on two of them, judges on the third, and writes a report that
opens with a picture of the robot. Then renders a contact sheet of what policies are trained on: the task,
randomized, as its cameras deliver it.

Example:
    vispeg demo
    vispeg demo --out demo --overwrite
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vispeg.cli.output import Output, Told

FITTED, HELD_OUT = ("rig-a", "rig-b"), ("rig-c",)


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg demo`."""

    out: Path = Path("vispeg-demo")
    """Folder for the results."""
    seed: int = 0
    """Seed of whatever is drawn."""
    threads: int = 2
    """Threads of the simulation."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: Told = Output()

    def run(self) -> int:
        """Runs the demonstration; the table of falling error comes first."""
        from rich.console import Console

        from vispeg.api.inputs import read_inputs
        from vispeg.core.assets import assets
        from vispeg.core.files import new_folder
        from vispeg.core.provenance import provenance
        from vispeg.diagnosis.compare import compare
        from vispeg.diagnosis.run import diagnose
        from vispeg.report.record import ROBOT
        from vispeg.report.text import words
        from vispeg.report.write import write_comparison, write_diagnosis

        start, folder_of = time.monotonic(), assets() / "recordings"
        inputs = [folder_of / name for name in (*FITTED, *HELD_OUT)]
        paths = inputs[: len(FITTED)], inputs[len(FITTED) :]
        progress = Console(stderr=True, highlight=False, quiet=self.output.quiet)
        with (
            new_folder(self.out, overwrite=self.overwrite, holds="demonstration") as folder,
            progress.status("reading") as status,
        ):
            data = read_inputs("iiwa14", *paths)
            world, fitted, held_out = data.world, data.fitted, data.held_out
            for rec in (*fitted, *held_out):
                role = "fitted" if rec.name in FITTED else "held out"
                progress.print(f"{rec.name}: {rec.motion}, {rec.time[-1]:.0f} s at {rec.rate_hz:g} Hz, {role}")
            before = compare(world, held_out, nthread=self.threads)
            stamp = provenance(sys.argv, self.seed, inputs)
            progress.print(f"the nominal model, as it is: {words.fall(before.record)}")
            diagnosis = diagnose(
                world, fitted, held_out, seed=self.seed, nthread=self.threads, say=lambda text: status.update(text)
            )
            status.update("rendering")
            problem, places = self._pictures(folder)
            picture = {"picture": {"file": ROBOT, "places": places}} if places else {}
            write_diagnosis(
                folder, {**diagnosis.record, **picture, "provenance": stamp}, diagnosis.world, diagnosis.arrays
            )
            (folder / "compared").mkdir()
            write_comparison(folder / "compared", {**before.record, "provenance": stamp}, before.arrays)
        if problem:
            progress.print(f"no pictures of the cell: {problem}")
        self._print(json.loads((folder_of / "truth.json").read_text(encoding="utf-8")), time.monotonic() - start)
        return 0

    def _pictures(self, folder: Path) -> tuple[str, dict[str, list[float]]]:
        """Draws the robot and the contact sheet; says what is in the way, and where the robot's joints lie."""
        from vispeg.core.errors import UserError
        from vispeg.datasets.codec import encode
        from vispeg.report.drawings import contact_sheet, robot_picture
        from vispeg.report.record import ROBOT, SHEET

        places: dict[str, list[float]] = {}
        try:
            image, places = robot_picture.draw()
            (folder / ROBOT).write_bytes(encode(np.ascontiguousarray(image)))
            (folder / SHEET).write_bytes(encode(contact_sheet.draw(seed=self.seed)))
        except UserError as error:  # the diagnosis stands without pictures
            return str(error), places
        return "", places

    def _print(self, truth: dict, seconds: float) -> None:
        from rich.text import Text

        from vispeg.report.record import ROBOT, SHEET
        from vispeg.report.text import words
        from vispeg.report.text.tables import terminal
        from vispeg.report.text.terminal import effects_table, ladder_table

        diagnosis = json.loads((self.out / "diagnosis.json").read_text(encoding="utf-8"))
        if self.output.json:
            self.output.give({**diagnosis, "hidden": truth["hidden"]}, [])
            return
        console = terminal()
        console.print(ladder_table(diagnosis))
        console.print(Text(words.fall(diagnosis)))
        console.print(
            Text(f"{diagnosis['verdict']}: ", style="bold").append(words.verdict(diagnosis), style="not bold")
        )
        if diagnosis["effects"]:
            console.print(effects_table(diagnosis))
        hidden = (
            f"{h['effect']}({h['where']}) {', '.join(f'{k} {v:g}' for k, v in h['params'].items())}"
            for h in truth["hidden"]
        )
        console.print(Text(f"what was hidden in the robot: {'; '.join(hidden)}"))
        for what, name in (("the robot and its cell", ROBOT), ("what policies are trained on", SHEET)):
            if (self.out / name).is_file():
                console.print(Text(f"{what}: {self.out / name}"), soft_wrap=True)
        console.print(Text(f"report: {self.out / 'report.html'}  ({seconds:.0f} s)"), soft_wrap=True)
