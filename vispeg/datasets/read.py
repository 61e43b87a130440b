"""Reads a dataset with NumPy: frames and episodes as arrays, pictures decoded."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.datasets.codec import decode
from vispeg.datasets.layout import COUNTED, Feature, is_depth, is_image, pixel_shape, pixel_type
from vispeg.datasets.lerobot import CAMERAS, INFO, OWN, RENDER, STATS, VERSION
from vispeg.render.camera import Camera

if TYPE_CHECKING:
    import pyarrow as pa

KEPT = 4  # episodes whose encoded pictures stay in memory


class Dataset:
    """A LeRobotDataset v3.0 folder whose pictures lie in its Parquet files, such as `vispeg render` writes.

    `dataset[i]` is frame i: a mapping from feature names to arrays; `for frame in dataset` walks them all.

    Args:
        folder: of the dataset.
        features: the features that are read; default: all.

    Attributes:
        info: the content of `meta/info.json`.
        features: those that are read.

    Raises:
        UserError: no dataset, an unfinished one, a version or kind that is not read here, an unknown feature.
    """

    def __init__(self, folder: str | Path, features: Iterable[str] | None = None):
        self.folder = Path(folder).expanduser()
        self.info = _info(self.folder)
        known: dict[str, Feature] = self.info["features"]
        for name in features or ():
            if name not in known:
                raise UserError("the dataset has no such feature", file=folder, got=name, choices=known)
        self.features = {k: f for k, f in known.items() if features is None or k in set(features)}
        if video := [k for k, f in self.features.items() if f.get("dtype") == "video"]:
            raise UserError("pictures in video files are not read here", file=folder, key=video[0])
        self._kept: OrderedDict[int, Any] = OrderedDict()
        self._files: OrderedDict[Path, Any] = OrderedDict()

    def __len__(self) -> int:
        return int(self.info["total_frames"])

    def __getitem__(self, index: int) -> dict[str, np.ndarray]:
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        number = bisect_right(self._starts, index) - 1
        return self._frame(self._table(number), index - self._starts[number], f"frame {index}")

    def __iter__(self) -> Iterator[dict[str, np.ndarray]]:
        return (self[i] for i in range(len(self)))

    def episode(self, number: int) -> dict[str, np.ndarray]:
        """All frames of an episode: (T, ...) arrays by feature."""
        if not 0 <= number < len(self.episodes):
            raise IndexError(f"episode {number} of {len(self.episodes)}")
        table = self._table(number)
        rows = [self._frame(table, i, f"episode {number}, frame {i}") for i in range(len(table))]
        return {name: np.stack([row[name] for row in rows]) for name in self.features}

    @cached_property
    def episodes(self) -> list[dict[str, Any]]:
        """What `meta/episodes` says of each episode, without statistics; drawn worlds and the like are decoded."""
        import pyarrow as pa

        tables = [self._open(path).read(columns=None) for path in self._meta_files()]
        whole = pa.concat_tables(tables, promote_options="default")
        whole = whole.select([c for c in whole.column_names if not c.startswith("stats/")])
        rows = sorted(whole.to_pylist(), key=lambda row: row["episode_index"])
        for row in rows:
            for key, value in row.items():
                if key.startswith(OWN) and isinstance(value, str) and value[:1] in "{[":
                    row[key] = json.loads(value)
        return rows

    @cached_property
    def cameras(self) -> dict[str, Camera]:
        """The cameras as their user believes them, by name; none where the dataset does not say."""
        record = self._json(CAMERAS, {"cameras": []})
        return {c["name"]: Camera(**c) for c in record["cameras"]}

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts that label pictures count from 1."""
        return tuple(self._json(CAMERAS, {}).get("parts", ()))

    @cached_property
    def made(self) -> dict[str, Any]:
        """How it was rendered: plan, digests of files, provenance; {} where it was not rendered by this program."""
        return self._json(RENDER, {})

    @cached_property
    def stats(self) -> dict[str, Any]:
        """The content of `meta/stats.json`."""
        return self._json(STATS, {})

    def numbers(self, name: str) -> np.ndarray:
        """A feature of all frames at once, (N, ...); pictures are refused."""
        known: dict[str, Feature] = self.info["features"]
        if name not in known or is_image(known[name]):
            choices = [k for k, f in known.items() if not is_image(f)]
            raise UserError("no such numbers", file=self.folder, got=name, choices=choices)
        files = list(dict.fromkeys(self._data_file(e) for e in self.episodes))
        found = [self._read(lambda f=file: self._open(f).read(columns=[name]), file)[name] for file in files]
        return np.concatenate([_array(known[name], column) for column in found])

    def bytes(self, number: int, name: str) -> list[bytes]:
        """The encoded pictures of an episode."""
        return self._table(number)[name].combine_chunks().field("bytes").to_pylist()

    # Files ----------------------------------------------------------------------------------------------------
    @cached_property
    def _starts(self) -> list[int]:
        return [e["dataset_from_index"] for e in self.episodes]

    @cached_property
    def _groups(self) -> dict[int, int]:
        """The row group of each episode in its file."""
        seen: dict[Path, int] = {}
        out = {}
        for e in self.episodes:
            file = self._data_file(e)
            out[e["episode_index"]] = seen.get(file, 0)
            seen[file] = seen.get(file, 0) + 1
        return out

    def _data_file(self, e: dict[str, Any]) -> Path:
        name = self.info["data_path"].format(chunk_index=e["data/chunk_index"], file_index=e["data/file_index"])
        return self.folder / name

    def _table(self, number: int) -> pa.Table:
        if number in self._kept:
            self._kept.move_to_end(number)
            return self._kept[number]
        import pyarrow.compute as pc

        path, columns = self._data_file(self.episodes[number]), list(self.features)
        file = self._open(path)
        if file.num_row_groups == sum(self._data_file(e) == path for e in self.episodes):
            table = self._read(lambda: file.read_row_group(self._groups[number], columns), path)
        else:  # another writer's groups
            whole = self._read(lambda: file.read([*dict.fromkeys([*columns, "episode_index"])]), path)
            table = whole.filter(pc.equal(whole["episode_index"], number)).select(columns)
        self._kept[number] = table
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return table

    def _frame(self, table: pa.Table, row: int, where: str) -> dict[str, np.ndarray]:
        out = {}
        for name, feature in self.features.items():
            value = table[name][row].as_py()
            if not is_image(feature):
                out[name] = _shaped(feature, value)
                continue
            image = decode(value["bytes"] or b"", f"{where}, {name}")
            if image.shape != pixel_shape(feature) or (is_depth(feature) and image.dtype != pixel_type(feature)):
                expected = f"{pixel_shape(feature)} {pixel_type(feature)}"
                got = f"{image.shape} {image.dtype}"
                raise UserError("a picture of another kind", key=f"{where}, {name}", expected=expected, got=got)
            out[name] = image
        return out

    def _meta_files(self) -> Sequence[Path]:
        files = sorted((self.folder / "meta/episodes").glob("*/*.parquet"))
        if not files:
            raise UserError("has no episodes", file=self.folder / "meta/episodes")
        return files

    def _open(self, path: Path) -> Any:
        import pyarrow as pa
        import pyarrow.parquet as pq

        if path not in self._files:
            try:
                self._files[path] = pq.ParquetFile(path)
            except OSError as error:
                raise UserError(f"cannot be read: {error.strerror or error}", file=path) from None
            except pa.ArrowInvalid:
                raise UserError("is cut short, or no Parquet file", file=path) from None
            while len(self._files) > 32:
                self._files.popitem(last=False)[1].close()
        return self._files[path]

    def _read(self, action: Any, path: Path) -> Any:
        import pyarrow as pa

        try:
            return action()
        except (OSError, pa.ArrowException, KeyError) as error:
            raise UserError(f"cannot be read ({' '.join(str(error).split())[:80]})", file=path) from None

    def _json(self, name: str, otherwise: Any) -> Any:
        path = self.folder / name
        if not path.is_file():
            return otherwise
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise UserError("is no JSON", file=path, got=str(error)) from None


