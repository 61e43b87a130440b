"""Real arms: held-out error of the given model, of a diagnosis, of effects that a person chose, and of least squares.

    python scripts/bench/real_arms.py DATA [--only panda] [--out table.md] [--models FOLDER]

DATA holds one folder a robot, each with recordings in the project's format. A row is one way to a model, each fitted on
the same recordings and judged on the same others; `fit` is what `vispeg fit` makes of Coulomb and viscous friction in
every joint, `least squares` all inertial parameters with friction and bias (torques only; it is no model).
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from vispeg.api.inputs import Inputs, read_inputs
from vispeg.cli.convert import Args as Convert
from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.base_parameters import base_parameters
from vispeg.diagnosis.run import Diagnosis, diagnose
from vispeg.identify.calibrate import calibrate
from vispeg.identify.evidence import Evidence, robot_of
from vispeg.identify.inverse import TorqueEvidence, evidence_for
from vispeg.worlds.model_file import model_text
from vispeg.worlds.words import parse
from vispeg.worlds.world import World

DOCS = Path(__file__).resolve().parents[2] / "docs"


@dataclass(frozen=True)
class Arm:
    """A robot's model and recordings below the data folder; `choice` is what a person would fit.

    With `map`, the recordings are tables that are converted first, and model and map lie in the project's `docs`.
    """

    model: str
    fitted: tuple[str, ...]
    held_out: tuple[str, ...]
    choice: tuple[str, ...] = ("coulomb_friction:each", "viscous_friction:each")
    map: str = ""
    seconds: float = 60.0  # of each recording


ARMS = {
    "panda": Arm("panda/panda.urdf", ("panda/fit",), ("panda/validate",)),
    "kuka-lwr4": Arm(
        "kuka-lwr4/kuka_lwr4.urdf", ("kuka-lwr4/run-1", "kuka-lwr4/run-2"), ("kuka-lwr4/run-3",)
    ),
    "double-pendulum": Arm(
        "double-pendulum/dp.xml",
        tuple(f"double-pendulum/fit-{n}" for n in (143339, 143601, 144115)),
        tuple(f"double-pendulum/val-{n}" for n in (143524, 143704)),
        ("coulomb_friction:each", "viscous_friction:each", "rotor_inertia:each"),
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


def inputs(data: Path, arm: Arm) -> Inputs:
    """The arm's model and recordings."""
    if not arm.map:
        fitted, held_out = ([data / name for name in names] for names in (arm.fitted, arm.held_out))
        return read_inputs(data / arm.model, fitted, held_out, seconds=arm.seconds)
    model = DOCS / arm.model
    with TemporaryDirectory() as scratch:
        folders = {name: Path(scratch) / Path(name).name.partition(".")[0] for name in (*arm.fitted, *arm.held_out)}
        for name, folder in folders.items():
            Convert(data / name, str(model), out=folder, map=DOCS / arm.map).run()
        fitted, held_out = ([folders[name] for name in names] for names in (arm.fitted, arm.held_out))
        return read_inputs(model, fitted, held_out, seconds=arm.seconds)


def errors(evidence: Evidence, world: World) -> np.ndarray:
    """(nj + 1,) RMS error of each joint's principal channel, and of all."""
    pairs = zip(evidence.items, evidence.simulated([world]), strict=True)
    return _rms(evidence, [i.measured[:, : i.nj] - y[0][:, : i.nj] for i, y in pairs])


def _rms(evidence: Evidence, residuals: list[np.ndarray]) -> np.ndarray:
    nj = evidence.items[0].nj
    valid = np.concatenate([i.valid[:, :nj] for i in evidence.items])
    square = np.where(valid, np.concatenate(residuals), 0.0) ** 2
    joints, count = square.sum(axis=0), valid.sum(axis=0)
    return np.sqrt(np.append(joints / np.maximum(count, 1), joints.sum() / max(count.sum(), 1)))


def rows(data: Path, arm: Arm) -> tuple[list[tuple[str, np.ndarray, float]], Diagnosis, str]:
    """(way, errors, processor seconds) of each way, the diagnosis, and the errors' unit."""
    given = inputs(data, arm)
    world, fit, validate = given.world, given.fitted, given.held_out
    evidence, judged = evidence_for(world, fit), evidence_for(world, validate, h_max=1e-3)
    out = [("the model as given", errors(judged, world), 0.0)]
    begin = time.process_time()
    found = diagnose(world, fit, validate, nthread=1, plan_next=False, say=lambda text: print(text, file=sys.stderr))
    out.append(("`diagnose`", errors(judged, found.world), time.process_time() - begin))
    begin = time.process_time()
    chosen: list[EffectInstance] = [e for text in arm.choice for e in parse(text, robot_of(fit[0]))]
    person = calibrate(
        evidence, world.add(*chosen), range(len(world.effects), len(world.effects) + len(chosen)), seed=0
    )
    ways = ", ".join(text.removesuffix(":each") for text in arm.choice)
    out.append((f"`fit` of {ways} in every joint", errors(judged, person.fit.world), time.process_time() - begin))
    if isinstance(evidence, TorqueEvidence) and isinstance(judged, TorqueEvidence):
        begin = time.process_time()
        left = _rms(judged, base_parameters(evidence, judged, world))
        out.append(("least squares of base parameters", left, time.process_time() - begin))
    return out, found, judged.unit


def table(name: str, arm: Arm, data: Path, models: Path | None) -> str:
    """One robot's table as Markdown, and its model file where a folder for it is given."""
    found, diagnosis, unit = rows(data, arm)
    joints = found[0][1].size - 1
    lines = [f"### {name}, RMS on {', '.join(arm.held_out)}, {unit}", ""]
    lines.append("| model | " + " | ".join(f"J{j + 1}" for j in range(joints)) + " | all | processor, s |")
    lines.append("|" + "---|" * (joints + 3))
    for way, error, seconds in found:
        lines.append(f"| {way} | " + " | ".join(f"{e:.3g}" for e in error) + f" | {seconds:.0f} |")
    record = diagnosis.record
    lines += ["", f"`{record['verdict']}`: {record['reason']}.", "", "| effect | where | parameter | value | 95 % |"]
    lines.append("|" + "---|" * 5)
    for e in record["effects"]:
        for key, p in e["params"].items():
            span = f"{p['low']:.3g} to {p['high']:.3g}" if "low" in p else "–"
            lines.append(f"| {e['effect']} | {e['where']} | {key} | {p['value']:.3g} {p['unit']} | {span} |")
    if models is not None:
        models.mkdir(parents=True, exist_ok=True)
        (models / f"{name}.yaml").write_text(model_text(diagnosis.world), encoding="utf-8")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="*", choices=sorted(ARMS), default=sorted(ARMS))
    parser.add_argument("--out", type=Path, default=None, help="also write the tables there")
    parser.add_argument("--models", type=Path, default=None, help="folder for the models that were found")
    args = parser.parse_args()
    warnings.filterwarnings("ignore", category=UserWarning)
    done = []
    for name in args.only:
        done.append(table(name, ARMS[name], args.data, args.models))
        print(done[-1], flush=True)
    if args.out is not None:
        args.out.write_text("\n".join(done), encoding="utf-8")


if __name__ == "__main__":
    main()
