"""Episodes that an earlier run wrote, for one that plays only what they lack."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.evaluation.jobs import Job
from vispeg.evaluation.records import Episode, append, read
from vispeg.evaluation.runner import EPISODES, RUN, read_names


def check(jobs: Sequence[Job], stored: Iterable[Episode], files: Iterable[Path]) -> None:
    """Raise UserError where `stored`, read from `files`, would stand beside other policies or worlds of the same name.

    Which policies they were made with, the run.json beside a file tells; a file without one is believed.
    """
    hashes = {(j.world_name, j.configuration, j.control): j.world_hash for j in jobs}
    for e in stored:
        name = (e.world, e.configuration, e.control)
        if hashes.get(name, e.world_hash) != e.world_hash:
            raise UserError(
                "the records are from another world of this name",
                key=" / ".join(filter(None, name)),
                expected=hashes[name][:12],
                got=e.world_hash[:12],
            )
    digests = {f"{j.entrant.name}/s{j.entrant.train_seed}": j.entrant.digest for j in jobs}
    for file in files:
        for name, digest in _made_with(file).items():
            if digests.get(name, digest) != digest:
                message = f"the records are from another policy than the {name} that is given"
                raise UserError(message, file=file, expected=digests[name][:12], got=digest[:12])


def take_in(stored: Iterable[Episode], out: Path) -> None:
    """Write what is `stored` into the folder of a run, which then has nothing to play for it."""
    path = out / EPISODES
    have = {e.key for e in read(path)} if path.exists() else set()
    append(path, [e for e in stored if e.key not in have])


def _made_with(file: Path) -> Mapping[str, str]:
    path = Path(file).parent / RUN
    return read_names(path)["policies"] if path.exists() else {}
