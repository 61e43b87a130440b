"""Where the bodies and cameras of a cell stand in a world: projections and rays, without drawing anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.render.backends.raycast import cast_rays
from vispeg.render.cameras import model_camera
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.view import parent_of, view_of
from vispeg.render.labels import part_table
from vispeg.render.look import Fields
from vispeg.robots.scene import Scene
from vispeg.vision.eye import Eye, delay_of, lens_of
from vispeg.worlds.places import acts_on, values
from vispeg.worlds.world import World

PLACES = ("body_pos", "body_quat", "cam_pos", "cam_quat", "cam_intrinsic")  # fields that move what is seen


class Geometry:
    """A cell with its cameras: `place` puts it into a world, `at` into a posture.

    Effects that the cell states are part of every world, except at cameras that are not here.

    Args:
        scene: the cell.
        cameras: as calibrated, whatever their names: effects of cameras act on these.

    Attributes:
        scene: the cell with these cameras.
        world: the one that it is in, with the stated effects.
        model, data: its own.
        eyes: by name, the cameras as the world makes them.
        offsets: (nj,) rad, measured minus true angle of each joint (the effect `encoder_offset`).
    """

    def __init__(self, scene: Scene, cameras: Sequence[Camera]):
        self.cameras, names = tuple(cameras), tuple(c.name for c in cameras)
        stated = (e for e in scene.stated if effect(e.effect).family != "camera" or acts_on(e.where, names))
        self.scene = replace(scene, cameras=names, stated=tuple(stated))
        spec = scene.spec()
        model_camera.add(spec, self.cameras)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.qadr = np.array([self.model.joint(j).qposadr[0] for j in scene.joints])
        self.table = part_table(self.model, scene.parts)
        self._parents = {c.name: parent_of(self.model, c.parent) for c in self.cameras}
        self._rows = {c.name: model_camera.row_of(self.model, c) for c in self.cameras}
        for c in self.cameras:
            if (row := self._rows[c.name]) is None:
                raise UserError("the cell has another camera of that name", key="camera", got=c.name)
            model_camera.write(self.model, row, c)
        self._nominal = {name: getattr(self.model, name).copy() for name in PLACES}
        self.place(World())

    def place(self, world: World) -> None:
        """Put cameras, fixture and held part where a world has them, and the joints' zeros.

        Raises:
            UserError: an effect at a place that the cell does not have.
        """
        for name, nominal in self._nominal.items():
            getattr(self.model, name)[:] = nominal
        self.world = world = world.over(self.scene.stated)
        fields = Fields(self.model, self.scene)
        kinds = {e.effect: effect(e.effect) for e in world.effects}
        for kind in sorted(kinds.values(), key=lambda k: (k.order, k.name)):
            if kind.writes & set(PLACES):
                kind.write(fields, values(kind, [world.effects], self.scene))
        self.eyes: dict[str, Eye] = {}
        for c in self.cameras:
            row = self._rows[c.name]
            moved = any((getattr(self.model, n)[row] != self._nominal[n][row]).any() for n in PLACES[2:])  # cam_*
            camera = model_camera.read(self.model, row, c) if moved and row is not None else c
            self.eyes[c.name] = Eye(camera, c, lens_of(world, c.name), delay_of(world, c.name))
        offset = values(effect("encoder_offset"), [world.effects], self.scene)
        self.offsets = next(iter(offset.values()))[0]

    def at(self, q: np.ndarray) -> None:
        """Move to measured joint angles (nj,) rad."""
        self.data.qpos[:] = self.model.qpos0
        self.data.qpos[self.qadr] = q - self.offsets
        mujoco.mj_kinematics(self.model, self.data)

    @property
    def bodies(self) -> dict[str, np.ndarray]:
        """(7,) m and w x y z: where the scene's things are placed in their parents."""
        out = {}
        for name in self.scene.things:
            i = self.model.body(name).id
            out[name] = np.concatenate([self.model.body_pos[i], self.model.body_quat[i]])
        return out

    def pose(self, camera: str) -> tuple[np.ndarray, np.ndarray]:
        """Return a camera's optical centre (3,) m and axes (3, 3), one a column, in the base frame."""
        view = view_of(self.eyes[camera].camera, self._parents[camera], self.data)
        return view.pos, view.rot

    def carrier(self, camera: str) -> int:
        """Return the id of the body that carries a camera."""
        kind, i = self._parents[camera]
        return int(self.model.site_bodyid[i]) if kind == "site" else i

    def project(self, camera: str, body: np.ndarray, local: np.ndarray) -> np.ndarray:
        """Return the pixels (n, 2) of points (n, 3) m, each in the axes of its body (n,) id; NaN behind the camera."""
        turn = self.data.xmat.reshape(-1, 3, 3)[body]
        points = self.data.xpos[body] + np.einsum("nij,nj->ni", turn, local)
        pos, rot = self.pose(camera)
        return self.eyes[camera].project((points - pos) @ rot)

    def cast(self, camera: str, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what pixels (n, 2) show: planar depth (n,) m, 0 for nothing; geom (n,) id, -1; part (n,), 0."""
        pos, rot = self.pose(camera)
        ideal = self.eyes[camera].ideal(np.asarray(pixels, float))
        rays = np.concatenate([np.nan_to_num(ideal), np.ones((len(ideal), 1))], 1)
        length = np.linalg.norm(rays, axis=1)
        depth, geom, _ = cast_rays(self.model, self.data, pos, (rays / length[:, None]) @ rot.T, length)
        return depth, geom, self.table[geom]

    def local(self, camera: str, pixels: np.ndarray, depth: np.ndarray, geom: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return body (n,) and point in its axes (n, 3) m of what pixels show at a planar depth on a geom."""
        pos, rot = self.pose(camera)
        ideal = self.eyes[camera].ideal(np.asarray(pixels, float))
        points = pos + (np.concatenate([ideal, np.ones((len(ideal), 1))], 1) * depth[:, None]) @ rot.T
        body = np.where(geom < 0, 0, self.model.geom_bodyid[geom])
        turn = self.data.xmat.reshape(-1, 3, 3)[body]
        return body, np.einsum("nji,nj->ni", turn, points - self.data.xpos[body])
