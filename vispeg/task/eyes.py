"""What the cameras of every row see: a renderer a row, dressed in its episode's look, and a pipeline a camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render import block_matching
from vispeg.render.backend import Renderer, Shot
from vispeg.render.camera import Camera
from vispeg.render.camera_files import load_camera
from vispeg.render.contrast import redraw
from vispeg.render.image_kinds import DEPTH, MODES, RGB, key_of
from vispeg.render.look import dress
from vispeg.render.pipeline import Pipeline
from vispeg.render.standard import standard_cameras

if TYPE_CHECKING:
    from vispeg.task.simulation import TaskSimulation

FILM = (320, 240)  # px, width and height of pictures for people


def image_spaces(obs_mode: str, cameras: Sequence[Camera]) -> dict[str, gym.Space]:
    """Spaces KIND_CAMERA of a mode's images, as vispeg.render.image_kinds states them; depth first."""
    out: dict[str, gym.Space] = {}
    for c in cameras:
        for kind in sorted(MODES[obs_mode], key=lambda k: k.name):
            out[key_of(kind, c.name)] = gym.spaces.Box(0, kind.high, kind.shape(c.height, c.width), kind.dtype)
    return out


def task_cameras(sim: TaskSimulation, given: Mapping[str, Any]) -> tuple[Camera, ...]:
    """The cameras that a task is seen through.

    Args:
        sim: whose scene they stand in, and whose task names them.
        given: a world file's `cameras`: a file, or a mapping of what differs from the standard camera of that name.
    """
    known = {c.name: c for c in standard_cameras(sim.scene.tip, sim.scene.target)}
    for name, change in given.items():
        if isinstance(change, str):
            known[name] = load_camera(change).moved(name=name)
        else:
            try:
                known[name] = known.get(name, known["external"]).moved(name=name, **change)
            except TypeError as error:
                raise UserError(f"unknown key of a camera ({error})", key=f"cameras.{name}", got=list(change)) from None
    wanted, size = sim.config.cameras, sim.config.image_size
    for name in wanted:
        if name not in known:
            raise UserError("unknown camera", key="cameras", got=name, choices=known)
    return tuple(resized(known[n], size) if size else known[n] for n in wanted)


def resized(camera: Camera, size: int) -> Camera:
    """The camera with `size` px along its shorter side and the same field of view."""
    s = size / min(camera.width, camera.height)
    return camera.moved(
        width=round(camera.width * s),
        height=round(camera.height * s),
        fx=camera.fx * s,
        fy=camera.fy * s,
        cx=(camera.cx + 0.5) * s - 0.5,
        cy=(camera.cy + 0.5) * s - 0.5,
    )


def camera_velocity(camera: Camera, pose: np.ndarray, twist: np.ndarray, flange: np.ndarray) -> np.ndarray:
    """Velocity (n, 6) of a camera in its own axes, m/s and rad/s; 0 for one that stands.

    Args:
        camera: what carries it decides whether it moves.
        pose: (n, 4, 4) camera axes in the base.
        twist: (n, 6) of the flange, base axes.
        flange: (n, 3) its position, m.
    """
    if camera.parent == "base":
        return np.zeros((len(pose), 6))
    linear = twist[:, :3] + np.cross(twist[:, 3:], pose[:, :3, 3] - flange)
    turn = np.swapaxes(pose[:, :3, :3], 1, 2)
    return np.concatenate([np.einsum("nij,nj->ni", turn, linear), np.einsum("nij,nj->ni", turn, twist[:, 3:])], axis=1)


