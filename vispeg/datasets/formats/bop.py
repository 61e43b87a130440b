"""Write a dataset in BOP's format (bop.felk.cvut.cz, "BOP data format"), which pose estimators read.

A scene is one episode seen by one camera, since a scene's pictures have one size. Objects are the parts with poses,
counted from 1: the held part, whose frame is at its tip, and the fixture, whose frame is the goal's. Units are
millimetres. `cam_K` holds the true intrinsics of a picture, not the nominal ones. BOP has no lens distortion; where a
camera's file states one, its coefficients are added as `cam_distortion`. What the effect `lens_distortion` draws in an
episode bends pictures and masks, and stands in no file of this format.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.datasets.codec import DEPTH_STEP, encode, to_steps
from vispeg.datasets.formats.models import described, ply
from vispeg.datasets.layout import colour_of, depth_of, pose_of
from vispeg.datasets.read import Dataset
from vispeg.render.cameras.camera import Camera, rotation

FIXTURE = "fixture"  # name of the part with the goal, if the dataset's meshes do not show which it is
MM = 1000.0  # mm in a metre
Things = Mapping[int, tuple[str, str]]  # number -> part, name of its pose


def objects(data: Dataset) -> Things:
    """Return object number -> (part, name of its pose), one object for each pose that is labelled.

    A pose that is not named after a part is the goal's. It belongs to the part that has a mesh and no pose of its own.

    Raises:
        UserError: the dataset has no pose.
    """
    poses = [key for key in data.features if key.startswith("label.") and not key.startswith("label.camera.")]
    names = [key.split(".")[1] for key in poses if data.features[key].get("shape") == [7]]
    if not names:
        raise UserError("has no pose of an object, which BOP requires", file=data.folder, key="label.NAME")
    others = [part for part in data.models if part not in names]
    fixture = others[0] if len(others) == 1 else FIXTURE
    things = [(name if name in data.parts else fixture, name) for name in dict.fromkeys(names)]
    return dict(enumerate(things, start=1))


def write_bop(source: Path, out: Path) -> None:
    """Write the dataset in `source` into `out`: `train/SCENE/{rgb,depth,mask_visib}` and the scenes' JSON files."""
    data = Dataset(source)
    things = objects(data)
    poses = [f"label.camera.{name}" for name in data.cameras]
    if missing := [name for name in poses if data.features.get(name, {}).get("shape") != [7]]:
        raise UserError("has no such pose, which BOP requires", file=source, key=missing[0])
    depths = [depth_of(name, data.features) for name in data.cameras]
    if missing := [name for name in depths if name not in data.features]:
        raise UserError("has no such depth, which BOP requires", file=source, key=missing[0])
    if not data.cameras:
        raise UserError("does not describe its cameras", file=source)
    scene = 0
    for number in range(len(data.episodes)):
        frames = data.episode(number)
        drawn = data.drawn_cameras(number)
        for name in data.cameras:
            _scene(out / "train" / f"{scene:06d}", data, things, frames, drawn[name])
            scene += 1
    _models(out, data, things)
    first = next(iter(data.cameras.values()))
    general = {k: getattr(first, k) for k in ("fx", "fy", "cx", "cy", "width", "height")}
    _json(out / "camera.json", general | {"depth_scale": DEPTH_STEP * MM})
    named = {str(i): {"name": part, "frame": name} for i, (part, name) in things.items()}
    scenes = [
        [f"{len(data.cameras) * n + i:06d}", n, c]
        for n in range(len(data.episodes))
        for i, c in enumerate(data.cameras)
    ]
    keys = ("scene", "episode", "camera")
    _json(out / "dataset_info.json", {"objects": named, "scenes": [dict(zip(keys, s, strict=True)) for s in scenes]})


def _models(out: Path, data: Dataset, things: Things) -> None:
    """Write `models/obj_NNNNNN.ply`, in mm, and `models_info.json`; nothing for older datasets without meshes."""
    models = {}
    for number, (part, _) in things.items():
        if part in data.models:
            vertices, faces = data.models[part]
            models[str(number)] = described((MM * vertices, faces))
            (out / "models").mkdir(parents=True, exist_ok=True)
            (out / "models" / f"obj_{number:06d}.ply").write_bytes(ply(data.models[part], MM))
    if models:
        _json(out / "models/models_info.json", models)


def _scene(folder: Path, data: Dataset, things: Things, frames: dict[str, np.ndarray], camera: Camera) -> None:
    """Write a scene: pictures, cameras, poses, and extents of visible parts where they are labelled."""
    cameras, truth, extent = {}, {}, {}
    colour, depth = colour_of(camera.name), depth_of(camera.name, frames)
    for kind in ("rgb", "depth", "mask_visib"):
        (folder / kind).mkdir(parents=True)
    for i in range(len(frames["index"])):
        (folder / "rgb" / f"{i:06d}.png").write_bytes(encode(frames[colour][i]))
        (folder / "depth" / f"{i:06d}.png").write_bytes(encode(to_steps(frames[depth][i])))
        pose = matrix(frames[f"label.camera.{camera.name}"][i])
        view = np.linalg.inv(pose)
        cameras[str(i)] = {
            "cam_K": camera.K.ravel().tolist(),
            "depth_scale": DEPTH_STEP * MM,
            "cam_R_w2c": view[:3, :3].ravel().tolist(),
            "cam_t_w2c": (MM * view[:3, 3]).tolist(),
        } | ({"cam_distortion": list(camera.distortion)} if any(camera.distortion) else {})
        truth[str(i)], extent[str(i)] = [], []
        for j, (number, (part, name)) in enumerate(things.items()):
            at = view @ matrix(frames[pose_of(name, camera.name, frames)][i])
            entry = {"cam_R_m2c": at[:3, :3].ravel().tolist(), "cam_t_m2c": (MM * at[:3, 3]).tolist(), "obj_id": number}
            truth[str(i)].append(entry)
            labels = frames.get(f"label.parts.{camera.name}")
            if labels is not None and part in data.parts:
                mask = labels[i] == 1 + data.parts.index(part)
                (folder / "mask_visib" / f"{i:06d}_{j:06d}.png").write_bytes(encode(255 * mask.astype(np.uint8)))
                extent[str(i)].append({"bbox_visib": box(mask), "px_count_visib": int(mask.sum())})
            else:  # not known, which is not the same as hidden; readers pair the lists of both files
                extent[str(i)].append({})
    _json(folder / "scene_camera.json", cameras)
    _json(folder / "scene_gt.json", truth)
    if any(map(any, extent.values())):
        _json(folder / "scene_gt_info.json", extent)


def box(mask: np.ndarray) -> list[int]:
    """Return the bounding box x, y, width, height of a mask (H, W), px; all -1 if it is empty."""
    if not mask.any():
        return [-1, -1, -1, -1]
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    first, last = (int(columns[0]), int(rows[0])), (int(columns[-1]), int(rows[-1]))
    return [*first, last[0] - first[0] + 1, last[1] - first[1] + 1]


def matrix(pose: np.ndarray) -> np.ndarray:
    """Convert a pose (7,), x y z in m and quaternion w x y z, to a matrix (4, 4)."""
    out = np.eye(4)
    quat = pose[3:].astype(float)
    out[:3, :3], out[:3, 3] = rotation(quat / np.linalg.norm(quat)), pose[:3]
    return out


def _json(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
