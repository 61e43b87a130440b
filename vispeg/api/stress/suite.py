"""`vispeg suite run`: the success of policies in a list of situations, in the training world and in a target.

The situations are called configurations, such as a coarser encoder or a late command. The result is one version of
the policies; `vispeg suite compare` compares several.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vispeg.api.playing import Playing, check_numbers, folders, other_tolerances, play, silent, stamped
from vispeg.api.stress.result import Stressed
from vispeg.core.cluster import Engine
from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.evaluation import suite as suites
from vispeg.evaluation.entrants import Entrant, Policies, refuse_trained_on
from vispeg.evaluation.folder import EPISODES, workplace
from vispeg.evaluation.jobs import make_jobs, seeds_of
from vispeg.evaluation.measured import Trials, read_csv
from vispeg.evaluation.players import ready
from vispeg.evaluation.runner import names_of
from vispeg.evaluation.schema.suite import Configuration
from vispeg.report.gap import words
from vispeg.report.gap.suite_page import render
from vispeg.report.text.summary import Block, Line
from vispeg.report.text.tables import Column, Sheet
from vispeg.task.world_file import WorldFile, load_world

ROBOT = "robot"  # name of a measured target


class SuiteResult(Stressed):
    """Success in each configuration, in the training world and in the target; see `Played` for the attributes.

    Its verdict, the health, says whether the training world ranks the configurations as the target does.
    """

    command = holds = "suite"

    @property
    def alarm(self) -> bool:
        """Whether success fell significantly, or the two worlds rank the configurations differently."""
        return self.record["health"]["status"] == "alarm"

    @property
    def summary(self) -> list[Block]:
        """One row per configuration, the health, and notes on a robot's records."""
        values = self.record
        heads = ("policy", "configuration", values["train"], values["target"])
        rows = [
            [r["policy"], r["configuration"], words.rate(r["train"]), words.rate(r["target"])] for r in values["rows"]
        ]
        lines = [values["health"]["words"], *values["notes"]]
        return [Sheet([Column(head) for head in heads], rows), *(Line(text, path=True) for text in lines)]

    def _render(self) -> str:
        return render([self.record], [])


def suite(
    policies: Policies,
    train: str | Path = "randomized",
    target: str | Path | None = None,
    *,
    measured: str | Path | None = None,
    configurations: str | Path | None = None,
    version: str = "",
    fine_tuned: bool = False,
    episodes: int = 20,
    seed: int = 0,
    workers: int = 1,
    engine: Engine = "local",
    out: str | Path | None = None,
    overwrite: bool = False,
    playing: Playing = silent,
) -> SuiteResult:
    """Play one version of policies in every configuration, in the training world and in the target.

    Args:
        policies, seed, workers, engine, out, overwrite, playing: as in `vispeg.evaluate`.
        train: the training world.
        target: the target world.
        measured: a real robot's trials in place of a target: CSV with the suite's names under `configuration`.
        configurations: your own suite, `format: vispeg-suite/1`.
        version: name of this version; default: the name of `out`.
        fine_tuned: allow policies that were trained or fine-tuned in the target.
        episodes: number of episodes per configuration and world.

    Raises:
        UserError: as for `vispeg.evaluate`; not exactly one target, the training world as target, an impossible
            configuration, or a policy that was trained in the target.
    """
    check_numbers(episodes, workers)
    if (target is None) == (measured is None):
        raise UserError("needs exactly one target", expected="either --target WORLD or --measured CSV")
    who = ready(policies)
    chosen = suites.configurations(None if configurations is None else Path(configurations))
    worlds = [w for w in (train, target) if w is not None]
    files = [load_world(w) for w in worlds]
    hashes = {file.name: file.hash for file in files} | ({ROBOT: ""} if measured is not None else {})
    if len(hashes) < 2:
        raise _of_one_name(files)
    names = list(hashes)
    if target is not None and not fine_tuned:
        home, other = files
        refuse_trained_on(who, other.name, other.hash, other.path, training=home.path)
    trials = _measured(measured, who, chosen)
    notes = [*trials.notes, *other_tolerances(who, files)]
    measured_files = [Path(p) for p in (measured, configurations) if p is not None]
    read = [*measured_files, *(f.path for f in files), *folders(who)]
    with workplace(out, "suite.json", overwrite, read) as place:
        settings = suites.settings(chosen, {file.name: str(w) for file, w in zip(files, worlds, strict=True)})
        jobs = make_jobs(who, settings, seeds_of(episodes, seed), place / "worlds")
        ends = [*play(jobs, place, workers, playing, engine), *trials.episodes]
        version_name = version or ("" if out is None else expanded(out).resolve().name)
        about = {**suites.summarise(ends, names[0], names[1], version_name, hashes), "notes": notes}
        record, played_names = stamped(about, seed, folders(who)), names_of(place / EPISODES)
        result = SuiteResult(record, tuple(ends), sources=tuple(read), names=played_names)
        if out is not None:
            result._write(place)
    return result


def _of_one_name(files: Sequence[WorldFile]) -> UserError:
    """Return the error for a training world with the name of the target: results are kept by the worlds' names."""
    name, hashes = files[0].name, {file.hash for file in files}
    if len(files) == 1:
        return UserError("the training world has the robot's name", key="--train", got=name, expected="another name")
    if len(hashes) == 1:
        return UserError("training world and target are the same", got=name)
    other = f"another name than that of {files[0].path}"
    return UserError("two worlds of one name", file=files[1].path, key="name", got=name, expected=other)


def _measured(csv: str | Path | None, who: Sequence[Entrant], chosen: Sequence[Configuration]) -> Trials:
    """Read a real robot's trials of these policies in these configurations; empty without a file."""
    seeds: dict[str, set[int]] = {}
    for e in who:
        seeds.setdefault(e.name, set()).add(e.train_seed)
    return Trials() if csv is None else read_csv(Path(csv), ROBOT, seeds, [c["name"] for c in chosen])
