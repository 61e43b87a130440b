"""Runs a regression suite: named configurations in the training world and in a target, over versions of a policy.

`run` plays one version and writes OUT/suite.json and OUT/suite.html. `compare` takes such folders, oldest first: the
correlation between training world and target over the versions (healthy above 0.8, alarm below 0.6), and what fell from
the last but one to the last on the same seeds. A mean loss from training world to target that is above 5 points with
95 % confidence is an alarm too. Both exit with 1 on an alarm, `compare` also on a regression, so that CI can use them.

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
from vispeg.cli.output import Output, OutputOptions
from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Run:
    """Plays the suite with one version."""

    policies: tyro.conf.Positional[tuple[str, ...]]
    """Policy folders, or NAME=FOLDER."""
    out: Path
    """Folder for the results."""
    train: str = "randomized"
    """The training world."""
    target: str | None = None
    """The target world."""
    measured: Path | None = None
    """A real robot's records in place of a target: CSV with the suite's names under `configuration`."""
    suite: Path | None = None
    """A suite of your own, `format: vispeg-suite/1`."""
    version: str = ""
    """The name of this version; OUT's name where not given."""
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
    """Folder for compare.json and suite.html; without it nothing is written."""
    overwrite: bool = False
    """Replace OUT's result."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Prints what fell and the health of every version; 1 on an alarm or a regression."""
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

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Run, tyro.conf.subcommand("run")] | Annotated[Compare, tyro.conf.subcommand("compare")]
    ]

    def run(self) -> int:
        """Runs the sub-command."""
        return self.command.run()
