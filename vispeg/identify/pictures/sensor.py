"""A camera's sensor as evidence: figures of measured frames against those of rendered ones that passed through it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from vispeg.core.effect import Effect, effect
from vispeg.identify.channels import shows
from vispeg.identify.evidence import Evidence
from vispeg.identify.pictures.moments import depth_figures, light_figures
from vispeg.identify.pictures.nuisance import Whitener
from vispeg.identify.pictures.sight import Sight
from vispeg.robots.scene import Scene
from vispeg.vision.borders import borders_of
from vispeg.vision.eye import delay_of
from vispeg.vision.predict import Predictor, Seen, through_sensor
from vispeg.worlds.world import World

Kind = Literal["depth", "light"]
MOST = 10  # frames of a sight: figures are means over thousands of pixels
FLOORS = {"depth": 4e-3, "light": 0.03}  # what a figure is sure of at best: the rendered picture is no photograph
LOOK = np.array([1.0, 0.35, 0.35, 0.5, 0.15, 0.1, 0.5, 0.5])  # how far figures of light differ between looks, 1 sigma
SEED = 7  # of what the modelled sensor draws: the same in every world, so that differences are the world's
LATER = 0.01  # s


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame: what was measured, and its prediction before the sensor."""

    seen: Seen
    figures: Callable[[np.ndarray, np.ndarray], np.ndarray]
    measured: np.ndarray
    velocity: np.ndarray


@dataclass(frozen=True, eq=False)
class FigureItem:
    """One sight's figures as a column."""

    sight: Sight
    frames: tuple[Frame, ...]
    sigma_each: np.ndarray
    kind: Kind
    beside = None
    nj = 1

    @cached_property
    def measured(self) -> np.ndarray:
        """(n, 1) all frames' figures one after the other."""
        return np.nan_to_num(np.concatenate([f.measured for f in self.frames]))[:, None]

    @cached_property
    def valid(self) -> np.ndarray:
        """(n, 1) bool."""
        return np.isfinite(np.concatenate([f.measured for f in self.frames]))[:, None]

    @property
    def sigma(self) -> np.ndarray:
        """(1,) in units of itself: figures are whitened one by one."""
        return np.ones(1)

    @property
    def name(self) -> str:
        """Of the recording."""
        return self.sight.name


class SensorEvidence(Evidence):
    """Figures of depth or of light of some sights, rendered once as the given world places everything."""

    least_gain, most_effects = 0.03, 4
    floor_from = "scatter between frames"
    settled = World()

    def __init__(self, scene: Scene, items: Sequence[FigureItem], kind: Kind, world: World):
        self.scene, self.items, self.kind, self.world = scene, list(items), kind, world
        self.notes: list[str] = []
        self._whiten = [self._whitener(i) for i in self.items]
        self._recent: list[tuple[World, list[np.ndarray]]] = []

    @property
    def unit(self) -> str:
        """Figures have units of their own: multiples of their scatter are compared."""
        return "times the scatter"

    def sees(self, kind: Effect) -> bool:
        """Whether an effect shows in this kind of figures."""
        return shows(kind, self.kind)

    def misplaced(self, world: World) -> list[np.ndarray]:
        """Per item, measured less modelled figures in units of their scatter, flat; NaN where not known."""
        for known, answer in self._recent:
            if known == world:
                return answer
        out = []
        for item in self.items:
            rows = []
            for k, f in enumerate(item.frames):
                rgb, depth = through_sensor(world, f.seen, SEED + k, f.velocity, bend=False)
                rows.append((f.measured - f.figures(rgb, depth)) / item.sigma_each)
            out.append(np.clip(np.concatenate(rows), -200, 200))
        self._recent = [(world, out), *self._recent[:15]]
        return out

    def residuals(self, worlds: Sequence[World]) -> list[np.ndarray]:
        """Per world, all figures' residuals, what a look does to them counted as nuisance; flat."""
        return [
            np.concatenate([w(np.nan_to_num(r)) for w, r in zip(self._whiten, self.misplaced(world), strict=True)])
            for world in worlds
        ]

    @property
    def count(self) -> int:
        """Number of figures."""
        return int(sum(i.valid.sum() for i in self.items))

    def blocks(self, seconds: float = 0.0) -> np.ndarray:
        """The frame of every residual entry."""
        sizes = [len(f.measured) for i in self.items for f in i.frames]
        return np.repeat(np.arange(len(sizes)), sizes)

    def change(self, one: World, other: World) -> float:
        """RMS difference of the figures that a world changes, in units of their scatter."""
        pairs = zip(self.misplaced(one), self.misplaced(other), strict=True)
        apart = np.concatenate([(a - b)[np.isfinite(a - b)] for a, b in pairs])
        moved = np.abs(apart) > 0.1
        return float(np.sqrt(np.mean(apart[moved] ** 2))) if moved.any() else 0.0

    def error(self, world: World) -> float:
        """RMS of the figures in units of their scatter."""
        return float(np.sqrt(np.nanmean(np.concatenate(self.misplaced(world)) ** 2)))

    @property
    def floor(self) -> float:
        """1: the scatter itself."""
        return 1.0

    def _whitener(self, item: FigureItem) -> Whitener:
        size, n = len(item.sigma_each), len(item.frames)
        if self.kind == "depth":
            return Whitener.of(np.zeros((size * n, 1)))
        return Whitener.of(np.tile(np.diag(LOOK / item.sigma_each), (n, 1)))


