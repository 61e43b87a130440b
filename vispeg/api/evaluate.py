"""`vispeg.evaluate`: evaluate policies in one world, on the same seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from vispeg.api.playing import Played, Playing, check_controls, check_numbers, folders, play, silent, stamped
from vispeg.core.cluster import Engine
from vispeg.core.errors import UserError
from vispeg.core.marker import apart
from vispeg.core.paths import expanded
from vispeg.evaluation import gap as gaps
from vispeg.evaluation import runner
from vispeg.evaluation.entrants import Policies
from vispeg.evaluation.films.media import film_failures
from vispeg.evaluation.folder import EPISODES, workplace
from vispeg.evaluation.jobs import Setting, make_jobs, seeds_of
from vispeg.evaluation.players import ready
from vispeg.evaluation.runner import names_of
from vispeg.report.gap import words
from vispeg.report.text.summary import Block, Line
from vispeg.report.text.tables import Column, Sheet
from vispeg.task.world_file import load_world


class EvaluationResult(Played):
    """Each policy's success with interval, time, peak force and kinds of failure; see `Played`."""

    command = holds = "evaluate"
    tables = ("success",)

    @property
    def summary(self) -> list[Block]:
        """One row per policy, what more episodes could resolve, and comparisons of the policies."""
        rows = self.record["success"]
        heads = ("policy", "success", "time", "peak force", "failures")
        out: list[Block] = [Sheet([Column(head) for head in heads], [_row(r) for r in rows])]
        out += [Line(words.conclusion(r), path=True) for r in rows if r["needed"]]
        for c in self.record["comparisons"]:
            text = f"{c['first']} - {c['second']}: {words.signed(c['difference'])} points, {c['verdict']}"
            out.append(Line(text, path=True))
        return out


def evaluate(
    policies: Policies,
    world: str | Path = "nominal",
    *,
    episodes: int = 100,
    controls: str | Sequence[str] = (),
    task: Mapping[str, Any] | None = None,
    videos: int = 0,
    seed: int = 0,
    workers: int = 1,
    engine: Engine = "local",
    out: str | Path | None = None,
    trials: str | Path | None = None,
    overwrite: bool = False,
    playing: Playing = silent,
) -> EvaluationResult:
    """Play policies in one world; return their success with 95 % intervals.

    A policy may also be a function of the observation or an object with `act(obs)`; several may be a mapping of names
    to these; see `vispeg.evaluation.own`. Without `out` nothing is written, so there are no videos.

    Args:
        policies: folders, names of bundled policies, NAME=FOLDER, `expert`, MODULE:CLASS, lerobot:FOLDER, .onnx or .zip
            files.
        world: a built-in world's name or a world file.
        episodes: number of episodes of every policy.
        controls: also play with images shuffled or frozen, or with a goal that never moves (GOAL_fixed).
        task: settings in place of the world's, such as `steps`.
        videos: number of failures of each policy to film; 0 for none.
        seed: seed of the episodes. The same seed gives the same starts and draws of the world.
        workers: number of processes.
        engine: where workers run: on this machine, or on a Ray cluster (the one at RAY_ADDRESS, if set).
        out: folder for the results, in which a stopped run continues.
        trials: keep each played episode without a control as a trial in this folder: joints, wrench, pictures, and the
            policy's actions.
        overwrite: replace the result in `out`.
        playing: shows progress.

    Raises:
        UserError: no such policy, world or control, or `out` holds other files.
    """
    check_numbers(episodes, workers)
    who, file = ready(policies), load_world(world)
    controls = check_controls(controls, file)
    sources = [file.path, *folders(who)]
    kept = None if trials is None else _kept(Path(trials), None if out is None else expanded(out), sources)
    with workplace(out, "evaluate.json", overwrite, sources) as place:
        settings = [Setting(str(world), file.name, task=dict(task or {}), control=c) for c in ("", *controls)]
        jobs = make_jobs(who, settings, seeds_of(episodes, seed), place / "worlds", profile=True)
        # under a control it is not the policy as it acts on a robot
        jobs = [job if job.control else replace(job, trials=kept) for job in jobs]
        ends = play(jobs, place, workers, playing, engine)
        values = gaps.gap(ends, file.name, seed=seed, scripted=[e.name for e in who if e.scripted])
        values["notes"] += [words.conclusion(r) for r in values["success"] if r["needed"]]
        filmed = out is not None and videos > 0
        media = film_failures(jobs, ends, place / "media", videos) if filmed else []
        result = EvaluationResult(
            stamped(values, seed, folders(who)), tuple(ends), tuple(media), tuple(sources), names_of(place / EPISODES)
        )
        if out is not None:
            result._write(place)
    return result


def _kept(trials: Path, out: Path | None, sources: Sequence[str | Path]) -> Path:
    """Return the folder for trials: new, empty, or of a continued evaluation. Raises UserError: it is none of these."""
    apart(trials, sources)
    goes_on = out is not None and (out / runner.EPISODES).exists()
    if trials.exists() and not (trials.is_dir() and (goes_on or not any(trials.iterdir()))):
        raise UserError("exists already; name another folder", file=trials, key="--keep-trials")
    return trials.absolute()


def _row(r: Mapping[str, Any]) -> list[str]:
    failures = ", ".join(f"{k} {v}" for k, v in sorted(r["categories"].items()) if k != "success")
    time = "-" if r["time"] is None else f"{r['time']:.1f} s"
    force = "-" if r["peak_force"] is None else f"{r['peak_force']:.0f} N"
    return [words.name(r), words.rate(r["success"]), time, force, failures]
