"""What the commands on success share: playing with a progress bar, the table for a person, the folder of results."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vispeg.core.files import write_text_atomic
from vispeg.core.lock import claim
from vispeg.core.provenance import provenance
from vispeg.evaluation.folder import prepare, refuse
from vispeg.evaluation.jobs import Job
from vispeg.evaluation.records import Episode

if TYPE_CHECKING:
    from vispeg.report.tables import Sheet


def open_folder(out: Path, result: str, overwrite: bool, inputs: Iterable[str | Path | None] = ()) -> Path:
    """The folder of `evaluation.folder.prepare`; until the command ends, no other process may write there."""
    inputs = tuple(inputs)
    refuse(out, result, inputs)
    claim(out)
    return prepare(out, result, overwrite, inputs)


def play_all(jobs: Sequence[Job], out: Path, workers: int, quiet: bool) -> list[Episode]:
    """All episodes of the jobs, with a bar for each policy, and the success so far."""
    from vispeg.cli.progress import playing
    from vispeg.evaluation import runner

    with playing(jobs, out, quiet) as watch:
        return runner.run(jobs, out, workers, watch=watch)


def write_result(
    out: Path, name: str, values: Mapping[str, Any], seed: int, inputs: Iterable[str | Path]
) -> dict[str, Any]:
    """OUT/NAME with its provenance; returns what was written."""
    record = {**values, "provenance": provenance(sys.argv, seed, inputs)}
    write_text_atomic(out / name, json.dumps(record, indent=1, allow_nan=False) + "\n", overwrite=True)
    return record


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Sheet:
    """A plain table."""
    from vispeg.report.tables import Column, Sheet

    return Sheet([Column(head) for head in heads], list(rows))


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