def _info(folder: Path) -> dict[str, Any]:
    path = folder / INFO
    if not path.is_file():
        unfinished = folder.with_name(folder.name + ".unfinished")
        begun = folder.name.endswith(".unfinished") or (unfinished.is_dir() and not folder.exists())
        hint = "its rendering is not finished: repeat the `vispeg render` that began it" if begun else "is no dataset"
        raise UserError(hint, file=folder, expected=f"a folder with {INFO}")
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError("is no JSON", file=path, got=str(error)) from None
    if not isinstance(info, dict) or info.get("codebase_version") != VERSION:
        got = info.get("codebase_version") if isinstance(info, dict) else info
        raise UserError("another version", file=path, key="codebase_version", expected=VERSION, got=got)
    for key in ("features", "total_frames", "fps", "data_path"):
        if key not in info:
            raise UserError("is missing", file=path, key=key)
    if missing := [name for name in COUNTED if name not in info["features"]]:
        raise UserError("is missing", file=path, key=f"features.{missing[0]}")
    return info


def _shaped(feature: Feature, value: Any) -> np.ndarray:
    return np.asarray(value, feature["dtype"]).reshape([] if feature["shape"] == [1] else feature["shape"])


def _array(feature: Feature, column: Any) -> np.ndarray:
    flat = column.combine_chunks()
    if feature["shape"] == [1]:
        return flat.to_numpy(zero_copy_only=False)
    return flat.flatten().to_numpy(zero_copy_only=False).reshape(len(flat), *feature["shape"])
