"""Place finished shards in a folder in the layout of LeRobotDataset v3.0.

    meta/info.json, stats.json, tasks.parquet, cameras.json, render.json, models/PART.ply
    meta/episodes/chunk-000/file-000.parquet    one per shard: position, statistics and drawn worlds of its episodes
    data/chunk-000/file-000.parquet             one per shard, with one row group per episode

A shard's files depend only on the shard and on the number of episodes before it, so a rendering that was stopped and
continued ends with the same bytes as one that was not.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.files import write_bytes_atomic, write_text_atomic
from vispeg.datasets.describe import CAMERA_FILE, CAMERAS, INFO, RENDER, RENDER_FILE, STATS, TASKS
from vispeg.datasets.episodes import FOLDER, OWN
from vispeg.datasets.formats.models import FOLDER as MODELS
from vispeg.datasets.formats.models import ply
from vispeg.datasets.layout import VERSION, Info, Layout, packing
from vispeg.datasets.shards.plan import Plan
from vispeg.datasets.shards.shard import ABOUT
from vispeg.datasets.stats import Stats, of_numbers, together
from vispeg.render.cameras.camera_files import to_record

CHUNK = 1000  # number of files per folder
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = f"{FOLDER}/chunk-{{chunk_index:03d}}/file-{{file_index:03d}}.parquet"


def path_of(pattern: str, shard: int) -> str:
    """Return the path of a shard's file in its dataset."""
    return pattern.format(chunk_index=shard // CHUNK, file_index=shard % CHUNK)


def place(folder: Path, part: Path, layout: Layout, shard: int, first_episode: int, first_frame: int) -> int:
    """Write a finished shard's two files from its bytes in `part`; return its number of episodes.

    The data file is written last: if it exists, the shard is complete.

    Args:
        folder: folder of the dataset.
        part: a file with the result of `shard_bytes`.
        layout: layout of the dataset.
        shard: number of the shard.
        first_episode, first_frame: numbers of episodes and frames before it.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows, sink = [], pa.BufferOutputStream()
    with pq.ParquetFile(part) as file:
        about = json.loads(file.metadata.metadata[ABOUT])
        arrow_schema = file.schema_arrow.with_metadata({b"huggingface": file.schema_arrow.metadata[b"huggingface"]})
        with pq.ParquetWriter(sink, arrow_schema, **packing(layout.all)) as out:
            for i, record in enumerate(about):
                table = file.read_row_group(i)
                episode = np.full(len(table), first_episode + i)
                index = first_frame + np.arange(len(table))
                for name, values in (("episode_index", episode), ("index", index)):
                    at = table.schema.get_field_index(name)
                    table = table.set_column(at, name, pa.array(values, pa.int64()))
                    record["stats"][name] = of_numbers(values)
                out.write_table(table.cast(arrow_schema))
                rows.append(_row(record, shard, first_episode + i, first_frame))
                first_frame += len(table)
    lines = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist(rows), lines, compression="snappy")
    write_bytes_atomic(folder / path_of(EPISODES, shard), lines.getvalue().to_pybytes(), overwrite=True)
    write_bytes_atomic(folder / path_of(DATA, shard), sink.getvalue().to_pybytes(), overwrite=True)
    return len(rows)


def _row(record: Mapping[str, Any], shard: int, number: int, first_frame: int) -> dict[str, object]:
    """Return a row of `meta/episodes`."""
    chunk, file = divmod(shard, CHUNK)
    row: dict[str, object] = {
        "episode_index": number,
        "tasks": [record["about"]["task"]],
        "length": record["length"],
        "data/chunk_index": chunk,
        "data/file_index": file,
        "dataset_from_index": first_frame,
        "dataset_to_index": first_frame + record["length"],
        "meta/episodes/chunk_index": chunk,
        "meta/episodes/file_index": file,
    }
    for name, values in record["about"].items():
        if name != "task":
            row[OWN + name] = json.dumps(values, sort_keys=True) if isinstance(values, (dict, list)) else values
    for feature, stats in record["stats"].items():
        row |= {f"stats/{feature}/{key}": value for key, value in stats.items()}
    return row


def finish(folder: Path, plan: Plan, layout: Layout, provenance: Mapping[str, Any]) -> None:
    """Write the description in `meta/` after every shard is placed; `info.json` comes last."""
    import pyarrow.parquet as pq

    episodes, stats = 0, {}
    for shard in plan.shards:
        table = pq.read_table(folder / path_of(EPISODES, shard.number))
        episodes += len(table)
        for name in layout.all:
            keys = [k for k in table.column_names if k.rpartition("/")[0] == f"stats/{name}"]
            columns = [table.column(k).to_pylist() for k in keys]
            short = [k.rpartition("/")[2] for k in keys]
            stats.setdefault(name, []).extend(dict(zip(short, v, strict=True)) for v in zip(*columns, strict=True))
    totals: dict[str, Stats] = {name: together(parts) for name, parts in stats.items()}
    cameras = {"format": CAMERA_FILE.name, "cameras": [to_record(c) for c in layout.cameras], "parts": layout.parts}
    _json(folder / STATS, totals)
    _json(folder / CAMERAS, cameras)
    write_bytes_atomic(folder / TASKS, _tasks(layout.task), overwrite=True)
    for name, mesh in layout.models.items():
        write_bytes_atomic(folder / MODELS / f"{name}.ply", ply(mesh), overwrite=True)
    described = _text(info(layout, plan.frames, episodes))
    names = [path_of(p, s.number) for s in plan.shards for p in (DATA, EPISODES)] + [STATS, CAMERAS, TASKS]
    names += [f"{MODELS}/{name}.ply" for name in layout.models]
    files = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in names}
    files[INFO] = hashlib.sha256(described.encode("utf-8")).hexdigest()
    render = {"format": RENDER_FILE.name, "plan": plan.to_json(), "files": files, "provenance": dict(provenance)}
    _json(folder / RENDER, render)
    write_text_atomic(folder / INFO, described, overwrite=True)


def info(layout: Layout, frames: int, episodes: int) -> Info:
    """Return the content of `meta/info.json`."""
    rate = int(layout.fps) if layout.fps == int(layout.fps) else layout.fps
    return {
        "codebase_version": VERSION,
        "robot_type": layout.robot,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA,
        "video_path": None,
        "features": layout.all,
    }


def _tasks(task: str) -> bytes:
    """Return the Parquet table of tasks; its metadata make pandas use the task's text as index, as LeRobot expects."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    def described(name: str, kind: str, numpy: str) -> dict[str, str | None]:
        return {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}

    note = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [described("task_index", "int64", "int64"), described("task", "unicode", "object")],
        "pandas_version": "2.2.0",
    }
    table = pa.table({"task_index": pa.array([0], pa.int64()), "task": pa.array([task])})
    sink = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(note)}), sink)
    return sink.getvalue().to_pybytes()


def _json(path: Path, content: Any) -> None:
    write_text_atomic(path, _text(content), overwrite=True)


def _text(content: Any) -> str:
    return json.dumps(content, indent=2) + "\n"
