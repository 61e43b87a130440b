"""Read a dataset in BOP's format (bop.felk.cvut.cz, "BOP data format"), written by this program or another.

Scenes that `dataset_info.json` assigns to one episode are its cameras; without this file, each scene is an episode with
one camera. Masks of visible parts become label pictures, in which objects are numbered from 1.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.datasets.codec import DEPTH_STEP, decode
from vispeg.datasets.describe import BOP_CAMERA, Made, is_integer, is_number
from vispeg.datasets.episodes import Stretch, of_episode
from vispeg.datasets.formats.models import read_ply
from vispeg.datasets.layout import Feature, colour_of, depth, depth_of, is_depth, parts, picture, pixel_shape
from vispeg.datasets.moments import Seen
from vispeg.formats.guard import MB, is_file, read_bytes
from vispeg.formats.json_data import read_json
from vispeg.render.cameras.camera import PINHOLE, Camera

LISTING, TRUTH = "dataset_info.json", "scene_gt.json"
INFO = "models/models_info.json"
ONE_CAMERA = "camera"  # name of the camera where none is stated
MM = 1e-3  # m in a millimetre
KEPT = 4  # number of episodes kept in memory
LARGEST = 256 * MB  # largest file of a picture


class PictureCamera(TypedDict):
    """A picture's entry in scene_camera.json; other keys may be present."""

    cam_K: list[float]
    depth_scale: NotRequired[float]


class ObjectPose(TypedDict):
    """An object's entry in scene_gt.json; other keys may be present."""

    obj_id: int
    cam_R_m2c: list[float]
    cam_t_m2c: list[float]


