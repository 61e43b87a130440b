"""The page of a dataset: contact sheet, pictures and labels of each camera, drawn parameters, contrast guard."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.datasets.codec import encode
from vispeg.datasets.episodes import OWN
from vispeg.datasets.formats.read_bop import Bop
from vispeg.datasets.layout import depth_of
from vispeg.datasets.opening import open_dataset
from vispeg.datasets.read import Dataset
from vispeg.render.contrast import TRIES
from vispeg.report.dataset.drawn import drawn, histogram
from vispeg.report.dataset.pictures import chosen, depth_range, embedded, part_picture, sheet, views
from vispeg.report.page import Section, page
from vispeg.report.record import still

PAGE, SHEET = "index.html", "contact-sheet.png"
SAMPLED = 60  # number of frames from which figures on pictures are taken
DIGESTS = ("world_hash", "images")  # settings of a plan that say nothing to a reader
LARGE = 192  # px, height of a camera's picture


def write(dataset: str | Path, out: str | Path, tiles: int = 36, *, overwrite: bool = False) -> Path:
    """Write OUT/contact-sheet.png and OUT/index.html; return the page's path.

    Args:
        dataset: folder of the dataset.
        out: folder of the page.
        tiles: number of frames on the contact sheet.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: `tiles` below 1, a dataset that cannot be read or has no cameras, or `out` cannot be written.
    """
    if tiles < 1:
        raise UserError("must be at least 1", key="tiles", got=tiles)
    data = open_dataset(dataset)
    if not data.cameras:
        raise UserError("does not describe its cameras, so there is nothing to show", file=dataset)
    with new_folder(out, overwrite=overwrite, holds="page", inputs=(dataset,)) as folder:
        drawn_sheet = np.ascontiguousarray(sheet(data, tiles))
        (folder / SHEET).write_bytes(encode(drawn_sheet))
        (folder / PAGE).write_text(render(data, drawn_sheet), encoding="utf-8")
    return Path(out) / PAGE


def render(data: Dataset | Bop, contact_sheet: np.ndarray) -> str:
    """Return the page as HTML, with the contact sheet (H, W, 3) uint8 in it."""
    worlds = [e.get(f"{OWN}world") or {} for e in data.episodes]
    labels = any(k.startswith("label.parts.") for k in data.features)
    sections = [
        Section("headline", "", "dataset/headline", headline(data)),
        Section("sheet", "Contact sheet", "dataset/sheet", {"sheet": still(contact_sheet), "labels": labels}),
        Section("cameras", "Cameras", "dataset/cameras", cameras(data)),
    ]
    if any(f"{OWN}redraws" in e for e in data.episodes):
        sections.append(Section("guard", "Contrast guard", "dataset/guard", guard(data)))
    if any(worlds):
        sections.append(Section("drawn", "Drawn parameters", "dataset/drawn", drawn(worlds)))
    return page(f"dataset {data.folder.name}", "dataset", sections)


def headline(data: Dataset | Bop) -> Mapping[str, object]:
    """Return totals of the dataset, and how its complete episodes ended."""
    plan = data.made.get("plan", {})
    lengths = [e["length"] for e in data.episodes]
    complete = [e for e in data.episodes if not e.get(f"{OWN}cut") and not e.get(f"{OWN}look")]
    ends = Counter(e.get(f"{OWN}category") for e in complete)
    return {
        "name": data.folder.name,
        "frames": len(data),
        "episodes": len(lengths),
        "lengths": " to ".join(dict.fromkeys((str(min(lengths)), str(max(lengths))))),
        "megabytes": f"{sum(f.stat().st_size for f in data.folder.rglob('*') if f.is_file()) / 1e6:.1f}",
        "ends": [(k, n) for k, n in ends.most_common() if k],
        "plan": {k: ", ".join(map(str, v)) if isinstance(v, list) else v for k, v in plan.items() if k not in DIGESTS},
        "hash": plan.get("world_hash", ""),
        "fps": data.info["fps"],
    }


def cameras(data: Dataset | Bop) -> Mapping[str, object]:
    """Return for each camera a large picture, its intrinsics, and the share of missing depth."""
    frames = [data[i] for i in chosen(data, SAMPLED)]
    limits = depth_range(data, frames)
    out = []
    for name, camera in data.cameras.items():
        pictures = views(data, frames[len(frames) // 2], name, limits.get(name), LARGE)
        shown = ("colour", *(("depth",) if name in limits else ()), "parts")
        out.append(
            {
                "camera": camera,
                "on": "" if isinstance(data, Bop) else camera.parent,  # BOP states a camera's place, not what holds it
                "views": [(what, embedded(picture)) for what, picture in zip(shown, pictures, strict=False)],
                "focal": f"{camera.fx:.1f}, {camera.fy:.1f}",
                "depth": _depth(np.stack([f[depth_of(name, f)] for f in frames]), *limits[name])
                if name in limits
                else None,
            }
        )
    key = [(part, "rgb({},{},{})".format(*part_picture(np.array([i]))[0])) for i, part in enumerate(data.parts, 1)]
    all_frames = len(frames) == len(data)
    counted = (
        "of all frames" if all_frames else f"of {count(len(frames), 'frame')} looked at, spread over all {len(data)}"
    )
    return {"cameras": out, "parts": key, "counted": counted}


def _depth(depths: np.ndarray, low: float, high: float) -> Mapping[str, str]:
    """Return figures on a camera's depths (T, H, W), m, which pictures show from `low` to `high`."""
    missing, read = (depths == 0).mean(axis=(1, 2)), depths[depths > 0]
    return {
        "low": f"{low:.3f}",
        "high": f"{high:.3f}",
        "missing": f"{100 * np.median(missing):.1f}",
        "most": f"{100 * missing.max():.1f}",
        "bars": histogram(read[read < 2 * high].tolist(), 48) if len(read) else "",
        "near": f"{read.min():.3f}" if len(read) else "",
        "far": f"{min(depths.max(), 2 * high):.3f}",
    }


def guard(data: Dataset | Bop) -> Mapping[str, object]:
    """Return figures on how often an episode's look was drawn again because its contrast was too low."""
    redraws = np.array([e.get(f"{OWN}redraws") or 0 for e in data.episodes])
    exhausted = sum(bool(e.get(f"{OWN}redraws_exhausted")) for e in data.episodes)
    counts = Counter(redraws.tolist())
    tall = max(counts.values())
    bars = [(n, counts.get(n, 0), round(100 * counts.get(n, 0) / tall)) for n in range(int(redraws.max()) + 1)]
    return {
        "looks": len(redraws),
        "again": int((redraws > 0).sum()),
        "refused": int(redraws.sum()),
        "most": int(redraws.max()),
        "exhausted": exhausted,
        "tries": TRIES,
        "bars": bars,
    }