def sensor_evidence(
    scene: Scene, sights: Sequence[Sight], kind: Kind, world: World, sigma: np.ndarray | None = None
) -> SensorEvidence | None:
    """The sights' figures, or None where no frame has such a picture.

    Args:
        world: as the borders found it: where everything is.
        sigma: scatter of the figures, as other sights showed it; estimated where None.
    """
    items = []
    cameras = list({s.camera.name: s.camera for s in sights}.values())
    geometry = replace(world, effects=tuple(e for e in world.effects if not effect(e.effect).channels() & {kind}))
    with Predictor(scene, cameras, finer=3 if kind == "light" else 1) as predictor:
        predictor.see(geometry)
        for sight in sights:
            frames = [f for i in _chosen(sight) if (f := _frame(predictor, sight, i, kind, world)) is not None]
            if len(frames) < 4:
                continue
            each = _scatter(frames, kind, world) if sigma is None else sigma
            items.append(FigureItem(sight, tuple(frames), each, kind))
    return SensorEvidence(scene, items, kind, world) if items else None


def _chosen(sight: Sight) -> np.ndarray:
    return np.linspace(0, len(sight) - 1, min(MOST, len(sight))).round().astype(int)


def _frame(predictor: Predictor, sight: Sight, i: int, kind: Kind, world: World) -> Frame | None:
    """A frame's prediction and measured figures; None without a picture or joints."""
    picture = sight.depth(i) if kind == "depth" else sight.rgb(i)
    name, late = sight.camera.name, -delay_of(world, sight.camera.name)
    q = sight.at(np.array([i, i]), late)[0]
    after = sight.at(np.array([i]), late + LATER)[0]
    if picture is None or not np.isfinite(q).all():
        return None
    velocity = _velocity(predictor, name, q, after if np.isfinite(after).all() else q)
    seen = predictor.draw(name, q)
    if kind == "depth":
        return Frame(seen, lambda rgb, depth: depth_figures(depth, seen), depth_figures(picture, seen), velocity)
    borders = borders_of(seen, predictor.geometry, step=3.0)
    flow = _flow(seen, velocity)

    def figures(rgb: np.ndarray, depth: np.ndarray) -> np.ndarray:
        return light_figures(rgb, seen, borders, flow)

    return Frame(seen, figures, light_figures(picture, seen, borders, flow), velocity)


def _velocity(predictor: Predictor, name: str, q: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(6,) m/s and rad/s of the camera in its own axes."""
    from scipy.spatial.transform import Rotation

    predictor.geometry.at(q)
    pos, rot = (np.array(v) for v in predictor.geometry.pose(name))
    predictor.geometry.at(after)
    then, turned = predictor.geometry.pose(name)
    turn = Rotation.from_matrix(rot.T @ turned).as_rotvec()
    return np.concatenate([rot.T @ (then - pos), turn]) / LATER


def _flow(seen: Seen, velocity: np.ndarray) -> np.ndarray:
    """(2,) px/s that the middle of the scene moves."""
    z = float(np.median(seen.depth[seen.depth > 0])) if (seen.depth > 0).any() else 1.0
    vx, vy, _, wx, wy, _ = velocity
    camera = seen.eye.believed
    return np.array([-camera.fx * (vx / z + wy), -camera.fy * (vy / z - wx)])


def _scatter(frames: Sequence[Frame], kind: Kind, world: World) -> np.ndarray:
    """(k,) scatter of each figure's difference from the prediction, from frame to frame; FLOORS at least."""
    rows = []
    for k, f in enumerate(frames):
        rgb, depth = through_sensor(world, f.seen, SEED + k, f.velocity, bend=False)
        rows.append(f.measured - f.figures(rgb, depth))
    away = np.array(rows)
    with np.errstate(all="ignore"):
        middle = np.nanmedian(away, 0)
        scatter = 1.4826 * np.nanmedian(np.abs(away - middle), 0)
    return np.maximum(np.nan_to_num(scatter, nan=1.0), FLOORS[kind])
