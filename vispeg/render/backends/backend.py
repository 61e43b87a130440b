"""The renderer, common to all backends: it takes cameras and returns colour, depth and labels."""

from __future__ import annotations

import copy
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.render.backends.picture import Backend, Picture
from vispeg.render.backends.pristine import Pristine
from vispeg.render.backends.warp import Warp
from vispeg.render.cameras import model_camera
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.view import View, parent_of, velocity_of, view_of
from vispeg.render.labels import Parts, normals_of, part_table, poses
from vispeg.robots.scene import POSED, Scene

BACKENDS = ("auto", "classic", "raycast", "filament")
BackendName = Literal["auto", "classic", "raycast", "filament"]


def jobs_a_process(backend: str) -> int | None:
    """Return the number of jobs after which a process with this backend should be replaced; None for no limit.

    Filament on software Vulkan leaks memory until the process ends (docs/cameras.md).
    """
    return 1 if backend == "filament" else None


@dataclass(frozen=True, eq=False)
class Shot:
    """The images and labels of one camera at one moment. Labels are None unless the renderer was asked for them.

    Attributes:
        rgb: (H, W, 3) uint8, sRGB.
        depth: (H, W) float32, distance along the optical axis, m, 0 for no hit.
        pose: (4, 4) transform from camera axes to the base frame, m.
        velocity: (6,) of the camera in its own axes, m/s and rad/s.
        segmentation: (H, W) int32, 1 + index of the part in `parts`, 0 for none; or None.
        normal_of: function that computes `normals` on demand, as they cost as much as an image; or None.
        poses: by name, (4, 4) poses of bodies and sites of the cell in camera axes, m (see `labels.poses`); or None.
        bodies: (H, W) int32, id of the body seen, 0 (the world) where there is none; or None.
        twists: (nbody, 6) as `velocity`, relative to each body; or None.
    """

    rgb: np.ndarray
    depth: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray
    segmentation: np.ndarray | None = None
    normal_of: Callable[[], np.ndarray] | None = None
    poses: Mapping[str, np.ndarray] | None = None
    bodies: np.ndarray | None = None
    twists: np.ndarray | None = None

    @cached_property
    def normals(self) -> np.ndarray | None:
        """(H, W, 3) float32 surface normals in camera axes, 0 where there is none; None without labels."""
        return None if self.normal_of is None else self.normal_of()


