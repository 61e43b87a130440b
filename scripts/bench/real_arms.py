"""Real arms: held-out error of the given model, of a diagnosis, of effects that a person chose, and of least squares.

    python scripts/bench/real_arms.py DATA --work FOLDER [--only panda] [--out tables.md]

DATA holds one folder a robot, each with recordings in the project's format or tables to convert. A row is one way to a
model, each fitted on the same recordings and judged on the same others; `diagnose` and `fit` are the commands of those
names, `likely` is what `diagnose` says first, from a linear model of torques; `least squares` is of all inertial
parameters with friction and bias (torques only; it is no model). With `--short` nothing is diagnosed or fitted.

FOLDER keeps the rows, the commands' results (FOLDER/panda/diagnose/report.html) and their progress: a run that was
killed resumes, and finished results are reused. Processor seconds are those of all runs.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from vispeg.api.diagnose import diagnose
from vispeg.api.fit import fit
from vispeg.api.inputs import Inputs, read_inputs
from vispeg.api.recording.convert import convert
from vispeg.core.files import write_text_atomic
from vispeg.diagnosis.evidence.base_parameters import base_parameters
from vispeg.diagnosis.proposal import propose
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import TorqueEvidence, evidence_for
from vispeg.worlds.model_file import load_model
from vispeg.worlds.world import World

DOCS = Path(__file__).resolve().parents[2] / "docs"
FRICTION = ("coulomb_friction:each", "viscous_friction:each")


@dataclass(frozen=True)
class Arm:
    """A robot's model and recordings below the data folder; `choice` is what a person would fit.

    With `map`, the recordings are tables that are converted first, and model and map lie in the project's `docs`.
    """

    model: str
    fitted: tuple[str, ...]
    held_out: tuple[str, ...]
    choice: tuple[str, ...] = FRICTION
    map: str = ""
    seconds: float = 60.0  # of each recording


ARMS = {
    "panda": Arm(
        "panda/panda.urdf", ("panda/fit",), ("panda/validate",), (*FRICTION, "link_mass:each", "link_com:each")
    ),
    "kuka-lwr4": Arm(
        "kuka-lwr4/kuka_lwr4.urdf", ("kuka-lwr4/run-1", "kuka-lwr4/run-2"), ("kuka-lwr4/run-3",)
    ),
    "double-pendulum": Arm(
        "double-pendulum/dp.xml",
        tuple(f"double-pendulum/fit-{n}" for n in (143339, 143601, 144115)),
        tuple(f"double-pendulum/val-{n}" for n in (143524, 143704)),
        (*FRICTION, "rotor_inertia:each"),
    ),
    "so101": Arm(
        "examples/so101/arm.xml",
        ("so101/frequency_sweep.csv.gz", "so101/chirp_sweep.csv.gz", "so101/friction_gravity.csv.gz",
         "so101/backlash_detection.csv.gz"),
        ("so101/step_response.csv.gz", "so101/multisine.csv.gz"),
        ("servo:each", "coulomb_friction:each", "command_delay:all"),
        map="examples/so101/map.yaml",
        seconds=12.0,
    ),
}  # fmt: skip


class Clock:
    """Processor seconds of a piece of work over all the processes that it took."""

    def __init__(self, file: Path):
        self.file = file
        self.before = json.loads(file.read_text()) if file.is_file() else 0.0
        self.begin = time.process_time()

    def keep(self, *_: object) -> None:
        """Write the seconds so far, for the next process."""
        write_text_atomic(self.file, json.dumps(self()), overwrite=True)

    def __call__(self) -> float:
        """Return the processor seconds so far."""
        return self.before + time.process_time() - self.begin


class Bench:
    """One arm, and its rows in a folder of their own."""

    def __init__(self, data: Path, work: Path, name: str):
        self.arm, self.work = ARMS[name], work / name
        self.work.mkdir(parents=True, exist_ok=True)
        self.model = (DOCS if self.arm.map else data) / self.arm.model
        self.fitted, self.held_out = (
            [self._recording(data / name) for name in names] for names in (self.arm.fitted, self.arm.held_out)
        )
        given: Inputs = read_inputs(self.model, self.fitted, self.held_out, seconds=self.arm.seconds)
        self.given, self.world = given, given.world
        self.evidence = evidence_for(given.fitted)
        self.judged = evidence_for(given.held_out)

    def _recording(self, source: Path) -> Path:
        if not self.arm.map:
            return source
        out = self.work / "recordings" / source.name.partition(".")[0]
        if not out.is_dir():
            convert(source, str(self.model), out, mapping=DOCS / self.arm.map)
        return out

    def errors(self, world: World) -> np.ndarray:
        """Return the RMS error (nj + 1,) of each joint's principal channel, and of all joints."""
        pairs = zip(self.judged.items, self.judged.simulated([world]), strict=True)
        return _rms(self.judged, [i.measured[:, : i.nj] - y[0][:, : i.nj] for i, y in pairs])

    def rows(self, short: bool = False) -> list[dict]:
        """Return each way's name, errors, processor seconds and remark."""
        given = {"way": "the model as given", "errors": self.errors(self.world).tolist(), "seconds": 0.0}
        rows = [given, *([] if short else [self._row("diagnose", self._diagnosed), self._row("fit", self._fit)])]
        rows.append(self._row("likely", self._proposed))
        if isinstance(self.evidence, TorqueEvidence) and isinstance(self.judged, TorqueEvidence):
            rows.append(self._row("least-squares", partial(self._least_squares, self.evidence, self.judged)))
        return rows

    def _row(self, way: str, work_out) -> dict:
        file = self.work / f"{way}.json"
        if not file.is_file():
            clock = Clock(self.work / f"{way}.seconds.json")
            row = work_out(clock)
            write_text_atomic(file, json.dumps(row | {"seconds": clock()}))
        return json.loads(file.read_text())

    def _diagnosed(self, clock: Clock) -> dict:
        def say(text: str) -> None:
            clock.keep()
            print(f"{clock():7.1f} s  {text}", file=sys.stderr, flush=True)

        recordings = {"seconds": self.arm.seconds, "threads": 1, "part": self.work / "diagnose.part"}
        result = diagnose(self.model, self.fitted, self.held_out, say=say, **recordings)
        out = result.save(self.work / "diagnose", overwrite=True)
        record = json.loads((out / "diagnosis.json").read_text())
        found = {key: record[key] for key in ("verdict", "reason", "effects")}
        return {"way": "`diagnose`", "errors": self._saved(out)} | found

    def _proposed(self, clock: Clock) -> dict:
        found = propose(self.world, self.given.fitted, self.given.held_out)
        named = () if found is None else found.named
        errors = self.errors(self.world.add(*(n.placed for n in named)))
        said = [f"{n.placed.label}, {100 * n.share:.0f} %" for n in named]
        return {"way": f"likely: {len(named)} effects", "errors": errors.tolist(), "likely": said}

    def _fit(self, clock: Clock) -> dict:
        result = fit(
            self.model,
            self.fitted,
            self.arm.choice,
            self.held_out,
            seconds=self.arm.seconds,
            threads=1,
            part=self.work / "fit.part",
            resume=True,
            watch=clock.keep,
        )
        out = result.save(self.work / "fit", overwrite=True)
        ways = ", ".join(text.removesuffix(":each") for text in self.arm.choice)
        return {"way": f"`fit` of {ways}", "errors": self._saved(out)}

    def _least_squares(self, evidence: TorqueEvidence, judged: TorqueEvidence, clock: Clock) -> dict:
        left = _rms(judged, base_parameters(evidence, judged, self.world))
        return {"way": "least squares of base parameters", "errors": left.tolist()}

    def _saved(self, out: Path) -> list[float]:
        """Return the errors of the model that was written: a next command would start from it."""
        return self.errors(load_model(out / "model.yaml")).tolist()


