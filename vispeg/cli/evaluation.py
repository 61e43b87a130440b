"""What the commands on success share: playing with a progress bar, the table for a person, the folder of results."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from vispeg.core.disk import written
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.core.lock import claim
from vispeg.core.marker import apart, holds, mark
from vispeg.core.provenance import provenance
from vispeg.formats.json_data import read_json


def open_folder(out: Path, result: str, overwrite: bool, inputs: Iterable[str | Path | None] = ()) -> Path:
    """The folder of results: new, one in which the same command was stopped, or one whose result may be replaced.

    Until the command ends, no other process may write there.

    Args:
        out: where.
        result: name of the file that stands there once all is done.
        overwrite: whether a finished result is replaced.
        inputs: what the command reads; `out` may be none of it, nor a folder above.

    Raises:
        UserError: a finished result is there and `overwrite` is False, or files of something else are, or another
            process writes there, or nothing can be written.
    """
    kind = Path(result).stem
    apart(out, inputs)
    if out.is_file() or (out.is_dir() and any(out.iterdir()) and _kind(out) not in (kind, "")):
        raise UserError("is not a folder of such results", file=out, expected="a new or empty folder, or one of a run")
    claim(out)
    page = out / ("suite.html" if kind == "compare" else f"{kind}.html")
    done = (out / result).exists() and (page.exists() or holds(out) is None)  # the page comes last; once it had others
    if done and not overwrite:
        raise UserError("exists already; name another folder or pass --overwrite", file=out / result)
    if done:  # a new run, so nothing of the old one is continued
        for old in (page.name, result, "episodes.jsonl", "run.json"):
            with written(out / old):
                (out / old).unlink(missing_ok=True)
    with written(out):
        out.mkdir(parents=True, exist_ok=True)
        mark(out, kind, files=())
    return out


def _kind(out: Path) -> str | None:
    """What a folder holds by its marker; "" if it is of a version without, None if it is not of a run at all."""
    if (found := holds(out)) is not None:
        return found
    try:
        known = read_json(out / "run.json")
    except UserError:
        return None
    return "" if isinstance(known, dict) and {"policies", "worlds"} <= set(known) else None


def play_all(jobs: Sequence[Any], out: Path, workers: int, quiet: bool) -> list[Any]:
    """All episodes of the jobs, with a bar for each policy, and the success so far."""
    from vispeg.cli.progress import bars
    from vispeg.evaluation.records import read
    from vispeg.evaluation.runner import EPISODES, run

    totals: dict[str, int] = {}
    for job in jobs:
        totals[job.entrant.name] = totals.get(job.entrant.name, 0) + len(job.seeds)
    before = {e.key for e in read(out / EPISODES)} if (out / EPISODES).exists() else set()
    wins = [0, 0]
    with bars(totals, "episodes", quiet) as advance:
        for job in jobs:
            advance(job.entrant.name, sum(key in before for key in job.keys()), known=True)

        def watch(new: list[Any], *_: int) -> None:
            wins[0], wins[1] = wins[0] + sum(e.success for e in new), wins[1] + len(new)
            if new:
                rate = f"{100 * wins[0] / wins[1]:.0f} % of the new ones succeed"
                advance(new[0].policy, len(new), f"{rate}, now {new[0].policy} in {new[0].world}")

        return run(jobs, out, workers, watch=watch)


def write_result(
    out: Path, name: str, values: Mapping[str, Any], seed: int, inputs: Iterable[str | Path]
) -> dict[str, Any]:
    """OUT/NAME with its provenance; returns what was written."""
    record = {**values, "provenance": provenance(sys.argv, seed, inputs)}
    write_text_atomic(out / name, json.dumps(record, indent=1, allow_nan=False) + "\n", overwrite=True)
    return record


def print_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A plain table."""
    from vispeg.report.tables import Column, Sheet, terminal

    terminal().print(Sheet([Column(head) for head in heads], list(rows)))


def check_episodes(episodes: int, workers: int) -> None:
    """Raises UserError for numbers that make no sense."""
    if episodes < 1:
        raise UserError("no episodes", key="--episodes", expected="1 or more", got=episodes)
    if workers < 1:
        raise UserError("no workers", key="--workers", expected="1 or more", got=workers)


def at_clearance(who: Iterable[Any], world: Any, clearance: float | None) -> dict[str, Any]:
    """The task of `world` that `--clearance` changes; says which policies were made for another clearance than that.

    Args:
        who: entrants.
        world: what they are judged in.
        clearance: diametral, mm, in place of the world's; None for the world's own.
    """
    from vispeg.task.registry import config_of

    task = {} if clearance is None else {"clearance_mm": clearance}
    here = getattr(config_of({**world.task, **task}), "clearance_mm", None)
    for e in who:
        if e.clearance_mm not in (None, here):
            print(f"{e.name} was made for {e.clearance_mm:g} mm, here it is {here:g} mm (--clearance)", file=sys.stderr)
    return task


def measured(
    csv: Path | None, policies: Iterable[tuple[str, int]], world: str, configurations: Sequence[str] = ()
) -> Any:
    """A real robot's `Trials` of `policies` (name, training seed), under the name `world`; none without a file."""
    from vispeg.evaluation.measured import Trials, read_csv

    seeds: dict[str, set[int]] = {}
    for name, seed in policies:
        seeds.setdefault(name, set()).add(seed)
    return Trials() if csv is None else read_csv(csv, world, seeds, configurations)
