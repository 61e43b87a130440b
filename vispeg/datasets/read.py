"""Read a dataset as NumPy arrays: frames and episodes, with decoded pictures."""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.datasets.codec import decode
from vispeg.datasets.describe import (
    BEFORE,
    INFO,
    PLACES,
    Made,
    cameras_of,
    is_integer,
    read_cameras,
    read_info,
    read_made,
    read_stats,
)
from vispeg.datasets.episodes import FOLDER, OWN, EpisodeRow, of_episode, read_episodes, read_episodes_before
from vispeg.datasets.formats.models import Mesh, read_models
from vispeg.datasets.layout import VERSION, is_image, is_picture, pixel_shape, pixel_type
from vispeg.datasets.parquet import opened, table, values
from vispeg.recordings.importers.lerobot_video import decoded, where
from vispeg.render.cameras.camera import Camera

KEPT = 4  # number of episodes kept in memory, with encoded pictures
OPEN = 32  # most files kept open
SUCCESS, REACHED = f"{OWN}success", "next.success"  # this program's flag of an episode, LeRobot's flag of a step
CHUNK = 1000  # default number of episodes in a folder of version 2


class Dataset:
    """A LeRobotDataset v3.0 with its pictures in Parquet files, such as `vispeg render` writes.

    `dataset[i]` is frame i, a mapping from feature names to arrays; `for frame in dataset` iterates over all frames.
    Files are read when they are needed, and raise UserError then if they are damaged.

    Args:
        folder: folder of the dataset.
        features: names of the features to read; default: all.
        theirs: also read what only LeRobot writes: version 2, and pictures in videos. Of these only whole episodes can
            be read.

    Attributes:
        info: content of `meta/info.json`.
        features: name -> feature, of those that are read.

    Raises:
        UserError: no dataset, an unfinished one, an unsupported version or type, or an unknown feature.
    """

    def __init__(self, folder: str | Path, features: Iterable[str] | None = None, theirs: bool = False):
        self.folder = expanded(folder)
        self.info = read_info(self.folder, (VERSION, *BEFORE) if theirs else (VERSION,))
        available = self.info["features"]
        for name in features or ():
            if name not in available:
                raise UserError("the dataset has no such feature", file=folder, got=name, choices=available)
        self.features = {k: f for k, f in available.items() if features is None or k in set(features)}
        self._videos = [k for k, f in self.features.items() if f["dtype"] == "video"]
        if self._videos and not theirs:
            raise UserError("pictures in video files are not supported", file=folder, key=self._videos[0])
        self._kept: OrderedDict[int, Any] = OrderedDict()
        self._files: OrderedDict[Path, Any] = OrderedDict()

    def __len__(self) -> int:
        return int(self.info["total_frames"])

    def __getitem__(self, index: int) -> dict[str, np.ndarray]:
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        number = bisect_right(self._starts, index) - 1
        row = index - self._starts[number]
        return {name: self._value(number, name, row, f"frame {index}") for name in self.features}

    def __iter__(self) -> Iterator[dict[str, np.ndarray]]:
        return (self[i] for i in range(len(self)))

    def episode(self, number: int) -> dict[str, np.ndarray]:
        """Read all frames of an episode: feature -> (T, ...) array."""
        if not 0 <= number < len(self.episodes):
            raise IndexError(f"episode {number} of {len(self.episodes)}")
        columns = {**self._columns(number), **{name: self._video(number, name) for name in self._videos}}
        out = {name: columns[name] for name in self.features}
        for name in [name for name, feature in self.features.items() if is_image(feature)]:
            rows = range(len(columns[name]))
            out[name] = np.stack([self._value(number, name, i, f"episode {number}, frame {i}") for i in rows])
        return out

    @cached_property
    def episodes(self) -> list[EpisodeRow]:
        """One mapping per episode from `meta/episodes`, without statistics; JSON values are decoded."""
        if self._before:
            return read_episodes_before(self.folder, len(self), self._chunk)
        return read_episodes(self.folder, len(self))

    @property
    def cameras(self) -> dict[str, Camera]:
        """The nominal cameras by name; empty if the dataset does not state them."""
        return self._cameras[0]

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts, which label pictures number from 1."""
        return self._cameras[1]

    @cached_property
    def _cameras(self) -> tuple[dict[str, Camera], tuple[str, ...]]:
        return read_cameras(self.folder, self.info["features"])

    def drawn_cameras(self, number: int) -> dict[str, Camera]:
        """Return the cameras as drawn for an episode, by name; the nominal ones if the episode does not state them."""
        records = self.episodes[number].get(f"{OWN}cameras")
        if records is None:
            return self.cameras
        place = f"episode {number}, {OWN}cameras"
        return self.cameras | cameras_of(records, self.info["features"], self.folder / FOLDER, place)

    @cached_property
    def made(self) -> Made:
        """How it was rendered: plan, digests of files, provenance; {} if this program did not render it."""
        return read_made(self.folder)

    @cached_property
    def models(self) -> dict[str, Mesh]:
        """Meshes of the parts with labelled poses by name, m, in the frames of the labels; empty if there are none."""
        return read_models(self.folder)

    @cached_property
    def stats(self) -> Mapping[str, Mapping[str, object]]:
        """Content of `meta/stats.json`."""
        return read_stats(self.folder)

    @property
    def successes(self) -> list[bool] | None:
        """Return whether each episode succeeded, from `meta/episodes` or `next.success`; None without either."""
        if all(SUCCESS in row for row in self.episodes):
            return [bool(row.get(SUCCESS)) for row in self.episodes]
        if REACHED not in self.info["features"]:
            return None
        reached = self.numbers(REACHED)
        return [bool(reached[e["dataset_from_index"] : e["dataset_to_index"]].any()) for e in self.episodes]

    def numbers(self, name: str) -> np.ndarray:
        """Read a feature of all frames, (N, ...). Raises UserError: no such feature, or pictures."""
        available = self.info["features"]
        if name not in available or is_picture(available[name]):
            choices = [k for k, f in available.items() if not is_picture(f)]
            raise UserError("no such numbers", file=self.folder, got=name, choices=choices)
        arrays = [values(available[name], table(self.open(p), p, [name])[name], p, name) for p in self.data_files]
        return np.concatenate(arrays)

    def bytes(self, number: int, name: str) -> list[bytes]:
        """Return a feature's encoded pictures of an episode."""
        return self._columns(number)[name]

    # Files ----------------------------------------------------------------------------------------------------
    @cached_property
    def data_files(self) -> list[Path]:
        """The data files of the episodes, in order."""
        return list(dict.fromkeys(self._data_file(e) for e in self.episodes))

    def open(self, path: Path) -> Any:
        """Open a file of the dataset as `pyarrow.parquet.ParquetFile`; at most OPEN files stay open."""
        if path not in self._files:
            self._files[path] = opened(path)
            while len(self._files) > OPEN:
                self._files.popitem(last=False)[1].close()
        return self._files[path]

    @cached_property
    def _starts(self) -> list[int]:
        return [e["dataset_from_index"] for e in self.episodes]

    @cached_property
    def _groups(self) -> tuple[dict[int, int], dict[Path, list[int]]]:
        """Each episode's position among those in its file, and the lengths of each file's episodes, in order."""
        lengths: dict[Path, list[int]] = defaultdict(list)
        out = {}
        for e in self.episodes:
            file = lengths[self._data_file(e)]
            out[e["episode_index"]] = len(file)
            file.append(e["length"])
        return out, lengths

    @property
    def _chunk(self) -> int:
        """Number of episodes in a folder."""
        size = self.info.get("chunks_size", CHUNK)
        if not is_integer(size) or size < 1:
            raise UserError("not a count", file=self.folder / INFO, key="chunks_size", got=size)
        return size

    @property
    def _before(self) -> bool:
        """Whether the dataset has an older version of the format."""
        return self.info["codebase_version"] in BEFORE

    def _data_file(self, e: EpisodeRow) -> Path:
        names = BEFORE.get(self.info["codebase_version"], PLACES)
        places = dict(zip(names, (e["data/chunk_index"], e["data/file_index"]), strict=True))
        return self.folder / self.info["data_path"].format(**places)

    def _video(self, number: int, name: str) -> np.ndarray:
        """Read an episode's pictures from its video, (T, H, W, 3) uint8."""
        times = np.arange(self.episodes[number]["length"]) / self.info["fps"]
        with of_episode(number):
            file, start = where(self.folder, str(self.info.get("video_path") or ""), name, number, self._chunk)
            frames = [image for _, image in decoded(file, times, start)]
            if len(frames) != len(times):
                expected, got = count(len(times), "frame"), count(len(frames), "frame")
                raise UserError("does not show all of it", file=file, expected=expected, got=got)
        return np.stack(frames)

    def _columns(self, number: int) -> Mapping[str, Any]:
        """Return an episode's features, arrays or encoded pictures; those of the last KEPT episodes stay in memory."""
        if number not in self._kept:
            with of_episode(number):
                self._kept[number] = self._read(number)
        self._kept.move_to_end(number)
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return self._kept[number]

    def _read(self, number: int) -> dict[str, Any]:
        """Read an episode's features from its file."""
        import pyarrow as pa
        import pyarrow.compute as pc

        path = self._data_file(self.episodes[number])
        columns = [name for name in self.features if name not in self._videos]
        file, (groups, lengths) = self.open(path), self._groups
        if [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)] == lengths[path]:
            rows = table(file, path, columns, groups[number])
        else:  # another program's file, whose row groups are not episodes
            full_table = table(file, path, [*dict.fromkeys([*columns, "episode_index"])])
            episode = full_table["episode_index"]
            if not pa.types.is_integer(episode.type):
                got = str(episode.type)
                raise UserError("has the wrong type", file=path, key="episode_index", expected="integers", got=got)
            rows = full_table.filter(pc.equal(episode, number)).select(columns)
        length = self.episodes[number]["length"]
        if len(rows) != length:
            raise UserError(f"has {count(len(rows), 'frame')} of it", file=path, expected=length)
        return {name: values(self.features[name], rows[name], path, name) for name in columns}

    def _value(self, number: int, name: str, row: int, place: str) -> np.ndarray:
        """Return a feature's value in a row of an episode; pictures are decoded. An error names `place`."""
        feature, value = self.features[name], self._columns(number)[name][row]
        if not is_image(feature):
            return np.array(value)
        image, shape = decode(value, f"{place}, {name}"), pixel_shape(feature)
        if image.shape != shape or image.dtype != pixel_type(feature):
            expected, got = f"{shape} {pixel_type(feature)}", f"{image.shape} {image.dtype}"
            raise UserError("a picture of the wrong type", key=f"{place}, {name}", expected=expected, got=got)
        return image
