"""Writes a dataset as files that a person can open: PNG pictures, a CSV table an episode, JSON about the whole."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from vispeg.datasets.codec import encode, to_steps
from vispeg.datasets.layout import entries_of, is_depth, is_picture, short_of
from vispeg.datasets.read import Dataset
from vispeg.formats.format import Format
from vispeg.render.cameras.camera_files import save_cameras

PLAIN = Format(
    "vispeg-folder/1", "a dataset of plain files", needed=("features", "total_frames", "fps"), language="json"
)
WHOLE, CAMERAS = "dataset.json", "cameras.yaml"
README = """One folder an episode: frames.csv (a line a frame; positions in m, velocities in m/s, forces in N, torques
in N m, quaternions w x y z), episode.json (seeds, what came of it, drawn parameters), and pictures NAME-FRAME.png.
Depth is 16 bit, 0.1 mm a step, 0 where there is no reading. Pictures of parts hold the part's number.
cameras.yaml holds the cameras as their user believes them; dataset.json the features, parts and totals.
"""


def write_plain(source: Path, out: Path) -> None:
    """Write the dataset in `source` into `out`."""
    data = Dataset(source)
    for number, about in enumerate(data.episodes):
        folder = out / f"episode-{number:05d}"
        folder.mkdir()
        frames = data.episode(number)
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
