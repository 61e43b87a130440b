"""Fits the parameters of named effects to recordings, with 95 % intervals.

Effects are EFFECT:WHERE; WHERE `all` fits one value for all places, `each` one for each. Without --effects, those in
the model file are fitted. Writes OUT/fit.json and OUT/model.yaml. A fit that was stopped goes on with --resume.

`--protocol paper` fits link masses, joint damping and the direction of gravity by CMA-ES to the flange's path in short
sub-trajectories of one recording under operational space control (`vispeg record --motion osc`).

Example:
    vispeg fit iiwa14 --recording rig-a --recording rig-b --validate rig-c \\
        --effects coulomb_friction:joint4 payload:flange --out fitted
    vispeg fit model.yaml --recording rig-a --effects viscous_friction:each --starts 4 --out fitted
    vispeg fit iiwa14 --protocol paper --recording osc-run --out fitted
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.core.interrupt import goes_on
from vispeg.recordings.windows import SECONDS


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg fit`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF."""
    out: Path
    """Folder for the results."""
    recording: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """A recording to fit; give the flag once for each."""
    validate: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """A recording to judge on, never fitted; give the flag once for each."""
    effects: tuple[str, ...] = ()
    """What to fit, each EFFECT:WHERE[:param=start,...]."""
    seconds: float = SECONDS
    """Of a longer recording, the windows that show the most, this long in all; 0 uses all of it."""
    method: Literal["auto", "least-squares", "cma"] = "auto"
    """auto: CMA-ES before least squares where an effect is not smooth, else least squares."""
    iterations: int | None = None
    """Steps at most; 15 (and ten times as many generations of CMA-ES), or 120 generations for the paper's protocol."""
    starts: int = 1
    """Optimizers that start at different values; the best one counts."""
    protocol: Literal["effects", "paper"] = "effects"
    """What is fitted to what: named effects to joint angles, or the paper's protocol."""
    seed: int = 0
    """Seed of the random starts and of CMA-ES."""
    threads: int = 2
    """Threads of the simulation."""
    resume: bool = False
    """Go on with a fit that was stopped."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    quiet: bool = False
    """No progress, only the result."""

    @goes_on("--resume")
    def run(self) -> int:
        """Fits, writes the folder, prints values with intervals."""
        from vispeg.core.errors import UserError

        if self.starts < 1:
            raise UserError("nothing to fit", key="--starts", expected="1 or more", got=self.starts)
        if self.iterations is not None and self.iterations < 1:
            raise UserError("nothing to fit", key="--iterations", expected="1 or more", got=self.iterations)
        if self.protocol == "paper":
            from vispeg.cli.fit_paper import run_paper

            return run_paper(self)
        return self._fit()

    def _fit(self) -> int:
        from vispeg.cli.fit_progress import following
        from vispeg.cli.inputs import read_inputs
        from vispeg.core.files import new_folder
        from vispeg.core.provenance import digest, provenance
        from vispeg.identify.calibrate import ITERATIONS, calibrate
        from vispeg.identify.checkpoint import Checkpoint
        from vispeg.identify.inverse import evidence_for
        from vispeg.report.fitted import fit_record, print_fit
        from vispeg.report.write import write_json
        from vispeg.worlds.model_file import model_text

        given, fitted, held_out = read_inputs(
            self.model, self.recording, self.validate, need_validate=False, seconds=self.seconds
        )
        world, free = self._free(given)
        inputs = [*self.recording, *self.validate]
        stamp = provenance(sys.argv, self.seed, inputs)
        robot = digest(world.robot) if Path(world.robot).is_file() else None
        content = [[stamp["inputs"][str(path)] for path in paths] for paths in (self.recording, self.validate)]
        key = [
            model_text(world),
            robot,
            list(free),
            self.seconds,
            self.method,
            self.starts,
            self.seed,
            content,
            stamp["versions"],
        ]
        part = self.out.with_name(self.out.name + ".part")
        read = (self.model, world.robot, *inputs)
        with new_folder(self.out, overwrite=self.overwrite, holds="fit", inputs=read) as folder:
            steps = self.iterations or ITERATIONS
            with following(self.starts, steps, self.quiet) as told:
                checkpoint = Checkpoint(part / "checkpoint.json", key, self.starts, self.resume, told)
                evidence = evidence_for(world, fitted, self.threads, h_max=1e-3)
                judged = evidence_for(world, held_out, self.threads, h_max=1e-3) if held_out else None
                options = {"method": self.method, "starts": self.starts, "iterations": steps}
                found = calibrate(evidence, world, free, seed=self.seed, checkpoint=checkpoint, **options)
            record, final = fit_record(given, found, free, evidence, judged)
            record |= {"provenance": stamp}
            write_json(folder / "fit.json", record)
            (folder / "model.yaml").write_text(model_text(final), encoding="utf-8")
        checkpoint.remove()
        print_fit(record, self.out)
        return 0

    def _free(self, world):
        """The world with the named effects in it, and their places in its list."""
        from vispeg.core.errors import UserError
        from vispeg.robots.model import load
        from vispeg.worlds.words import parse

        if not self.effects:
            if not world.effects:
                raise UserError(
                    "nothing to fit", key="--effects", expected="EFFECT:WHERE, or a model file with effects"
                )
            return world, tuple(range(len(world.effects)))
        robot, wanted = load(world.robot, tool=world.tool), {}
        here = {(e.effect, e.where): e for e in world.effects}
        for text in self.effects:
            for placed in parse(text, robot):
                at = (placed.effect, placed.where)
                wanted[at] = placed if text.count(":") > 1 else here.get(at, placed)
        world = world.add(*wanted.values())
        return world, tuple(i for i, e in enumerate(world.effects) if (e.effect, e.where) in wanted)