class CameraRig:
    """The cameras of a simulation.

    Args:
        sim: whose rows are seen.
        obs_mode: what of the pictures an observation holds.
        file: the world's file, for its cameras and renderer; or None.
        backend: of the renderer, where the file names none.

    Attributes:
        redrawn: looks that the contrast guard refused so far, in all rows.
    """

    def __init__(
        self,
        sim: TaskSimulation,
        obs_mode: str,
        file: Any = None,
        backend: str = "auto",
    ):
        self.sim, self.redrawn = sim, 0
        chosen = dict(file.renderer) if file is not None else {}
        self.backend, self.shadows = chosen.get("backend", backend), bool(chosen.get("shadows", False))
        self._camera_file = dict(file.cameras) if file is not None else {}
        self.cameras: tuple[Camera, ...] = ()
        self.wanted = MODES[obs_mode]
        self._film: Renderer | None = None
        self._infrared: dict[int, Renderer] = {}
        self._guard: Renderer | None = None
        self._renderers: list[Renderer] = []
        self._new = np.zeros(sim.nsim, bool)  # rows drawn anew since they were last delivered
        self._delivered: dict[str, np.ndarray] = {}
        if not sim.scene.cameras:
            return
        self.cameras = task_cameras(sim, self._camera_file)
        self._renderers = [self._renderer(self.cameras) for _ in range(sim.nsim)]
        self._pipelines = {
            c.name: Pipeline([replace(sim.world, effects=(), ranges=())] * sim.nsim, c.name) for c in self.cameras
        }
        self._matchers: list[dict[str, dict[str, float]]] = [{} for _ in range(sim.nsim)]  # cameras that match depth
        self._shots: list[dict[str, Shot] | None] = [None] * sim.nsim
        self._delivered = {
            name: np.zeros((sim.nsim, *(space.shape or ())), space.dtype)
            for name, space in image_spaces(obs_mode, self.cameras).items()
        }
        self._varied = any(effect(r.effect).family == "appearance" for r in sim.world.ranges)

    def _renderer(self, cameras: Sequence[Camera], labels: bool = False) -> Renderer:
        return Renderer(self.sim.scene, cameras, self.backend, labels=labels, shadows=self.shadows)  # type: ignore[arg-type]

    def begin(self, rows: np.ndarray) -> None:
        """New episodes in these rows: new looks, and sensors that remember nothing."""
        if not self.cameras:
            return
        for row in rows:
            world = self.sim.drawn[row]
            if self._varied:
                self._guard = self._guard or self._renderer(self.cameras, labels=True)
                self._guard.render(self.sim.cell.qpos[row], self.sim.bodies(row))  # puts the fixture where it stands
                world, refused = redraw(
                    self.sim.world,
                    self.sim.scene,
                    self._guard,
                    int(self.sim.seeds[row]),
                    self.sim.levels,
                    qpos=self.sim.cell.qpos[row],
                )
                self.redrawn += refused
                self.sim.drawn[row] = world
            dress(self._renderers[row], self.sim.scene, world)
            found = {c.name: block_matching.settings(world, c.name) for c in self.cameras}
            self._matchers[row] = {name: p for name, p in found.items() if p is not None}
            if (
                self._matchers[row] and self.backend == "filament"
            ):  # an infrared pair needs no materials, but many pixels
                if row not in self._infrared:
                    self._infrared[row] = Renderer(self.sim.scene, self.cameras, "auto")
                dress(self._infrared[row], self.sim.scene, world)
            self._shots[row] = None
        for pipeline in self._pipelines.values():
            pipeline.place(rows.tolist(), [self.sim.drawn[row] for row in rows])

    def look(self, rows: Sequence[int] | np.ndarray) -> None:
        """Draws these rows as they stand now."""
        sim = self.sim
        for row in rows if self.cameras else ():
            shots = self._renderers[row].render(sim.cell.qpos[row], sim.bodies(row))
            for name, p in self._matchers[row].items() if DEPTH in self.wanted else ():
                rng = stream(int(sim.seeds[row]), "eyes", name, int(sim.count[row]))
                qpos, eyes = sim.cell.qpos[row], self._infrared.get(row, self._renderers[row])
                if eyes is not self._renderers[row]:
                    eyes.render(qpos, sim.bodies(row))
                shots[name] = replace(shots[name], depth=block_matching.depth(eyes, name, p, rng, qpos))
            self._shots[row], self._new[row] = shots, True

    def see(self) -> dict[str, np.ndarray]:
        """The images of every row, as `image_spaces` states; rows are drawn anew by `look`.

        What was not drawn anew is delivered as before: a camera that remembers does not see a moment twice.
        """
        if self._new.any():
            self._deliver(self._new)
            self._new[:] = False
        return {name: images.copy() for name, images in self._delivered.items()}

    def _deliver(self, rows: np.ndarray) -> None:
        sim, some = self.sim, None if rows.all() else rows
        for i, c in enumerate(self.cameras):
            shots = [shots[c.name] for shots in self._shots if shots is not None]
            rng = [stream(int(s), "image", c.name, int(k)) for s, k in zip(sim.seeds, sim.count, strict=True)]
            frame = self._pipelines[c.name].run(self._frame(i, c, shots), rng, some)
            for kind in self.wanted:
                images = kind.deliver(frame)
                if images is not None:
                    self._delivered[key_of(kind, c.name)][rows] = images[rows]

    def _frame(self, i: int, camera: Camera, shots: Sequence[Shot]) -> Frame:
        rgb = depth = None
        truth = np.stack([s.depth for s in shots])
        if RGB in self.wanted:
            rgb = np.stack([s.rgb for s in shots]).astype(np.float32) / 255
        if DEPTH in self.wanted:
            depth = truth
        poses = np.stack([s.pose for s in shots])
        return Frame(
            rgb=rgb,
            depth=depth,
            K=np.repeat(camera.K[None], len(shots), axis=0),
            truth=truth,
            velocity=camera_velocity(camera, poses, self.sim.twist, self.sim.cell.site_position("flange")),
            time=self.sim.count * self.sim.config.policy_period,
        )

    def picture(self, row: int) -> np.ndarray:
        """A row from outside, (240, 320, 3) uint8, in its episode's look."""
        if self._film is None:
            side = standard_cameras(self.sim.scene.tip, self.sim.scene.target)[2]
            width, height = FILM
            film = resized(side, height).moved(name="film", width=width, cx=(width - 1) / 2)
            self._film = self._renderer([film])
        world = self.sim.drawn[row]
        looks = [e for e in world.effects if effect(e.effect).family == "appearance"]
        dress(self._film, self.sim.scene, replace(world, effects=tuple(looks)))
        return self._film.render(self.sim.cell.qpos[row], self.sim.bodies(row))["film"].rgb

    def close(self) -> None:
        """Frees the renderers."""
        for r in (*self._renderers, *self._infrared.values(), self._film, self._guard):
            if r is not None:
                r.close()
