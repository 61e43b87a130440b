"""A calibrated camera, as `frames/cameras.yaml` describes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from vispeg.core.errors import UserError
from vispeg.formats.guard import is_file
from vispeg.formats.typed import typed
from vispeg.formats.yaml_data import read_yaml
from vispeg.recordings.schema import Finite, Positive

Mount = Literal["base", "flange"]
Sensor = Literal["d405", "d435", "structured_light"]  # as in `vispeg.worlds.sensor`, which is in a higher layer
Side = Annotated[int, Field(ge=1, le=8192)]
Row = Annotated[list[Finite], Field(min_length=4, max_length=4)]
DEPTH_UNIT = 1e-3  # m, step of most depth cameras
ROTATION = 1e-3  # tolerance of a rotation's orthonormality: numbers written with four digits pass


@dataclass(frozen=True, eq=False)
class RecordedCamera:
    """A calibrated camera of a recording.

    Attributes:
        name: its name in index.csv.
        width, height: px.
        fx, fy, cx, cy: px; the centre of the top left pixel is (0, 0).
        distortion: (k1, k2, p1, p2, k3) of Brown's model, as OpenCV has it.
        depth_unit: m per step of its 16-bit depth pictures.
        mount: what it is mounted on; None if not stated.
        pose: (4, 4) camera axes (OpenCV: x right, y down, z forward) in the mount's frame, m; None where not stated.
        sensor: kind of depth camera, which selects the noise model of its depth; "" if none applies.
    """

    name: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    depth_unit: float = DEPTH_UNIT
    mount: Mount | None = None
    pose: np.ndarray | None = None
    sensor: Sensor | Literal[""] = ""

    @property
    def K(self) -> np.ndarray:
        """(3, 3) intrinsics, px."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def lens(self) -> dict[str, Any]:
        """Size, intrinsics and distortion, by name."""
        return {key: getattr(self, key) for key in ("width", "height", "fx", "fy", "cx", "cy", "distortion")}


class _Section(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True)

    width: Side
    height: Side
    fx: Positive
    fy: Positive
    cx: Finite
    cy: Finite
    distortion: Annotated[list[Finite], Field(min_length=5, max_length=5)] = [0.0] * 5
    depth_unit_m: Annotated[float, Field(gt=0, le=1.0, allow_inf_nan=False)] = DEPTH_UNIT
    sensor: Sensor | None = None
    base_T_camera: Annotated[list[Row], Field(min_length=4, max_length=4)] | None = None
    flange_T_camera: Annotated[list[Row], Field(min_length=4, max_length=4)] | None = None

    @model_validator(mode="after")
    def _one_pose(self) -> _Section:
        poses = [p for p in (self.base_T_camera, self.flange_T_camera) if p is not None]
        if len(poses) > 1:
            raise ValueError("has both base_T_camera and flange_T_camera")
        for pose in poses:
            matrix = np.array(pose, float)
            axes = matrix[:3, :3]
            is_rotation = np.abs(axes @ axes.T - np.eye(3)).max() < ROTATION and np.linalg.det(axes) > 0
            if not is_rotation or np.abs(matrix[3] - (0, 0, 0, 1)).max() > ROTATION:
                raise ValueError("has a pose that is not a rigid motion (4 x 4, rows of a rotation, then 0 0 0 1)")
        return self


def read_cameras(file: Path) -> tuple[dict[str, RecordedCamera], list[str]]:
    """Read `cameras.yaml`: its cameras by name, and its keys that this version does not know.

    Raises:
        UserError: no such file, or an impossible camera; the error names the key.
    """
    if not is_file(file):
        raise UserError("no such file", file=file, expected="the calibration of the cameras in index.csv")
    data = read_yaml(file)
    if not isinstance(data, Mapping) or not data:
        raise UserError("is not a mapping", file=file, expected="the name of a camera and what is known of it")
    cameras, unknown = {}, []
    for name, entry in data.items():
        section = typed(_Section, entry, file, str(name))
        mount = "base" if section.base_T_camera else "flange" if section.flange_T_camera else None
        pose = section.base_T_camera or section.flange_T_camera
        k1, k2, p1, p2, k3 = section.distortion
        numbers = section.width, section.height, section.fx, section.fy, section.cx, section.cy
        matrix = None if pose is None else np.array(pose, float)
        placed = (k1, k2, p1, p2, k3), section.depth_unit_m, mount, matrix, section.sensor or ""
        cameras[str(name)] = RecordedCamera(str(name), *numbers, *placed)
        unknown += [f"{name}.{key}" for key in section.model_extra or {}]
    return cameras, unknown


def camera_entry(camera: RecordedCamera) -> Mapping[str, object]:
    """Return a camera's entry in `cameras.yaml` as plain values."""
    out: dict[str, object] = {"width": int(camera.width), "height": int(camera.height)}
    out |= {key: float(getattr(camera, key)) for key in ("fx", "fy", "cx", "cy")}
    out |= {"distortion": [float(k) for k in camera.distortion], "depth_unit_m": float(camera.depth_unit)}
    if camera.sensor:
        out["sensor"] = camera.sensor
    if camera.mount is not None and camera.pose is not None:
        out[f"{camera.mount}_T_camera"] = np.asarray(camera.pose, float).tolist()
    return out
