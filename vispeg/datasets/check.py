"""Finds what is wrong with a dataset: files that are cut short or changed, records that repeat or contradict."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.datasets.layout import COUNTED, is_depth, is_image
from vispeg.datasets.lerobot import OWN
from vispeg.datasets.read import Dataset

MOST = 20  # problems of one kind that are told


def check(folder: str | Path, watch: Callable[[int], None] = lambda frames: None) -> list[str]:
    """What is wrong with a dataset, a line each; [] if nothing is.

    Args:
        folder: of the dataset.
        watch: told frames as they have been looked at.

    Raises:
        UserError: no dataset at all, or one whose description cannot be read.
    """
    data = Dataset(folder)
    found = [*_files(data)]
    if found:  # what lies in a broken file would only be told a second time
        return found
    try:
        found += _ranges(data)
    except UserError as error:
        return [*found, str(error)]
    if found:
        return found
    found += _numbers(data)
    found += _records(data, watch)
    return found


def _files(data: Dataset) -> Iterator[str]:
    for name, digest in data.made.get("files", {}).items():
        path = data.folder / name
        if not path.is_file():
            yield f"{path}: is missing"
        elif hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            yield f"{path}: was cut short or changed since it was written"
    if not data.made:
        for path in sorted(data.folder.glob("data/*/*.parquet")):
            try:
                data._open(path)
            except UserError as error:
                yield str(error)


def _ranges(data: Dataset) -> Iterator[str]:
    """Episodes follow one another without a gap, and the totals are theirs."""
    at = 0
    for i, e in enumerate(data.episodes):
        if e["episode_index"] != i:
            yield f"meta/episodes: line {i} is of episode {e['episode_index']}"
            return
        lies = e["dataset_from_index"], e["dataset_to_index"]
        if lies != (at, at + e["length"]):
            yield f"episode {i}: lies at {lies[0]} to {lies[1]}; expected {at} to {at + e['length']}"
            return
        at += e["length"]
    for key, total in (("total_frames", at), ("total_episodes", len(data.episodes))):
        if data.info.get(key) != total:
            yield f"meta/info.json: {key} is {data.info.get(key)}; the episodes have {total}"
    seen: dict[Any, int] = {}
    for i, e in enumerate(data.episodes):
        key = (e.get(f"{OWN}seed"), e.get(f"{OWN}look"))
        if None not in key and seen.setdefault(key, i) != i:
            yield f"episode {i}: repeats episode {seen[key]} (seed {key[0]}, look {key[1]})"


def _numbers(data: Dataset) -> Iterator[str]:
    """Counted columns count, numbers are finite, statistics are those of the numbers."""
    lengths = [e["length"] for e in data.episodes]
    frame = np.concatenate([np.arange(n) for n in lengths])
    expected = {
        "index": np.arange(len(data)),
        "frame_index": frame,
        "episode_index": np.repeat(np.arange(len(lengths)), lengths),
        "timestamp": frame / float(data.info["fps"]),
    }
    for name, feature in data.info["features"].items():
        if is_image(feature) or feature["dtype"] == "string":
            continue
        try:
            values = data.numbers(name)
        except UserError as error:
            yield str(error)
            continue
        if len(values) != len(data):
            yield f"{name}: {len(values)} rows; expected {len(data)}"
            continue
        if name in expected:
            wrong = np.flatnonzero(np.abs(values - expected[name]) > (1e-4 if name == "timestamp" else 0))
            if len(wrong):
                i = int(wrong[0])
                yield f"frame {i}: {name} is {values[i]}; expected {expected[name][i]:g} ({len(wrong)} such frames)"
        bad = np.flatnonzero(~np.isfinite(values.astype(float)).reshape(len(values), -1).all(axis=1))
        if len(bad):
            yield f"frame {bad[0]}: {name} is not finite ({len(bad)} such frames)"
        elif name not in COUNTED and (stats := data.stats.get(name)):
            real = values.astype(float).reshape(len(values), -1)
            for key, value in (("min", real.min(axis=0)), ("max", real.max(axis=0)), ("mean", real.mean(axis=0))):
                if not np.allclose(stats[key], value, rtol=1e-4, atol=1e-6):
                    yield f"meta/stats.json: {key} of {name} is not that of the frames"
                    break


def _records(data: Dataset, watch: Callable[[int], None]) -> list[str]:
    """Pictures are what they should be, and no frame is there twice."""
    found: list[str] = []
    seen: dict[bytes, str] = {}
    content = [name for name in data.features if name not in COUNTED]
    repeated = 0
    for number, about in enumerate(data.episodes):
        try:
            frames = data.episode(number)
        except UserError as error:
            found.append(f"episode {number}: {error}")
            continue
        if len(frames["index"]) != about["length"]:
            found.append(f"episode {number}: {len(frames['index'])} frames; expected {about['length']}")
        for name, feature in data.features.items():
            depth = frames[name] if is_depth(feature) else None
            if depth is not None and not (np.isfinite(depth).all() and (depth >= 0).all()):
                found.append(f"episode {number}: {name} has depths that are negative or not finite")
            parts = len(data.parts)
            if name.startswith("label.parts.") and parts and int(frames[name].max()) > parts:
                found.append(f"episode {number}: {name} has part {int(frames[name].max())} of {parts}")
        for i in range(len(frames["index"])):
            digest = hashlib.blake2b(digest_size=16)
            for name in content:
                digest.update(np.ascontiguousarray(frames[name][i]).tobytes())
            here = f"frame {about['dataset_from_index'] + i}"
            before = seen.setdefault(digest.digest(), here)
            if before != here:
                repeated += 1
                found += [f"{here}: repeats {before}"] if repeated <= MOST else []
        watch(len(frames["index"]))
    if repeated > MOST:
        found.append(f"... and {repeated - MOST} more repeated frames")
    return found