class Renderer:
    """Render the images of cameras in a model. The pixels of colour and depth correspond exactly.

    The renderer's own copy, `renderer.model`, may be edited (colours, lights, textures); call `refresh` after editing
    textures.

    Args:
        model: a Scene, or a compiled model, which is copied. In a Scene's model each camera gets a row of the `cam_*`
            fields, which camera effects need.
        cameras: the cameras to render; `place` changes them.
        backend: `classic` (OpenGL), `raycast` (no graphics driver, no shadows), `filament` (Vulkan, physically
            based) or `auto`: classic if it works here, else ray casting with a warning.
        labels: whether shots carry segmentation, normals and poses.
        shadows: whether lights with `light_castshadow` cast shadows, at extra cost.
        parts: geom names of each part in the segmentation; default: the Scene's parts, else every geom.
        moving: whether shots carry `bodies` and `twists`, at the cost of the segmentation.

    Attributes:
        model, data: the renderer's own model and state; `render` changes `data`.
        nominal: the cameras as placed, which a user takes for the true ones.
        cameras: the cameras that are rendered; a look may have moved them.
        pristine: the model's visual fields as they were at the start.

    Raises:
        UserError: the backend does not work here, a camera has no parent in the model, two cameras share a name, or
            `parts` names unknown geoms.
    """

    def __init__(
        self,
        model: mujoco.MjModel | Any,
        cameras: Sequence[Camera] = (),
        backend: BackendName = "auto",
        *,
        labels: bool = False,
        shadows: bool = False,
        parts: Parts | None = None,
        moving: bool = False,
    ):
        if backend not in BACKENDS:
            raise UserError("unknown renderer", key="backend", got=backend, choices=BACKENDS)
        if isinstance(model, mujoco.MjModel):
            self.model = copy.copy(model)
        else:
            spec, parts = model.spec(), model.parts if parts is None else parts
            model_camera.add(spec, tuple(cameras))
            self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.pristine = Pristine(self.model)
        self.labels, self.shadows, self.moving = labels, shadows, moving
        self._posed = model.posed if isinstance(model, Scene) else POSED  # the standard cell's names
        self._table = part_table(self.model, parts)
        self._uploaded = self.model.tex_data.copy()
        self._backend: Backend | None = None
        self._wanted: BackendName = backend
        self._size = (0, 0)
        self._warps: dict[Camera, Warp] = {}
        self.place(cameras)

    @property
    def backend(self) -> str:
        """Name of the backend in use; of the one asked for once the renderer is closed."""
        return self._backend.name if self._backend else self._wanted

    def place(self, cameras: Sequence[Camera]) -> None:
        """Render these cameras from now on. This is cheap unless an image is larger than any before."""
        self.aim(cameras)
        self.nominal = self.cameras

    def aim(self, cameras: Sequence[Camera]) -> None:
        """Render these cameras from now on but keep `nominal`, as when a look moves the placed cameras.

        Raises:
            UserError: two cameras share a name, or a camera has no parent in the model.
        """
        names = [camera.name for camera in cameras]
        if len(set(names)) < len(names):
            raise UserError("two cameras of one name", key="cameras", got=names)
        parents = [parent_of(self.model, camera.parent) for camera in cameras]
        warps = {c: self._warps.get(c) or Warp(c) for c in cameras if any(c.distortion)}
        self.cameras, self._parents, self._warps = tuple(cameras), parents, warps
        drawn = [self._pinhole(camera) for camera in cameras]
        width = max((camera.width for camera in drawn), default=1)
        height = max((camera.height for camera in drawn), default=1)
        if width > self._size[0] or height > self._size[1] or self._backend is None:
            self._open(max(width, self._size[0]), max(height, self._size[1]))

    def refresh(self) -> list[int]:
        """Upload edited texture pixels and return the ids of these textures; other edits of the model need no call."""
        starts = self.model.tex_adr
        ends = np.append(starts[1:], len(self.model.tex_data))
        data, done = self.model.tex_data.reshape(-1), []
        last = self._uploaded.reshape(-1)
        for i in range(self.model.ntex):
            part = slice(int(starts[i]), int(ends[i]))
            if not np.array_equal(data[part], last[part]):
                last[part] = data[part]
                self._live().upload(i)
                done.append(i)
        return done

    def render(
        self,
        qpos: np.ndarray | None = None,
        bodies: Mapping[str, Sequence[float] | np.ndarray] | None = None,
        qvel: np.ndarray | None = None,
    ) -> dict[str, Shot]:
        """Render every camera.

        Args:
            qpos: (nq,) joint positions, rad and m; default: the present ones.
            bodies: by name, new positions (3,), m, of bodies in their parents, or poses (7,) with a quaternion w x y z.
                They stay in later renders.
            qvel: (nv,) joint velocities, rad/s and m/s; default: at rest.

        Returns:
            The shots by camera name.

        Raises:
            UserError: `qpos` or a pose has the wrong shape, a body is unknown, or the renderer is closed.
        """
        backend = self._live()
        if qpos is not None:
            if np.shape(qpos) != (self.model.nq,):
                raise UserError("not a configuration", key="qpos", expected=f"({self.model.nq},)", got=np.shape(qpos))
            self.data.qpos[:] = qpos
        self.move(bodies or {})
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        true = [view_of(c, parent, self.data) for c, parent in zip(self.cameras, self._parents, strict=True)]
        drawn = [View(self._pinhole(v.camera), v.pos, v.rot) for v in true] if self._warps else true
        pictures = backend.draw(self.data, drawn, self.labels or self.moving)
        shots = {}
        for view, parent, picture in zip(true, self._parents, pictures, strict=True):
            relative_to = range(self.model.nbody if self.moving else 1)
            twists = np.stack([velocity_of(view, parent, self.model, self.data, qvel, body) for body in relative_to])
            shots[view.camera.name] = self._shot(view, twists, picture)
        return shots

    def restart(self) -> None:
        """Reset the backend, so that later images do not depend on those rendered before.

        OpenGL and ray casting have no state to reset. Filament's context is recreated, which takes about half a second.
        """
        if self._backend is not None and self._backend.remembers:
            self._open(*self._size)

    def move(self, bodies: Mapping[str, Sequence[float] | np.ndarray]) -> None:
        """Place bodies in their parents, as for `render`. Raises UserError for an unknown body or a wrong shape."""
        for name, place in bodies.items():
            pose = np.asarray(place, float)
            body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name)
            if body < 0 or pose.shape not in ((3,), (7,)):
                names = [self.model.body(i).name for i in range(1, self.model.nbody)]
                what = "a body's position (3,), or pose (7,)"
                raise UserError("cannot move that", key="bodies", expected=what, got=name, choices=names)
            self.model.body_pos[body] = pose[:3]
            self.model.body_quat[body] = pose[3:] if len(pose) == 7 else self.model.body_quat[body]

    def close(self) -> None:
        """Free driver memory. A closed renderer cannot render."""
        if self._backend is not None:
            self._free()
            self._backend = None

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def _shot(self, view: View, twists: np.ndarray, picture: Picture) -> Shot:
        if self._warps and (warp := self._warps.get(view.camera)):
            picture = warp(picture)
        shot = Shot(picture.rgb, picture.depth, view.matrix, twists[0])
        if picture.ids is None:
            return shot
        if self.labels:
            placed = poses(self.model, self.data, view, *self._posed)
            labels = {"segmentation": self._table[picture.ids], "normal_of": _normals(picture, view), "poses": placed}
            shot = replace(shot, **labels)
        if self.moving:
            bodies = np.append(self.model.geom_bodyid, 0)[picture.ids]  # the last entry is for id -1, no hit
            shot = replace(shot, bodies=bodies, twists=twists)
        return shot

    def _pinhole(self, camera: Camera) -> Camera:
        warp = self._warps.get(camera)
        return warp.pinhole if warp else camera

    def _live(self) -> Backend:
        if self._backend is None:
            raise UserError("this renderer was closed")
        return self._backend

    def _open(self, width: int, height: int) -> None:
        self.close()
        self._backend, self._size = open_backend(self._wanted, self.model, width, height, self.shadows), (width, height)
        self._free = weakref.finalize(self, self._backend.close)  # also called when the renderer is garbage collected
        self._free.atexit = False  # at exit the driver is unloaded already
        self._uploaded = self.model.tex_data.copy()


def _normals(picture: Picture, view: View) -> Callable[[], np.ndarray]:
    """Return a function that computes an image's normals from a copy of its depth, since callers may modify theirs."""
    if (normals := picture.normals) is not None:
        return lambda: normals
    return partial(normals_of, picture.depth.copy(), view.camera)


def open_backend(name: BackendName, model: mujoco.MjModel, width: int, height: int, shadows: bool) -> Backend:
    """Return the backend of that name for images up to width x height px. Raises UserError if it does not work here."""
    from vispeg.render.backends.raycast import Raycast

    if name == "raycast":
        return Raycast(model)
    if name == "filament":
        from vispeg.render.backends.filament import Filament

        return Filament(model, shadows)
    from vispeg.render.backends.classic import Classic

    try:
        return Classic(model, width, height, shadows)
    except UserError as error:
        if name == "classic":
            raise
        note(f"pictures by ray casting, without shadows and highlights: {error}")
        return Raycast(model)
