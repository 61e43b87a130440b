"""Cameras of a batch of environments: one renderer per row with its episode's appearance, one pipeline per camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from vispeg.core.effect import effect
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render.backends.backend import BackendName, Renderer, Shot
from vispeg.render.block_matching import Matcher
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.render.contrast import redraw
from vispeg.render.image_kinds import DEPTH, RGB, ImageKind, key_of
from vispeg.render.look import dress
from vispeg.render.snapshot import Snapshot
from vispeg.robots.scene import Scene
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.split import moving, optical
from vispeg.worlds.world import World


class CameraRig:
    """The cameras of a batch of cells, one cell per row.

    The rig learns the state of a cell from Snapshots alone. It samples appearance, cameras and sensor effects; the
    simulation samples the physics.

    Args:
        scene: the cell.
        cameras: cameras in the cell; none for a rig that is used for `picture` only.
        world: ranges from which looks, cameras and sensor effects are sampled in each episode; its physics is ignored.
        rows: number of cells.
        kinds: kinds of images to deliver.
        period: time between two images, s.
        outside: the camera of `picture`.
        backend, shadows: passed to the renderers.
        look_seed: function from an episode's seed to the seed of its look; default: the same seed.

    Attributes:
        drawn: by row, the sampled world of the present episode.
        redrawn: number of looks that the contrast guard has refused so far, in all rows.
        varied: whether looks, cameras or sensor effects differ between episodes.
    """

    def __init__(
        self,
        scene: Scene,
        cameras: Sequence[Camera],
        world: RandomizedWorld,
        rows: int,
        *,
        kinds: Sequence[ImageKind],
        period: float,
        outside: Camera | None,
        backend: BackendName,
        shadows: bool,
        look_seed: Callable[[int], int] | None,
    ):
        self.scene, self.cameras, self.rows, self.kinds, self.period = scene, tuple(cameras), rows, kinds, period
        self.world = optical(world, [c.name for c in cameras])
        self.varied = bool(self.world.ranges)
        self.drawn, self.redrawn = [World()] * rows, 0
        self.backend: BackendName = backend
        self.shadows, self.outside = shadows, outside
        self._seed_of = look_seed or (lambda seed: seed)
        self._seeds = np.zeros(rows, np.int64)
        self._film: Renderer | None = None
        self._renderers = [self._renderer(self.cameras) for _ in range(rows if cameras else 0)]
        self._pipelines = {c.name: Pipeline([World()] * rows, c.name) for c in self.cameras}
        self._matchers = [Matcher(renderer, scene, backend) for renderer in self._renderers]
        self._snapshots: dict[int, Snapshot] = {}
        self._shots: dict[int, dict[str, Shot]] = {}
        self._matched: dict[int, dict[str, np.ndarray]] = {}  # by row and camera: depth by block matching
        self._new = np.zeros(rows, bool)  # rows rendered since their images were last delivered
        self._delivered: dict[str, np.ndarray] = {}
        for c in self.cameras:
            for kind in kinds:
                self._delivered[key_of(kind, c.name)] = np.zeros((rows, *kind.shape(c.height, c.width)), kind.dtype)

    def _renderer(self, cameras: Sequence[Camera]) -> Renderer:
        return Renderer(self.scene, cameras, self.backend, shadows=self.shadows, moving=moving(self.world))

    def begin(
        self,
        snapshots: Mapping[int, Snapshot],
        seeds: Mapping[int, int],
        levels: Mapping[str, float] | float = 1.0,
    ) -> None:
        """Begin new episodes in these rows: sample new looks and clear the sensors' state.

        Args:
            snapshots: by row, the state of the cell, in which the contrast guard judges a look.
            seeds: by row, the seed of the episode.
            levels: how far samples may be from nominal, as for `RandomizedWorld.sample`.
        """
        if not self.cameras:
            return
        for row, snapshot in snapshots.items():
            self._seeds[row] = self._seed_of(seeds[row])
            world, refused = redraw(
                self.world,
                self.scene,
                self._renderers[row],
                int(self._seeds[row]),
                levels,
                qpos=snapshot.qpos,
                bodies=snapshot.bodies,
            )
            self.drawn[row], self.redrawn = world, self.redrawn + refused
            self._matchers[row].begin(world, snapshot.bodies)
        for pipeline in self._pipelines.values():
            pipeline.place(list(snapshots), [self.drawn[row] for row in snapshots])

    def look(self, snapshots: Mapping[int, Snapshot]) -> None:
        """Render the cameras of these rows in the given states."""
        for row, snapshot in snapshots.items() if self.cameras else ():
            shots = self._renderers[row].render(snapshot.qpos, snapshot.bodies, snapshot.qvel)
            if DEPTH in self.kinds:
                self._matched[row] = self._matchers[row].depths(int(self._seeds[row]), snapshot)
            self._shots[row], self._snapshots[row], self._new[row] = shots, snapshot, True

    def see(self) -> dict[str, np.ndarray]:
        """Return the images of every row by key KIND_CAMERA, each (rows, C, H, W), as in vispeg.render.image_kinds.

        Rows that `look` has not rendered since the last call keep their images, so that a sensor with a memory (such as
        a latency) does not process the same moment twice.
        """
        if self._new.any():
            self._deliver(self._new)
            self._new[:] = False
        return {name: images.copy() for name, images in self._delivered.items()}

    def _deliver(self, rows: np.ndarray) -> None:
        """Pass the last shots of `rows` (rows,) bool through the pipelines, and keep the images for `see`."""
        subset = None if rows.all() else rows
        moments = [self._snapshots[row] for row in range(self.rows)]
        for c in self.cameras:
            shots = [self._shots[row][c.name] for row in range(self.rows)]
            frame, pipeline = self._frame(c, shots, moments), self._pipelines[c.name]
            if pipeline.stages:
                rng = [stream(int(s), "image", c.name, m.count) for s, m in zip(self._seeds, moments, strict=True)]
                frame = pipeline.run(frame, rng, subset)
            for kind in self.kinds:
                images = kind.deliver(frame)
                if images is not None:
                    self._delivered[key_of(kind, c.name)][rows] = images[rows]

    def _frame(self, camera: Camera, shots: Sequence[Shot], moments: Sequence[Snapshot]) -> Frame:
        depth = None
        truth = np.stack([s.depth for s in shots])
        colour = np.stack([s.rgb for s in shots]).astype(np.float32) / 255
        bodies = [s.bodies for s in shots if s.bodies is not None]
        twists = [s.twists for s in shots if s.twists is not None]
        if DEPTH in self.kinds:
            matched = [self._matched[row].get(camera.name) for row in range(self.rows)]
            depth = np.stack([s.depth if m is None else m for s, m in zip(shots, matched, strict=True)])
        return Frame(
            rgb=colour if RGB in self.kinds else None,
            depth=depth,
            K=np.repeat(camera.K[None], len(shots), axis=0),
            truth=truth,
            colour=colour,
            velocity=np.stack([s.velocity for s in shots]),
            bodies=np.stack(bodies) if bodies else None,
            twists=np.stack(twists) if twists else None,
            time=np.array([m.count for m in moments]) * self.period,
        )

    def views(self) -> dict[str, dict[str, np.ndarray]]:
        """Return by camera the true calibration in each row: `K` (rows, 3, 3) px, `distortion` (rows, 5) and
        `base_T_camera` (rows, 4, 4) m, with the sampled camera errors.
        """
        out = {}
        for k, c in enumerate(self.cameras):
            drawn = [r.cameras[k] for r in self._renderers]
            pose = np.stack([self._shots[row][c.name].pose for row in range(self.rows)])
            out[c.name] = {
                "K": np.stack([d.K for d in drawn]),
                "distortion": np.array([d.distortion for d in drawn]),
                "base_T_camera": pose,
            }
        return out

    def picture(self, row: int, snapshot: Snapshot) -> np.ndarray:
        """Return the image (H, W, 3) uint8 of a row from the outside camera, in the look of its episode.

        Raises:
            ValueError: the rig has no outside camera.
        """
        if self.outside is None:
            raise ValueError("this rig has no camera outside")
        if self._film is None:
            self._film = self._renderer([self.outside])
        looks = self.drawn[row].only(lambda e: effect(e.effect).family == "appearance")
        dress(self._film, self.scene, looks, snapshot.bodies)
        return self._film.render(snapshot.qpos, snapshot.bodies)[self.outside.name].rgb

    def close(self) -> None:
        """Free the renderers."""
        for r in (*self._renderers, *self._matchers, self._film):
            if r is not None:
                r.close()