class Bop:
    """A dataset in BOP's format, read episode by episode, with the attributes of `vispeg.datasets.read.Dataset`.

    Attributes:
        folder: folder of the dataset.
        features: name -> feature of a frame.
        cameras: name -> camera.
        parts: names of the parts, which label pictures number from 1.
        episodes: `length` of each episode, and `dataset_from_index`, the number of its first frame.
        info: `fps`, None as the format does not state it.
        made: how the dataset was rendered: not stated.

    Raises:
        UserError: not such a dataset, or a contradictory one.
    """

    def __init__(self, folder: str | Path):
        self.folder = expanded(folder)
        self._kept: OrderedDict[int, dict[str, np.ndarray]] = OrderedDict()
        self.scenes = sorted(
            path.parent for path in self.folder.glob(f"*/*/{BOP_CAMERA}") if path.parent.name.isdigit()
        )
        if not self.scenes:
            raise UserError("has no scenes", file=self.folder, expected=f"SPLIT/000000/{BOP_CAMERA}")
        listing = read_json(self.folder / LISTING) if is_file(self.folder / LISTING) else {}
        where = _scenes(listing, self.scenes, self.folder / LISTING)
        self.by = {}  # episode and camera -> scene
        for scene, (episode, camera) in zip(self.scenes, where, strict=True):
            if self.by.setdefault((episode, camera), scene) is not scene:
                raise UserError("two scenes of one episode and camera", file=self.folder / LISTING, got=scene.name)
        count = 1 + max(episode for episode, _ in self.by)
        names = list(dict.fromkeys(camera for _, camera in where))
        if len(self.by) != count * len(names):
            raise UserError("an episode lacks a camera's scene", file=self.folder / LISTING, expected=", ".join(names))
        self.objects = _objects(listing, self.folder / LISTING)
        self.parts = tuple(self.objects.values())
        self.cameras = {name: self._camera(name, self.by[0, name]) for name in names}
        self.features: dict[str, Feature] = {}
        for name, camera in self.cameras.items():
            self.features |= {colour_of(name): picture(camera), depth_of(name, ()): depth(camera)}
            self.features |= {f"label.parts.{name}": parts(camera)} if self.objects else {}
        self.episodes: list[Stretch] = []
        first = 0
        for i in range(count):
            lengths = {name: len(self._frames(self.by[i, name])) for name in names}
            if len(set(lengths.values())) > 1:
                raise UserError("an episode's scenes differ in length", file=self.folder, got=lengths)
            self.episodes.append({"length": lengths[names[0]], "dataset_from_index": first})
            first += lengths[names[0]]
        self.info: Mapping[str, Any] = {"fps": None}
        self.made: Made = {}

    def __len__(self) -> int:
        return sum(e["length"] for e in self.episodes)

    def __getitem__(self, index: int) -> dict[str, np.ndarray]:
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        number = bisect_right(self._starts, index) - 1
        frames = self.episode(number)
        return {name: frames[name][index - self._starts[number]] for name in self.features}

    def episode(self, number: int) -> dict[str, np.ndarray]:
        """Return an episode's frames as `read` does; the last KEPT episodes stay in memory."""
        if number not in self._kept:
            with of_episode(number):
                self._kept[number] = self.read(number)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return self._kept[number]

    @cached_property
    def _starts(self) -> list[int]:
        return [e["dataset_from_index"] for e in self.episodes]

    def _frames(self, scene: Path) -> dict[int, PictureCamera]:
        """Return number of a picture -> its entry in scene_camera.json, in order."""
        path = scene / BOP_CAMERA
        record = read_json(path)
        if not isinstance(record, dict) or not record or not all(k.isdigit() and len(k) < 9 for k in record):
            raise UserError("not a mapping of pictures", file=path)
        for key, entry in record.items():
            numbers = entry.get("cam_K") if isinstance(entry, dict) else None
            if not isinstance(numbers, list) or len(numbers) != 9 or not all(map(is_number, numbers)):
                raise UserError("not nine finite numbers", file=path, key=f"{key}.cam_K", got=numbers)
            scale = entry.get("depth_scale", 1.0)
            if not is_number(scale) or not 0 < scale < 1e3:
                raise UserError("not a scale", file=path, key=f"{key}.depth_scale", expected="mm a step", got=scale)
            lens = entry.get("cam_distortion", [*PINHOLE])
            if not isinstance(lens, list) or len(lens) != len(PINHOLE) or not all(map(is_number, lens)):
                message = "not k1, k2, p1, p2, k3"
                raise UserError(
                    message, file=path, key=f"{key}.cam_distortion", expected="five finite numbers", got=lens
                )
        return {int(key): record[key] for key in sorted(record, key=int)}

    def _camera(self, name: str, scene: Path) -> Camera:
        first, entry = next(iter(self._frames(scene).items()))
        path = _picture_of(scene / "rgb", first)
        height, width = decode(read_bytes(path, LARGEST), str(path)).shape[:2]
        K, (k1, k2, p1, p2, k3) = entry["cam_K"], entry.get("cam_distortion", PINHOLE)
        try:
            return Camera(name, width, height, K[0], K[4], K[2], K[5], (k1, k2, p1, p2, k3))
        except UserError as error:
            raise UserError(str(error), file=scene / BOP_CAMERA, key=f"{first}.cam_K") from None

    def read(self, number: int) -> dict[str, np.ndarray]:
        """Read an episode's frames: feature -> (T, ...) array. Raises UserError: damaged files."""
        out: dict[str, np.ndarray] = {}
        for name in self.cameras:
            scene = self.by[number, name]
            frames = self._frames(scene)
            rgb, deep = self.features[colour_of(name)], self.features[depth_of(name, ())]
            out[colour_of(name)] = np.stack([_read(_picture_of(scene / "rgb", i), rgb) for i in frames])
            steps = {i: entry.get("depth_scale", 1.0) * MM for i, entry in frames.items()}
            depths = [_read(_picture_of(scene / "depth", i), deep, steps[i]) for i in frames]
            out[depth_of(name, ())] = np.stack(depths)
            if self.objects:
                out[f"label.parts.{name}"] = np.stack([self._parts(scene, i, name) for i in frames])
        return out

    def seen(self, number: int, frames: Mapping[str, np.ndarray]) -> Iterator[Seen]:
        """Yield the parts with known surface and pose in each camera's pictures of an episode."""
        for name in self.cameras if self.known_models else ():
            scene = self.by[number, name]
            poses = [self._poses(scene).get(str(i), []) for i in self._frames(scene)]
            for place, (i, part) in enumerate(self.objects.items(), 1):
                at = [_pose(entry) for row in poses for entry in row if entry["obj_id"] == i]
                if i in self.known_models and len(at) == len(poses) > 0:  # once in every picture
                    vertices, faces = read_ply(self.folder / f"models/obj_{i:06d}.ply")
                    mask = frames[f"label.parts.{name}"] == place
                    depth, camera = frames[depth_of(name, ())], self._camera(name, scene)
                    yield Seen(camera, part, depth, mask if mask.any() else None, np.stack(at), (MM * vertices, faces))

    def _parts(self, scene: Path, i: int, name: str) -> np.ndarray:
        """Return the label picture (H, W) uint8 of picture i, from the masks of its visible parts; 0 is no part."""
        feature = self.features[f"label.parts.{name}"]
        out, order = np.zeros(feature["shape"], np.uint8), list(self.objects)
        for j, entry in enumerate(self._poses(scene).get(str(i), [])):
            path = scene / "mask_visib" / f"{i:06d}_{j:06d}.png"
            if is_file(path) and entry["obj_id"] in self.objects:
                out[_read(path, feature) > 0] = 1 + order.index(entry["obj_id"])
        return out

    def _poses(self, scene: Path) -> Mapping[str, list[ObjectPose]]:
        """Return number of a picture -> poses of its objects; {} if not stated. Raises UserError: an invalid pose."""
        path = scene / TRUTH
        if not is_file(path):
            return {}
        record = read_json(path)
        right = isinstance(record, dict) and all(isinstance(row, list) for row in record.values())
        for key, row in record.items() if right else ():
            for entry in row:
                if not isinstance(entry, dict) or not is_integer(entry.get("obj_id")):
                    raise UserError("not an object's pose", file=path, key=key, got=entry)
                for field, size in (("cam_R_m2c", 9), ("cam_t_m2c", 3)):
                    numbers = entry.get(field)
                    if not isinstance(numbers, list) or len(numbers) != size or not all(map(is_number, numbers)):
                        raise UserError(f"not {size} finite numbers", file=path, key=f"{key}.{field}", got=numbers)
        if not right:
            raise UserError("not a mapping of pictures to poses", file=path)
        return record

    def check(self) -> Iterator[str]:
        """Yield pictures without poses and poses without rotations. Raises UserError: a model without a mesh file."""
        for scene in self.scenes:
            frames = {str(i) for i in self._frames(scene)}
            poses = self._poses(scene)
            if poses and set(poses) != frames:
                yield f"{scene / TRUTH}: pictures {sorted(set(poses) ^ frames)[:3]} have no pose, or no camera"
            for key, row in poses.items():
                for entry in row:
                    turn = np.reshape(entry["cam_R_m2c"], (3, 3))
                    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or np.linalg.det(turn) < 0:
                        yield f"{scene / TRUTH}: picture {key}: object {entry['obj_id']} has no rotation"
        for i in self.known_models:
            read_ply(self.folder / f"models/obj_{i:06d}.ply")

    @cached_property
    def known_models(self) -> list[int]:
        """Numbers of the objects that `models/models_info.json` describes."""
        path = self.folder / INFO
        if not is_file(path):
            return []
        record = read_json(path)
        if not isinstance(record, dict):
            raise UserError("not a mapping of objects", file=path)
        for key, entry in record.items():
            size = entry.get("diameter") if isinstance(entry, dict) else None
            if not (key.isdigit() and len(key) < 7) or not is_number(size) or size <= 0:
                raise UserError("not a model", file=path, key=f"{key}.diameter", expected="mm, above 0", got=size)
        return [int(key) for key in record]


