"""Run jobs in worker processes of one thread each, and store the episodes of a job as soon as it is done."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from vispeg.core.cluster import Engine, on_ray
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.core.workers import pool_of
from vispeg.demonstrations.plan import images_of
from vispeg.evaluation.arena import play
from vispeg.evaluation.entrants import OBJECT, Entrant
from vispeg.evaluation.folder import EPISODES, RUN
from vispeg.evaluation.jobs import IMAGE_ROWS, Job, has_eyes
from vispeg.evaluation.records import Episode, append, read
from vispeg.formats.format import enrol
from vispeg.formats.json_data import read_json
from vispeg.render.backends.backend import jobs_a_process
from vispeg.task.registry import config_of
from vispeg.task.world_file import load_world

DIVERGED = "diverged"  # folder of episodes whose simulation diverged, to be replayed
Names = dict[str, dict[str, str]]  # `policies`, `worlds`, and `images` of the looks of worlds: name -> hash
Arena = Callable[[Job], list[Episode]]
J = TypeVar("J", bound=Job)
R = TypeVar("R")
Watch = Callable[[list[Episode], int, int], None]


def run(
    jobs: Sequence[Job],
    out: Path,
    workers: int = 1,
    arena: Arena = play,
    watch: Watch = lambda new, done, total: None,
    engine: Engine = "local",
) -> list[Episode]:
    """Play the episodes that are not yet in OUT/episodes.jsonl; return all episodes in the order of the jobs.

    Args:
        jobs: the jobs to play.
        out: the run's folder; a stopped run in it is resumed.
        workers: number of processes; with 0 or 1 jobs run in this process, except in worlds that Filament renders.
        arena: function that plays one job; it is sent to workers by name.
        watch: called with the new episodes, the number of episodes done, and the total.
        engine: where the processes run: on this machine, or on a Ray cluster whose nodes see `out` at the same path.

    Raises:
        UserError: two policies or worlds of one name, or OUT holds episodes of others under the same names; or what a
            job raises.
    """
    path = out / EPISODES
    names = _names_of_run(jobs, out)
    have = {e.key: e for e in read(path)} if path.exists() else {}
    total = sum(len(job.seeds) for job in jobs)
    todo = []
    for job in jobs:
        missing = tuple(s for s, key in zip(job.seeds, job.keys(), strict=True) if key not in have)
        todo += replace(job, seeds=missing, dump=out / DIVERGED).split(max(job.rows, IMAGE_ROWS)) if missing else []
    done = total - sum(len(job.seeds) for job in todo)
    watch([], done, total)
    for played in each(todo, workers, arena, engine):  # nothing is written before the first job has succeeded
        write_text_atomic(out / RUN, names, overwrite=True)
        append(path, played)
        have |= {e.key: e for e in played}
        done += len(played)
        watch(played, done, total)
    write_text_atomic(out / RUN, names, overwrite=True)
    return [have[key] for job in jobs for key in job.keys()]


def each(todo: Sequence[J], workers: int, arena: Callable[[J], R], engine: Engine = "local") -> Iterator[R]:
    """Do jobs in worker processes; yield each result of `arena` as soon as it is there, in any order.

    Args:
        todo: the jobs.
        workers, engine: as in `run`.
        arena: function that does one job; it is sent to workers by name.

    Raises:
        UserError: a policy object cannot be sent to another process; or what a job raises.
    """
    backends = {str(load_world(world).renderer.get("backend", "auto")) for world in {job.world for job in todo}}
    tasks = min(filter(None, map(jobs_a_process, backends)), default=None)
    if engine == "local" and not tasks and (workers < 2 or len(todo) < 2):
        yield from (arena(job) for job in todo)
        return
    for who in {id(job.entrant.source): job.entrant for job in todo if not job.entrant.stored}.values():
        _sendable(who, "MODULE:CLASS" if tasks or engine == "ray" else "MODULE:CLASS, or workers=1")
    if engine == "ray":
        yield from (result for _, result in on_ray(arena, todo, workers, what="part", tasks=tasks))
        return
    with pool_of(max(1, min(workers, len(todo))), tasks) as pool:
        waiting: Iterable[Future[R]] = [pool.submit(arena, job) for job in todo]
        while waiting:
            finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()


def _sendable(who: Entrant, expected: str) -> None:
    """Raise UserError for a policy object that cannot be sent to another process, with what is expected instead."""
    try:
        pickle.dumps(who.source)
    except Exception as error:  # pickle and what it calls raise many kinds
        what = f"{who.name} cannot be sent to another process, as workers and worlds rendered by Filament require"
        raise UserError(what, expected=expected, got=str(error)[:100]) from error


def _names_of_run(jobs: Sequence[Job], out: Path) -> str:
    """Return the content of run.json, the hashes behind the names of policies and worlds, and of the looks' images.

    Raises:
        UserError: a name stands for two hashes, in these jobs or in the folder and in these jobs.
    """
    now = _no_names()
    for j in jobs:
        policy = f"{j.entrant.name}/s{j.entrant.train_seed}"
        world = "/".join(filter(None, (j.world_name, j.configuration, j.control)))
        for kind, name, value in (("policies", policy, j.entrant.digest), ("worlds", world, j.world_hash)):
            if now[kind].setdefault(name, value) != value:
                raise UserError("two of one name; play them in runs of their own", key=kind, got=name)
    now["images"] = _images(jobs)
    return text_of(_merged(_stored_names(out), now, "when this folder was begun; name another folder", out))


def _no_names() -> Names:
    return {"policies": {}, "worlds": {}, "images": {}}


def _images(jobs: Sequence[Job]) -> dict[str, str]:
    """Return world -> digest of the images from which its looks draw, for worlds in which a policy sees images."""
    out = {}
    for world, name in {(j.world, j.world_name) for j in jobs if has_eyes(j.entrant)}:
        file = load_world(world)
        if digest := images_of(file, config_of(file.task).cameras):
            out[name] = digest
    return out


def _merged(names: Names, more: Names, when: str, file: Path) -> Names:
    """Return `names` with those of `more` added.

    Raises:
        UserError: a name of `more` stands for another hash in `names`; it names `file` and says `when`.
    """
    out = {kind: dict(values) for kind, values in names.items()}
    for kind, values in more.items():
        for name, value in values.items():
            if (there := out[kind].setdefault(name, value)) != value:
                raise UserError(
                    f"{name} stood for another one {when}", file=file, key=kind, expected=there[:12], got=value[:12]
                )
    return out


def _stored_names(folder: Path) -> Names:
    """Return the names in a folder's run.json; none without one."""
    return read_names(folder / RUN) if (folder / RUN).exists() else _no_names()


