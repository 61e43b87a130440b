"""The regression suite: named configurations in the training world and in a target, over versions of a policy.

`run` plays one version and writes OUT/suite.json and OUT/suite.html. `compare` takes such folders, oldest first: the
correlation between training world and target over the versions (healthy above 0.8, alarm below 0.6), and what fell from
the last but one to the last on the same seeds. A mean fall from training world to target that is above 5 points beyond
doubt is an alarm whatever the correlation. Both exit with 1 on an alarm, `compare` also on a regression, so that they
can guard CI.

Example:
    vispeg suite run runs/peg-depth/best --train S --target VNP --version 3 --out suite/v3
    vispeg suite run runs/peg-depth/best --train S --measured robot.csv --version 3 --out suite/v3
    vispeg suite compare suite/v1 suite/v2 suite/v3 --out suite/compared
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from vispeg.cli.output import Output, Told
from vispeg.core.interrupt import goes_on

if TYPE_CHECKING:
    from vispeg.evaluation.schema.estimate import Interval
    from vispeg.evaluation.schema.suite import VersionChange
    from vispeg.report.summary import Block


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
    seed: int = 0
    """Another number takes other episodes."""
    workers: int = 1
    """Processes."""
    overwrite: bool = False
    """Replace OUT's result."""
    output: Told = Output()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints health and table; 1 on an alarm."""
        from vispeg.api.playing import check_numbers
        from vispeg.cli import evaluation
        from vispeg.core.errors import UserError
        from vispeg.core.files import write_text_atomic
        from vispeg.evaluation import suite
        from vispeg.evaluation.entrants import refuse_trained_on
        from vispeg.evaluation.jobs import make_jobs, seeds_of
        from vispeg.evaluation.players import ready
        from vispeg.report.gap.suite_page import render
        from vispeg.task.world_file import load_world

        check_numbers(self.episodes, self.workers)
        if (self.target is None) == (self.measured is None):
            raise UserError("no target", expected="either --target WORLD or --measured CSV")
        who, listed = ready(self.policies), suite.configurations(self.suite)
        files = {w: load_world(w) for w in (self.train, self.target) if w is not None}
        worlds = {file.name: w for w, file in files.items()}
        hashes = {file.name: file.hash for file in files.values()} | ({"robot": ""} if self.measured else {})
        names = list(hashes)
        if len(names) < 2:
            raise UserError("training world and target are the same", got=names[0])
        if self.target is not None and not self.fine_tuned:
            target = files[self.target]
            refuse_trained_on(who, target.name, target.hash, target.path, training=files[self.train].path)
        known = [(e.name, e.train_seed) for e in who]
        robot = evaluation.measured(self.measured, known, "robot", [c["name"] for c in listed])
        read = [self.measured, self.suite, *(f.path for f in files.values()), *(e.path for e in who)]
        out = evaluation.open_folder(self.out, "suite.json", self.overwrite, read)
        jobs = make_jobs(who, suite.settings(listed, worlds), seeds_of(self.episodes, self.seed), out / "worlds")
        episodes = [*evaluation.play_all(jobs, out, self.workers, self.output.quiet), *robot.episodes]
        version = self.version or self.out.resolve().name
        values = suite.summarise(episodes, names[0], names[1], version, hashes) | {"notes": robot.notes}
        values = evaluation.write_result(out, "suite.json", values, self.seed, [e.path for e in who if e.path.exists()])
        page = write_text_atomic(out / "suite.html", render([values], []), overwrite=True)
        self.output.give(values, [*_summary(values), str(page)])
        return 1 if _alarm(values) else 0


@dataclass(frozen=True)
class Compare:
    """Compares versions, oldest first."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `vispeg suite run` wrote."""
    out: Path | None = None
    """Folder for compare.json and suite.html; nothing is written without."""
    overwrite: bool = False
    """Replace OUT's result."""
    output: Told = Output()

    def run(self) -> int:
        """Prints what fell and the health of every version; 1 on an alarm or a regression."""
        from vispeg.cli import evaluation
        from vispeg.core.errors import UserError
        from vispeg.core.files import write_text_atomic
        from vispeg.evaluation import suite
        from vispeg.evaluation.records import read
        from vispeg.evaluation.suite_file import read_result
        from vispeg.report.gap.suite_page import render

        if not self.folders:
            raise UserError("nothing to compare", expected="vispeg suite compare FOLDER [FOLDER ...]")
        versions = [read_result(folder) for folder in self.folders]
        notes = suite.other_worlds(versions)
        changes: list[VersionChange] = []
        if len(versions) > 1:
            before, after = (read(folder / "episodes.jsonl") for folder in self.folders[-2:])
            changes = suite.regressions(before, after)
        fell = [c for c in changes if c["verdict"] == "fell"]
        lines = [*(f"{v['version']}: {v['health']['words']}" for v in versions), *notes]
        for c in changes:
            if c["verdict"] in ("fell", "rose"):
                where = f"{c['policy']} in {c['world']}, {c['configuration']}"
                lines.append(f"{c['verdict']}: {where}: {_points(c['change'])}")
        if len(versions) > 1 and not fell:
            lines.append("no regression beyond doubt")
        values = {"format": "vispeg-suite-compare/1", "versions": versions, "changes": changes, "notes": notes}
        if self.out is not None:
            out = evaluation.open_folder(self.out, "compare.json", self.overwrite, self.folders)
            evaluation.write_result(out, "compare.json", values, 0, self.folders)
            page = write_text_atomic(out / "suite.html", render(versions, changes, notes), overwrite=True)
            lines.append(str(page))
        self.output.give(values, lines)
        return 1 if fell or _alarm(versions[-1]) else 0


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg suite`."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Run, tyro.conf.subcommand("run")] | Annotated[Compare, tyro.conf.subcommand("compare")]
    ]

    def run(self) -> int:
        """Runs the sub-command."""
        return self.command.run()


def _alarm(values: Mapping[str, Any]) -> bool:
    return values["health"]["status"] == "alarm"


def _summary(values: Mapping[str, Any]) -> list[str | Block]:
    from vispeg.cli.evaluation import table
    from vispeg.report.gap import words

    rows = [[r["policy"], r["configuration"], words.rate(r["train"]), words.rate(r["target"])] for r in values["rows"]]
    heads = ("policy", "configuration", values["train"], values["target"])
    return [table(heads, rows), values["health"]["words"], *values["notes"]]


def _points(change: Interval) -> str:
    from vispeg.report.gap import words

    return f"{words.lost(change)} points"
