"""Find faults in a dataset: truncated or changed files, and repeated or contradictory records."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.datasets.describe import CAMERA_FILE, RENDER_FILE, STATS, TASKS
from vispeg.datasets.episodes import OWN
from vispeg.datasets.formats.bop import matrix, objects
from vispeg.datasets.formats.read_bop import Bop
from vispeg.datasets.layout import COUNTED, depth_of, is_depth, is_picture, pose_of
from vispeg.datasets.moments import Seen, disagreements
from vispeg.datasets.opening import open_dataset
from vispeg.datasets.parquet import opened, table, values
from vispeg.datasets.read import Dataset
from vispeg.formats.format import enrol
from vispeg.formats.guard import is_file

MOST = 20  # most problems of one kind that are listed
UNIT = 1e-3  # largest difference of a quaternion's length from 1
Watch = Callable[[int], None]


def _example(folder: Path) -> Path:
    from vispeg.datasets.example import write_dataset

    return write_dataset(folder)


@enrol(RENDER_FILE.name, _example)
def check(folder: str | Path, watch: Watch = lambda frames: None) -> list[str]:
    """Return the faults of a dataset, one line each; [] if there are none.

    Args:
        folder: folder of the dataset.
        watch: called with the number of frames just checked.

    Raises:
        UserError: no dataset, or its `meta/info.json` cannot be read.
    """
    data = open_dataset(folder)
    if isinstance(data, Bop):
        return collected(data.check()) + _records(data, watch)
    if faults := collected(_files(data)):  # a changed file is one fault; its content is not examined further
        return faults
    if faults := collected(_meta(data)):
        return faults
    return collected(_numbers(data)) + _records(data, watch)


@enrol(CAMERA_FILE.name, _example)
def _cameras(folder: Path) -> object:
    """Read the file of cameras; enrolled as its reader."""
    return Dataset(folder).cameras


def collected(findings: Iterator[str]) -> list[str]:
    """List findings; a UserError that is raised while they are found becomes the last one."""
    lines = []
    try:
        for finding in findings:
            lines.append(finding)
    except UserError as error:
        lines.append(str(error))
    return lines


def _files(data: Dataset) -> Iterator[str]:
    for name, digest in data.made.get("files", {}).items():
        path = data.folder / name
        if not is_file(path):
            yield f"{path}: is missing, or no file"
            continue
        with path.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != digest:
                yield f"{path}: was cut short or changed since it was written"


def _meta(data: Dataset) -> Iterator[str]:
    """Yield contradictions between the files in `meta/`, and between them and the sizes of the data files."""
    episodes, info = data.episodes, data.info
    if info.get("total_episodes") != len(episodes):
        yield f"meta/info.json: total_episodes is {info.get('total_episodes')}; the episodes have {len(episodes)}"
    earlier: dict[Any, int] = {}
    for i, e in enumerate(episodes):
        key = (e.get(f"{OWN}seed"), e.get(f"{OWN}look"))
        if None not in key and earlier.setdefault(key, i) != i:
            yield f"episode {i}: repeats episode {earlier[key]} (seed {key[0]}, look {key[1]})"
    for i in range(len(episodes) if data.cameras else 0):
        data.drawn_cameras(i)  # raises UserError if they are invalid
    for path in data.data_files:
        if others := set(data.open(path).schema_arrow.names) - set(info["features"]):
            yield f"{path}: {sorted(others)[0]}: is not among the features of meta/info.json"
    rows = sum(data.open(path).metadata.num_rows for path in data.data_files)
    if rows != len(data):
        yield f"{data.folder / 'data'}: {count(rows, 'row')}; expected {len(data)}"
    _ = data.models  # raises UserError if one is invalid
    path = data.folder / TASKS
    tasks = values(COUNTED["task_index"], table(opened(path), path, ["task_index"])["task_index"], path, "task_index")
    total = info.get("total_tasks", len(tasks))
    if total != len(tasks) or sorted(tasks) != list(range(len(tasks))):
        yield f"{path}: task_index is {list(tasks)[:MOST]}; expected 0 to {total} - 1"


def _numbers(data: Dataset) -> Iterator[str]:
    """Yield faults of numeric columns: wrong counters, values that are not finite, and wrong statistics."""
    lengths = [e["length"] for e in data.episodes]
    frame = np.concatenate([np.arange(n) for n in lengths])
    expected = {
        "index": np.arange(len(data)),
        "frame_index": frame,
        "episode_index": np.repeat(np.arange(len(lengths)), lengths),
        "timestamp": frame / float(data.info["fps"]),
    }
    for name, feature in data.info["features"].items():
        if is_picture(feature) or feature["dtype"] == "string":
            continue
        try:
            column = data.numbers(name)
        except UserError as error:
            yield str(error)
            continue
        if len(column) != len(data):
            yield f"{name}: {count(len(column), 'row')}; expected {len(data)}"
            continue
        if name in expected:
            wrong = np.flatnonzero(~(np.abs(column - expected[name]) <= (1e-4 if name == "timestamp" else 0)))
            if len(wrong):
                i = int(wrong[0])
                yield f"frame {i}: {name} is {column[i]}; expected {expected[name][i]:g} ({len(wrong)} such frames)"
        real = column.astype(float).reshape(len(column), -1)
        bad = np.flatnonzero(~np.isfinite(real).all(axis=1))
        if len(bad):
            yield f"frame {bad[0]}: {name} is not finite ({len(bad)} such frames)"
            continue
        if name.startswith("label.") and real.shape[1] == 7:
            off = np.flatnonzero(np.abs(np.linalg.norm(real[:, 3:], axis=1) - 1) > UNIT)
            if len(off):
                yield f"frame {off[0]}: {name} has no unit quaternion ({len(off)} such frames)"
        if name == "task_index" and not (real >= 0).all() & (real < data.info.get("total_tasks", np.inf)).all():
            yield f"{name}: a task that meta/tasks.parquet does not have"
        if name not in COUNTED and name in data.stats:
            yield from _statistics(name, data.stats[name], real)


def _statistics(name: str, stats: Mapping[str, object], real: np.ndarray) -> Iterator[str]:
    """Yield a fault if the stated statistics are not those of the numbers (N, d)."""
    for key, value in (("min", real.min(axis=0)), ("max", real.max(axis=0)), ("mean", real.mean(axis=0))):
        try:
            stated = np.asarray(stats.get(key), dtype=float).reshape(-1)
        except (TypeError, ValueError):
            stated = np.array([])
        if stated.shape != value.shape or not np.allclose(stated, value, rtol=1e-4, atol=1e-6):
            yield f"{STATS}: {key} of {name} is not that of the frames"
            return


def _records(data: Dataset | Bop, watch: Watch) -> list[str]:
    """Return faults of episodes: unreadable pictures, pictures that do not fit their labels, repeated frames."""
    faults: list[str] = []
    digests: dict[bytes, str] = {}
    content = [name for name in data.features if name not in COUNTED]
    repeated = 0
    # a camera that is late or drops frames repeats a picture: where frames consist of pictures only, that is no fault
    pictures_alone = all(is_picture(data.features[name]) for name in content)
    for number, about in enumerate(data.episodes):
        try:
            frames = data.episode(number)
        except UserError as error:
            faults.append(str(error))
            continue
        faults += [f"episode {number}: {fault}" for fault in pictures(data, frames)]
        try:
            faults += [f"episode {number}: {fault}" for fault in disagreements(_seen(data, number, frames))]
        except UserError as error:
            faults.append(str(error))
        last = b""
        for i in range(about["length"]):
            digest = hashlib.blake2b(digest_size=16)
            for name in content:
                value = frames[name][i]
                digest.update(value.encode() if isinstance(value, str) else np.ascontiguousarray(value).tobytes())
            here = f"frame {about['dataset_from_index'] + i}"
            before = digests.setdefault(digest.digest(), here)
            again, last = pictures_alone and digest.digest() == last, digest.digest()
            if before != here and not again:
                repeated += 1
                faults += [f"{here}: repeats {before}"] if repeated <= MOST else []
        watch(about["length"])
    if repeated > MOST:
        faults.append(f"... and {repeated - MOST} more repeated frames")
    return faults


def _seen(data: Dataset | Bop, number: int, frames: Mapping[str, np.ndarray]) -> Iterator[Seen]:
    """Yield the parts with known surface and pose in each camera's pictures of an episode."""
    if isinstance(data, Bop):
        yield from data.seen(number, frames)
        return
    cameras = data.drawn_cameras(number) if data.models else {}
    for name, camera in cameras.items():
        view, depth, labels = f"label.camera.{name}", depth_of(name, frames), frames.get(f"label.parts.{name}")
        for part, site in objects(data).values():
            pose = pose_of(site, name, frames)
            if part not in data.models or not {view, depth, pose} <= set(frames):
                continue
            with np.errstate(all="ignore"):  # invalid poses are reported elsewhere
                views, poses = ([matrix(row) for row in frames[key]] for key in (view, pose))
                at = np.stack([np.linalg.inv(a) @ b for a, b in zip(views, poses, strict=True)])
            mask = labels == 1 + data.parts.index(part) if labels is not None and part in data.parts else None
            yield Seen(camera, part, frames[depth], mask, at, data.models[part])


def pictures(data: Any, frames: dict[str, np.ndarray]) -> Iterator[str]:
    """Yield faults of an episode's depths and part numbers."""
    for name, feature in data.features.items():
        if is_depth(feature) and not (np.isfinite(frames[name]).all() and (frames[name] >= 0).all()):
            yield f"{name} has depths that are negative or not finite"
        parts = len(data.parts)
        if name.startswith("label.parts.") and parts and int(frames[name].max()) > parts:
            yield f"{name} has part {int(frames[name].max())} of {parts}"
