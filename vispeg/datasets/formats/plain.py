"""Read and write datasets as plain files: PNG pictures, a CSV table per episode, and JSON about the whole."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.datasets.codec import encode, to_steps
from vispeg.datasets.describe import check_features, is_integer, is_number
from vispeg.datasets.episodes import KINDS, OWN, Stretch
from vispeg.datasets.formats.stored import Stored, picture
from vispeg.datasets.layout import Feature, entries_of, is_depth, is_picture, short_of
from vispeg.datasets.parquet import checked
from vispeg.datasets.read import Dataset
from vispeg.formats.format import Format
from vispeg.formats.guard import MB, is_file, read_text
from vispeg.formats.json_data import read_json
from vispeg.render.cameras.camera_files import load_cameras, save_cameras

PLAIN = Format(
    "vispeg-folder/1", "a dataset of plain files", needed=("features", "total_frames", "fps"), language="json"
)
WHOLE, CAMERAS = "dataset.json", "cameras.yaml"
README = """One folder per episode: frames.csv (one line per frame; positions in m, velocities in m/s, forces in N,
torques in N m, quaternions w x y z), episode.json (seeds, outcome, drawn parameters), and pictures NAME-FRAME.png.
Depth has 16 bits, 0.1 mm per step, 0 for no reading, and 4 m for what is 4 m away or farther. Pictures of parts hold
the number of the visible part.
cameras.yaml holds the nominal cameras; dataset.json the features, parts and totals.
"""
LONGEST = 100_000  # most frames of an episode
BOOLS = {"True": "1", "False": "0"}
READ_AS = {"string": object, "bool": int}  # other types as themselves, so that no digit of an integer is lost


def write_plain(source: Path, out: Path) -> None:
    """Write the dataset in `source` into `out`."""
    data = Dataset(source)
    for which, about in enumerate(data.episodes):
        folder = out / f"episode-{which:05d}"
        folder.mkdir()
        frames = data.episode(which)
        for name, feature in data.features.items():
            if not is_picture(feature):
                continue
            short = short_of(name)
            for i, image in enumerate(frames[name]):
                pixels = encode(to_steps(image) if is_depth(feature) else image)
                (folder / f"{short}-{i:03d}.png").write_bytes(pixels)
        _table(folder / "frames.csv", data, frames)
        (folder / "episode.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    if data.cameras:
        save_cameras(out / CAMERAS, list(data.cameras.values()))
    record = {
        "format": PLAIN.name,
        "parts": data.parts,
        **{k: v for k, v in data.info.items() if "path" not in k},
        "plan": data.made.get("plan", {}),
    }
    (out / WHOLE).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    (out / "README.txt").write_text(README, encoding="utf-8")


def _table(path: Path, data: Dataset, frames: dict[str, np.ndarray]) -> None:
    columns: dict[str, list[object]] = {}
    for name, feature in data.features.items():
        if is_picture(feature):
            continue
        values = frames[name].reshape(len(frames[name]), -1)
        for j, entry in enumerate(entries_of(feature)):
            columns[f"{name}.{entry}" if entry else name] = values[:, j].tolist()
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


class Plain(Stored):
    """A dataset of plain files, see Stored. Raises UserError: not such a dataset, or a contradictory one."""

    def __init__(self, folder: str | Path):
        super().__init__(folder)
        path = self.folder / WHOLE
        record = PLAIN.read(path)
        check_features(record["features"], path)
        if not is_number(record["fps"]) or record["fps"] <= 0:
            raise UserError("not a rate", file=path, key="fps", expected="frames a second", got=record["fps"])
        parts, plan = record.get("parts", []), record.get("plan", {})
        if not isinstance(parts, list) or not all(isinstance(p, str) for p in parts):
            raise UserError("not a list of names", file=path, key="parts", got=parts)
        if not isinstance(plan, dict):
            raise UserError("not a mapping", file=path, key="plan", got=plan)
        self.features, self.parts, self.info = record["features"], tuple(parts), record
        self.made = {"plan": {key: str(value) for key, value in plan.items()}}
        stored = load_cameras(self.folder / CAMERAS) if is_file(self.folder / CAMERAS) else ()
        self.cameras = {camera.name: camera for camera in stored}
        self.episodes = self._episodes()
        if len(self) != record["total_frames"]:
            what, got = "not the sum of the episodes' lengths", record["total_frames"]
            raise UserError(what, file=path, key="total_frames", expected=len(self), got=got)

    def _episodes(self) -> list[Stretch]:
        out, first = [], 0
        folders = sorted(self.folder.glob("episode-*"))
        if not folders:
            raise UserError("has no episodes", file=self.folder)
        for i, folder in enumerate(folders):
            path = folder / "episode.json"
            about = read_json(path)
            if folder.name != f"episode-{i:05d}" or not isinstance(about, dict):
                raise UserError("is not the next episode", file=folder, expected=f"episode-{i:05d}")
            if not is_integer(about.get("length")) or not 1 <= about["length"] <= LONGEST:
                raise UserError("not a number of frames", file=path, key="length", got=about.get("length"))
            checked([about], {OWN + key: kind for key, kind in KINDS.items()}, path)
            out.append({**about, "dataset_from_index": first})
            first += about["length"]
        return out

    def read(self, number: int) -> dict[str, np.ndarray]:
        """See Stored."""
        folder, length = self.folder / f"episode-{number:05d}", self.episodes[number]["length"]
        columns = _columns(folder / "frames.csv", length)
        out = {}
        for name, feature in self.features.items():
            if is_picture(feature):
                files = [folder / f"{short_of(name)}-{i:03d}.png" for i in range(length)]
                out[name] = np.stack([picture(file, feature) for file in files])
            else:
                out[name] = _values(columns, name, feature, folder / "frames.csv")
        return out


def _columns(path: Path, length: int) -> dict[str, list[str]]:
    """Read the columns of a table, name -> cells. Raises UserError: not CSV, or not `length` complete rows."""
    try:
        heads, *rows = csv.reader(io.StringIO(read_text(path, 256 * MB), newline=""))
    except csv.Error as error:
        raise UserError("is not CSV", file=path, got=str(error)) from None
    if len(rows) != length:
        raise UserError(f"has {len(rows)} rows", file=path, expected=f"{length}, the episode's length")
    for i, row in enumerate(rows, 1):
        if len(row) != len(heads):
            raise UserError(f"row {i} has {len(row)} cells", file=path, expected=f"{len(heads)}, one per column")
    return dict(zip(heads, map(list, zip(*rows, strict=True)), strict=True))


def _values(columns: dict[str, list[str]], name: str, feature: Feature, path: Path) -> np.ndarray:
    """Return a feature's values (T, ...), of its own type; texts are objects."""
    dtype, arrays = feature["dtype"], []
    for entry in entries_of(feature):
        key = f"{name}.{entry}" if entry else name
        if key not in columns:
            raise UserError("a column is missing", file=path, expected=key)
        cells = [BOOLS.get(cell, cell) for cell in columns[key]] if dtype == "bool" else columns[key]
        try:
            arrays.append(np.array(cells, READ_AS.get(dtype, dtype)))
        except (ValueError, OverflowError):
            raise UserError("holds other values", file=path, key=key, expected=f"numbers of type {dtype}") from None
        if dtype != "string" and not np.isfinite(arrays[-1]).all():
            raise UserError("is not finite", file=path, key=key)
    values = np.stack(arrays, axis=-1).reshape(-1, *feature["shape"])
    return values.astype(bool) if dtype == "bool" else values