def _scenes(listing: Any, scenes: list[Path], path: Path) -> list[tuple[int, str]]:
    """Return (episode, camera) of each scene; if not stated, each scene is an episode of one camera."""
    listed = listing.get("scenes") if isinstance(listing, dict) else None
    if listed is None and isinstance(listing, dict):
        return [(i, ONE_CAMERA) for i in range(len(scenes))]
    rows = {}
    entries: list[Any] = listed if isinstance(listed, list) else [None]
    for row in entries:
        right = isinstance(row, dict) and isinstance(row.get("scene"), str) and isinstance(row.get("camera"), str)
        if not right or not is_integer(row.get("episode")) or not 0 <= row["episode"] < 10**6 or not row["camera"]:
            raise UserError("not a list of scenes, episodes and cameras", file=path, key="scenes", got=row)
        rows[row["scene"]] = row["episode"], row["camera"]
    if set(rows) != {scene.name for scene in scenes}:
        raise UserError(
            "other scenes than the folder has", file=path, key="scenes", expected=len(scenes), got=len(rows)
        )
    return [rows[scene.name] for scene in scenes]


def _objects(listing: Any, path: Path) -> dict[int, str]:
    """Return number of an object -> name."""
    objects = listing.get("objects", {}) if isinstance(listing, dict) else None
    if not isinstance(objects, dict) or not all(k.isdigit() and isinstance(o, dict) for k, o in objects.items()):
        raise UserError("not a mapping of objects", file=path, key="objects", got=objects)
    return {int(key): str(entry.get("name", key)) for key, entry in objects.items()}


def _pose(entry: ObjectPose) -> np.ndarray:
    """Return the pose (4, 4) of an object in camera axes, m."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = np.reshape(entry["cam_R_m2c"], (3, 3)), MM * np.asarray(entry["cam_t_m2c"])
    return out


def _picture_of(folder: Path, i: int) -> Path:
    """Return the path of a picture: PNG, JPEG or TIFF, whichever exists."""
    paths = [folder / f"{i:06d}{end}" for end in (".png", ".jpg", ".tif")]
    return next((path for path in paths if is_file(path)), paths[0])


def _read(path: Path, feature: Feature, step: float = DEPTH_STEP) -> np.ndarray:
    """Read a picture file as pixels of a feature; 16-bit depth in steps of `step` m becomes float32 in m.

    Raises:
        UserError: not a picture, or one of another size or type.
    """
    image = decode(read_bytes(path, LARGEST), str(path))
    kind = np.dtype(np.uint16 if is_depth(feature) else np.uint8)
    if image.shape != pixel_shape(feature) or image.dtype != kind:
        expected = f"{pixel_shape(feature)} {kind}"
        raise UserError("a picture of the wrong type", file=path, expected=expected, got=f"{image.shape} {image.dtype}")
    return (image * np.float32(step)).astype(np.float32) if is_depth(feature) else image