def text_of(names: Names) -> str:
    """Return the content of run.json."""
    return json.dumps(names, indent=2) + "\n"


def _example(folder: Path) -> Path:
    names = {"policies": {"a/s0": "0" * 64}, "worlds": {"S": "1" * 64}}
    return write_text_atomic(folder / RUN, json.dumps(names) + "\n")


@enrol("run.json", _example)
def read_names(path: Path) -> Names:
    """Return the hashes behind the names in a run's folder.

    Raises:
        UserError: the file cannot be read, or is not a run's record.
    """
    data = read_json(path)
    tables: dict[str, Any] = {}
    for kind in _no_names():
        names = tables[kind] = data.get(kind, {}) if isinstance(data, dict) else None
        if not isinstance(names, dict) or not all(isinstance(value, str) for value in names.values()):
            raise UserError("is not the record of a run", file=path, key=kind, expected="names and hashes", got=names)
    return tables


def failures(episodes: Iterable[Episode], most: int) -> list[Episode]:
    """Return up to `most` failures, one of each category in turn, so that rare categories are included."""
    by_category: dict[str, list[Episode]] = {}
    for e in episodes:
        if not e.success:
            by_category.setdefault(e.category, []).append(e)
    chosen: list[Episode] = []
    while len(chosen) < most and any(by_category.values()):
        for left in by_category.values():
            if left and len(chosen) < most:
                chosen.append(left.pop(0))
    return chosen


def check_stored(jobs: Sequence[Job], stored: Iterable[Episode], files: Sequence[Path]) -> None:
    """Raise UserError where stored episodes have the name of a job's policy or world, but come from another one.

    The same holds for the images of a world's looks.

    Args:
        jobs: the jobs of the run.
        stored: stored episodes.
        files: the files they were read from. The run.json next to a file has the hashes of its policies; for a file
            without one, policies are not checked.
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
    images = _images(jobs) if files else {}
    for file in files:
        for name, digest in _stored_names(Path(file).parent)["images"].items():
            if images.get(name, digest) != digest:
                what = f"the records are from other images for the looks of {name}"
                raise UserError(what, file=file, expected=images[name][:12], got=digest[:12])
    digests = {f"{j.entrant.name}/s{j.entrant.train_seed}": j.entrant.digest for j in jobs}
    for file in files:
        for name, digest in made_with(file).items():
            if digests.get(name, digest) != digest:
                message = f"the records are from another policy than the {name} that is given"
                raise UserError(message, file=file, expected=digests[name][:12], got=digest[:12])


def take_in(stored: Iterable[Episode], names: Names, out: Path) -> None:
    """Write stored episodes, and the hashes behind their names, into a run's folder, which does not play them again.

    Raises:
        UserError: the folder has other hashes for these names.
    """
    path = out / EPISODES
    both = _merged(_stored_names(out), names, "when this folder was begun; name another folder", out)
    have = {e.key for e in read(path)} if path.exists() else set()
    append(path, [e for e in stored if e.key not in have])
    write_text_atomic(out / RUN, text_of(both), overwrite=True)


def made_with(file: Path) -> Mapping[str, str]:
    """Return the digests of the policies that played a file of episodes, NAME/sSEED -> digest; empty if not known."""
    return _stored_names(Path(file).parent)["policies"]


def names_of(*files: Path) -> Names:
    """Return the hashes behind the names in files of episodes, as far as another process can compare them.

    Raises:
        UserError: a name stands for two hashes, or the run.json beside a file is not one.
    """
    out = _no_names()
    for file in files:
        names = _stored_names(Path(file).parent)
        known = {name: value for name, value in names["policies"].items() if not value.startswith(OBJECT)}
        out = _merged(out, {**names, "policies": known}, "in the files before; play it under a name of its own", file)
    return out
