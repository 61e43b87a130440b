"""Render a dataset from a plan: make missing shards, place them, and give the finished folder its name.

A rendering is kept in `NAME.unfinished` beside its folder. If stopped at any moment, it continues there and ends with
the same bytes.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder, refuse, remove_abandoned, write_bytes_atomic, write_text_atomic
from vispeg.core.paths import expanded
from vispeg.core.provenance import version_of
from vispeg.datasets.layout import Layout
from vispeg.datasets.lerobot import DATA, EPISODES, finish, path_of, place
from vispeg.datasets.shards.engine import Engine, local
from vispeg.datasets.shards.plan import Plan, Shard
from vispeg.datasets.shards.shard import Source
from vispeg.formats.json_data import read_json

Watch = Callable[[int], None]
Export = Callable[[Path, Path], None]
PLAN, PARTS = "plan.json", "shards"
LAYOUT = 2  # version of the files of a rendering; an unfinished one of another version cannot be continued
VERSIONS = ("vispeg", "mujoco", "numpy", "opencv-python-headless", "pyarrow")  # other versions may make other bytes


def render(
    plan: Plan,
    layout: Layout,
    source: Source,
    out: str | Path,
    *,
    engine: Engine = local,
    workers: int = 1,
    watch: Watch = lambda frames: None,
    export: Export | None = None,
    provenance: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Render a dataset into `out` and return it.

    Args:
        plan, layout, source: content and format of the dataset, and the function that makes a shard's episodes.
        out: the folder, new or empty; with `overwrite`, an existing dataset is replaced once the new one is complete.
        engine: makes shards: `engine.local` or `engine.on_ray`.
        workers: number of processes.
        watch: called with numbers of frames done; first with those of an earlier run.
        export: called with the LeRobot folder and an empty folder, to write another format.
        provenance: provenance to record in `meta/render.json`.

    Raises:
        UserError: `out` holds other files, an unfinished rendering has other settings, the disk is full, or an error of
            the source. Finished shards are kept.
    """
    target = expanded(out)
    refuse(target, overwrite, holds="dataset", inputs=(plan.world,))
    work = target.resolve().with_name(target.resolve().name + ".unfinished")
    _begin(work, plan)
    placer = _Placer(work, plan, layout)
    watch(sum(s.frames for s in plan.shards if s.number not in placer.missing))
    wanted = [s for s in plan.shards if s.number in placer.missing]
    for shard, data in engine(wanted, source, plan, layout, workers, watch):
        write_bytes_atomic(placer.part(shard), data, overwrite=True)
        placer.advance()
    placer.advance()
    finish(work, plan, layout, provenance or {})
    with new_folder(target, overwrite=overwrite, holds="dataset") as folder:
        try:
            (export or _take_over)(work, folder)
        except OSError as error:
            raise UserError(f"cannot be written: {error.strerror}; {work} is kept", file=out) from error
    shutil.rmtree(work, ignore_errors=True)
    return Path(out)


class _Placer:
    """Place shards in order; a shard that is finished early waits in `shards/`."""

    def __init__(self, folder: Path, plan: Plan, layout: Layout):
        self.folder, self.plan, self.layout = folder, plan, layout
        self.next, self.episodes = 0, 0
        self.advance()
        self.missing = {s.number for s in plan.shards[self.next :] if not self.part(s).is_file()}

    def part(self, shard: Shard) -> Path:
        """Return the path at which a finished shard waits."""
        return self.folder / PARTS / f"{shard.number:05d}.parquet"

    def advance(self) -> None:
        """Place every shard whose turn it is."""
        import pyarrow.parquet as pq

        for shard in self.plan.shards[self.next :]:
            if (self.folder / path_of(DATA, shard.number)).is_file():
                self.episodes += pq.read_metadata(self.folder / path_of(EPISODES, shard.number)).num_rows
            elif self.part(shard).is_file():
                self.episodes += place(
                    self.folder, self.part(shard), self.layout, shard.number, self.episodes, shard.first
                )
            else:
                return
            self.part(shard).unlink(missing_ok=True)
            self.next += 1


def _begin(work: Path, plan: Plan) -> None:
    """Make the folder of a rendering, or check that an existing one has the same plan."""
    path = work / PLAN
    now = {**plan.to_json(), "layout": LAYOUT, **{f"version of {name}": version_of(name) for name in VERSIONS}}
    if work.is_dir():
        remove_abandoned(path)  # left if an earlier run was killed while it wrote this first file
    if not work.exists() or not any(work.iterdir()):
        write_text_atomic(path, json.dumps(now, indent=2) + "\n")
        return
    try:
        before = read_json(path)
    except UserError as error:
        raise UserError(f"is not an unfinished rendering; move it away ({error})", file=work) from None
    for stale in work.rglob(".*.part"):  # left by a writer that was killed
        stale.unlink(missing_ok=True)
    for key in now:
        if not isinstance(before, dict) or before.get(key) != now[key]:
            stated = before.get(key) if isinstance(before, dict) else before
            raise UserError(
                "is an unfinished rendering with another setting; finish that one or delete it",
                file=work,
                key=key,
                expected=stated,
                got=now[key],
            )


def _take_over(work: Path, folder: Path) -> None:
    """Link the files of a finished rendering into its final folder, or copy them if links are not supported."""
    for source in sorted(work.rglob("*")):
        name = source.relative_to(work)
        if name.parts[0] == PARTS or name.name == PLAN or name.name.startswith("."):
            continue
        if source.is_dir():
            (folder / name).mkdir(parents=True, exist_ok=True)
            continue
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(source, folder / name)
        except OSError:  # a file system without links
            shutil.copyfile(source, folder / name)
