"""Fits the parameters of named effects, with 95 % intervals.

An effect is EFFECT:WHERE; WHERE `all` fits one value for all places, `each` one for each. Without --effects, those of
the model file are fitted. Writes OUT/fit.json, OUT/model.yaml, OUT/report.html and, for joints, OUT/evidence.npz. A
stopped fit goes on with --resume.

`--protocol paper` fits link masses, joint damping and the direction of gravity by CMA-ES to the flange's path in short
sub-trajectories of one recording under operational space control (`vispeg record --motion osc`), with
intervals; parameters that the path does not determine are named.

Example:
    vispeg fit iiwa14 --recording rig-a --recording rig-b --validate rig-c \\
        --effects coulomb_friction:joint4 payload:flange --out fitted
    vispeg fit model.yaml --recording rig-a --effects viscous_friction:each --starts 4 --out fitted
    vispeg fit iiwa14 --protocol paper --recording osc-run --out fitted
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro

from vispeg.cli.output import Output, OutputOptions
from vispeg.core.interrupt import goes_on
from vispeg.recordings.windows import SECONDS

if TYPE_CHECKING:
    from vispeg.api.fit import FitResult
    from vispeg.api.fit_paper import PaperFit


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg fit`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF."""
    out: Path
    """Folder for the results."""
    recording: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Recordings to fit."""
    validate: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Held-out recordings, never fitted."""
    effects: tuple[str, ...] = ()
    """Effects to fit, each EFFECT:WHERE[:param=start,...]; other starts: the model's values, else typical ones."""
    channels: tuple[Literal["joints", "contact", "pictures"], ...] = ()
    """The evidence to fit to; default: what `vispeg diagnose` looks in."""
    seconds: float = SECONDS
    """Of longer recordings, use the most informative windows, this many seconds in all; 0 uses everything."""
    method: Literal["auto", "least-squares", "cma"] = "auto"
    """auto: least squares, with CMA-ES before it if an effect is not smooth."""
    iterations: int | None = None
    """Most steps; default: 15 (and ten times as many generations of CMA-ES), 120 generations for `paper`."""
    starts: int = 1
    """Number of random starts; the best result counts."""
    protocol: Literal["effects", "paper"] = "effects"
    """Fit named effects to recordings, or the paper's protocol."""
    seed: int = 0
    """Seed of the random starts and of CMA-ES."""
    threads: int = 2
    """Threads of the simulation."""
    resume: bool = False
    """Go on with a fit that was stopped."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    @goes_on("--resume")
    def run(self) -> int:
        """Fits, writes the folder, prints values with intervals."""
        from vispeg.api.inputs import model_files
        from vispeg.core.files import reserved
        from vispeg.report.text.summary import Line

        inputs = (*model_files(self.model), *self.recording, *self.validate)
        with reserved(self.out, self.overwrite, holds="fit", inputs=inputs):
            result = self._paper() if self.protocol == "paper" else self._effects()
            result.save(self.out, overwrite=self.overwrite)
        where = [f"model: {self.out / 'model.yaml'}"]
        where += [f"picture: {path}" for path in sorted(self.out.glob("paths-*.png"))]
        self.output.give(result.record, [*result.summary, *(Line(text, path=True) for text in where)])
        return 0

    def _effects(self) -> FitResult:
        from vispeg.api.fit import fit
        from vispeg.cli.models.fit_progress import following
        from vispeg.identify.calibrate import ITERATIONS

        steps = ITERATIONS if self.iterations is None else self.iterations
        options = {"seconds": self.seconds, "method": self.method, "iterations": steps, "starts": self.starts}
        with following(self.starts, steps, self.output.quiet) as watch:
            more = {**self._common(), **options, "channels": self.channels}
            return fit(self.model, self.recording, self.effects, self.validate, watch=watch, **more)

    def _paper(self) -> PaperFit:
        from vispeg.api.fit_paper import fit_paper
        from vispeg.cli.models.fit_progress import generations
        from vispeg.core.errors import UserError
        from vispeg.identify.paper.protocol import GENERATIONS

        if self.effects:
            raise UserError("the paper's protocol has its own parameters", key="--effects", expected="none")
        if len(self.recording) != 1:
            got = len(self.recording)
            raise UserError("the paper's protocol fits one recording", key="--recording", expected=1, got=got)
        steps = GENERATIONS if self.iterations is None else self.iterations
        with generations(steps, self.output.quiet) as watch:
            options = {**self._common(), "iterations": steps}
            return fit_paper(self.model, self.recording[0], self.validate, watch=watch, **options)

    def _common(self) -> dict[str, Any]:
        """Give what both protocols take."""
        from vispeg.cli.reading import reading_bars

        part = self.out.with_name(self.out.name + ".part")
        options = {"seed": self.seed, "threads": self.threads, "part": part, "resume": self.resume}
        return {**options, "reading": reading_bars(self.output.quiet)}