def _rms(evidence: Evidence, residuals: list[np.ndarray]) -> np.ndarray:
    nj = evidence.items[0].nj
    valid = np.concatenate([i.valid[:, :nj] for i in evidence.items])
    square = np.where(valid, np.concatenate(residuals), 0.0) ** 2
    joints, count = square.sum(axis=0), valid.sum(axis=0)
    return np.sqrt(np.append(joints / np.maximum(count, 1), joints.sum() / max(count.sum(), 1)))


def table(name: str, bench: Bench, short: bool = False) -> str:
    """Return one robot's tables as Markdown."""
    rows = bench.rows(short)
    joints = len(rows[0]["errors"]) - 1
    lines = [f"### {name}, RMS on {', '.join(bench.arm.held_out)}, {bench.judged.unit}", ""]
    lines.append("| model | " + " | ".join(f"J{j + 1}" for j in range(joints)) + " | all | processor, s |")
    lines.append("|" + "---|" * (joints + 3))
    for row in rows:
        errors = " | ".join(f"{e:.3g}" for e in row["errors"])
        lines.append(f"| {row['way']} | {errors} | {row['seconds']:.0f} |")
    lines += ["", *(f"{row['way']}: {'; '.join(row['likely'])}." for row in rows if row.get("likely"))]
    if short:
        return "\n".join(lines) + "\n"
    record = rows[1]
    lines += ["", f"`{record['verdict']}`: {record['reason']}.", ""]
    lines += ["| effect | where | parameter | value | 95 % | |", "|" + "---|" * 6]
    for e in record["effects"]:
        others = ", ".join(f"{o['effect']}({o['where']})" for o in e["indistinguishable_from"])
        doubt = "tentative" if e.get("tentative") else f"or {others}" if others else ""
        for key, p in e["params"].items():
            span = f"{p['low']:.3g} to {p['high']:.3g}" if "low" in p else "-"
            lines.append(f"| {e['effect']} | {e['where']} | {key} | {p['value']:.3g} {p['unit']} | {span} | {doubt} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--work", type=Path, required=True, help="folder that keeps rows and results")
    parser.add_argument("--only", nargs="*", choices=sorted(ARMS), default=sorted(ARMS))
    parser.add_argument("--short", action="store_true", help="neither diagnose nor fit")
    parser.add_argument("--out", type=Path, default=None, help="also write the tables there")
    args = parser.parse_args()
    warnings.filterwarnings("ignore", category=UserWarning)
    done = []
    for name in args.only:
        done.append(table(name, Bench(args.data, args.work, name), args.short))
        print(done[-1], flush=True)
    if args.out is not None:
        write_text_atomic(args.out, "\n".join(done), overwrite=True)


if __name__ == "__main__":
    main()
