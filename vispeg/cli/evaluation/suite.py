"""Runs a regression suite over the versions of a policy.

`run` plays one version in the training world and in a target, in named configurations, and writes OUT/suite.json and
OUT/suite.html. `compare` reads such folders, oldest first: the correlation between training world and target over the
versions (healthy above 0.8, alarm below 0.6), and regressions of the last version on the same seeds. A mean loss above
5 points with 95 % confidence is an alarm too. Exit code 1 on an alarm or a regression, for CI.

Example:
    vispeg suite run runs/{task}-depth/best --train S --target VNP --version 3 --out suite/v3
    vispeg suite run runs/{task}-depth/best --train S --measured robot.csv --version 3 --out suite/v3
    vispeg suite compare suite/v1 suite/v2 suite/v3 --out suite/compared
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from vispeg.cli.evaluation.trials import Played, Trials
from vispeg.cli.options import subcommand
from vispeg.cli.output import Output, OutputOptions
from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Run:
    """Plays the suite with one version."""

    policies: tyro.conf.Positional[tuple[str, ...]]
    """Policy folders, NAME=FOLDER, MODULE:CLASS, lerobot:FOLDER, .onnx or .zip files."""
    out: Path
    """Folder for the results."""
    train: str = "randomized"
    """The training world."""
    target: str | None = None
    """The target world."""
    measured: Path | None = None
    """A real robot's trials in place of a target: CSV with the suite's names under `configuration`."""
    suite: Path | None = None
    """A suite of your own, `format: vispeg-suite/1`."""
    version: str = ""
    """Name of this version; default: OUT's name."""
    fine_tuned: bool = False
    """Allow policies that were trained or fine-tuned in the target."""
    episodes: int = 20
    """Episodes a configuration and world."""
    trials: Played = Trials()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints health and table; 1 on an alarm."""
        from vispeg.api.stress.suite import suite

        result = suite(
            self.policies,
            self.train,
            self.target,
            measured=self.measured,
            configurations=self.suite,
            version=self.version,
            fine_tuned=self.fine_tuned,
            episodes=self.episodes,
            **self.trials.options(self.out),
        )
        self.trials.give(result, self.out / "suite.html")
        return 1 if result.alarm else 0


@dataclass(frozen=True)
class Compare:
    """Compares versions, oldest first."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `vispeg suite run` wrote."""
    out: Path | None = None
    """Folder for compare.json and suite.html; default: write nothing."""
    overwrite: bool = False
    """Replace the result in OUT."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print what fell and the health of every version; 1 on an alarm or a regression."""
        from vispeg.api.stress.versions import compare_versions
        from vispeg.core.errors import UserError
        from vispeg.report.text.summary import Line

        if not self.folders:
            raise UserError("nothing to compare", expected="vispeg suite compare FOLDER [FOLDER ...]")
        result = compare_versions(self.folders)
        lines = result.summary
        if self.out is not None:
            lines.append(Line(str(result.save(self.out, overwrite=self.overwrite) / "suite.html"), path=True))
        self.output.give(result.record, lines)
        return 1 if result.alarm else 0


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg suite`."""

    command: tyro.conf.OmitSubcommandPrefixes[Annotated[Run, subcommand(Run)] | Annotated[Compare, subcommand(Compare)]]

    def run(self) -> int:
        """Run the sub-command."""
        return self.command.run()
