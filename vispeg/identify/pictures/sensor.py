"""Compare a camera's sensor with its model: figures of measured frames minus those of rendered and sensed ones."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from vispeg.core.effect import Effect, effect
from vispeg.core.robust import spread
from vispeg.core.rules import RULES
from vispeg.effects.common.disparity import PARAMS
from vispeg.identify.channels import shows
from vispeg.identify.evidence import Evidence
from vispeg.identify.pictures.depth_figures import ERROR, ORDINARY, DepthFigures
from vispeg.identify.pictures.figure import Figures
from vispeg.identify.pictures.light_figures import LightFigures
from vispeg.identify.pictures.shots import Shot
from vispeg.identify.pictures.sight import Sight
from vispeg.robots.scene import Scene
from vispeg.worlds.sensor import noise_of
from vispeg.worlds.world import World

Kind = Literal["depth", "light"]
WILD = 50.0  # multiples of its scatter beyond which a figure is ignored


@dataclass(frozen=True, eq=False)
class FigureItem:
    """Figures of one sight as a column.

    Attributes:
        sight, figures: the frames, and their figures.
        each: (k,) standard deviation of each figure between frames.
        kind: of channel, depth or light.
    """

    sight: Sight
    figures: Figures
    each: np.ndarray
    kind: Kind
    beside = None
    nj = 1

    @property
    def measured(self) -> np.ndarray:
        """Figures of all frames, one frame after the other, (n, 1)."""
        return np.nan_to_num(self.figures.measured).reshape(-1, 1)

    @cached_property
    def valid(self) -> np.ndarray:
        """(n, 1) bool."""
        return np.isfinite(self.figures.measured).reshape(-1, 1)

    @property
    def sigma(self) -> np.ndarray:
        """Noise of a figure, (1,): 1, because each figure is already divided by its scatter."""
        return np.ones(1)

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.sight.name


class SensorEvidence(Evidence):
    """Figures of depth or of light of some sights; poses are those that the borders determined.

    Args:
        scene: the cell.
        items: sights with their figures.
        kind: of channel.
    """

    floor_from = "scatter between frames, and the repeatability of a calibration"
    settled = World()
    least_change, changes_in = 1.0, "times what is ordinary"  # and its unit

    def __init__(self, scene: Scene, items: Sequence[FigureItem], kind: Kind):
        self._scene, self.items, self.kind = scene, list(items), kind
        self.notes: list[str] = []
        self.recordings = []
        self.held: frozenset[tuple[str, str]] = frozenset()
        self._recent_figures: list[tuple[World, list[np.ndarray]]] = []

    @property
    def scene(self) -> Scene:
        """The cell."""
        return self._scene

    @property
    def unit(self) -> str:
        """Unit of the figures: multiples of their scatter, since figures have different units."""
        return "times the scatter"

    def sees(self, kind: Effect) -> bool:
        """Return whether an effect acts on this kind of figures."""
        return shows(kind, self.kind)

    def frees(self, kind: Effect, name: str) -> bool:
        """Return whether a parameter may be fitted.

        The parameters in `held` and the dimensions of a stereo pair, which its data sheet states, may not.
        """
        return name not in PARAMS and (kind.name, name) not in self.held

    def holding(self, names: Collection[tuple[str, str]]) -> SensorEvidence:
        """Return a copy of the evidence in whose fits these effect parameters stay fixed."""
        out = copy(self)
        out.held = frozenset(names)
        return out

    def misplaced(self, world: World) -> list[np.ndarray]:
        """Return for each item (frames, figures) measured minus modelled, in units of the scatter; NaN if unknown."""
        for earlier, answer in self._recent_figures:
            if earlier == world:
                return answer
        out = []
        for item in self.items:
            away = (item.figures.measured - item.figures.modelled(world.over(self.scene.stated))) / item.each
            out.append(np.clip(away, -WILD, WILD))
        self._recent_figures = [(world, out), *self._recent_figures[:15]]
        return out

    def each_residual(self, worlds: Sequence[World]) -> Iterator[np.ndarray]:
        """Yield for each world the residuals of all figures, flat; unknown ones are 0."""
        return (np.concatenate([np.nan_to_num(r).ravel() for r in self.misplaced(world)]) for world in worlds)

    @property
    def least_gain(self) -> float:
        """Share of the held-out squared error that an added effect must remove."""
        return RULES.gain

    @property
    def most_effects(self) -> int:
        """Largest number of effects that a search may add."""
        return RULES.effects_few

    def blocks(self, seconds: float | None = None) -> np.ndarray:
        """Return the frame of each residual entry."""
        shapes = [i.figures.measured.shape for i in self.items]
        return np.repeat(np.arange(sum(s[0] for s in shapes)), np.concatenate([[s[1]] * s[0] for s in shapes]))

    def common_errors(self) -> np.ndarray:
        """Return (n, figures) columns: a figure is off by its floor in all frames, as by in-camera processing."""
        rows = [np.tile([f.floor for f in i.figures.table] / i.each, (len(i.figures.measured), 1)) for i in self.items]
        columns = [
            (i.valid.ravel() * r.ravel())[:, None] * np.tile(np.eye(r.shape[1]), (len(r), 1))
            for i, r in zip(self.items, rows, strict=True)
        ]
        return np.concatenate(columns)

    def change(self, first: World, other: World) -> float:
        """Return the largest difference of a figure between two worlds over all frames, in units of its `ordinary`."""
        return max((abs(v) for v in self._apart(self.misplaced(first), self.misplaced(other)).values()), default=0.0)

    def off(self, world: World) -> dict[str, float]:
        """Return by name how much figures differ from a world's over all frames, in units of their `ordinary`."""
        return self._apart(self.misplaced(world), [np.zeros_like(m) for m in self.misplaced(world)])

    def moves(self, first: World, other: World) -> dict[str, float]:
        """Return by name how much the figures differ between two worlds, in multiples of the `ordinary` size."""
        return self._apart(self.misplaced(first), self.misplaced(other))

    def _apart(self, first: Sequence[np.ndarray], other: Sequence[np.ndarray]) -> dict[str, float]:
        """Return by name the median difference of each figure over the frames, over its `ordinary`.

        Of several items that of the largest size; figures that do not count, and those known in under a third of an
        item's frames, are left out.
        """
        out: dict[str, float] = {}
        for item, a, b in zip(self.items, first, other, strict=True):
            for k, figure in enumerate(item.figures.table):
                apart = (a - b)[:, k][np.isfinite((a - b)[:, k])]
                if figure.counts and len(apart) >= len(a) / 3:
                    times = float(np.median(apart) * item.each[k] / figure.ordinary)
                    out[figure.name] = max(times, out.get(figure.name, 0.0), key=abs)
        return out

    def errors(self, worlds: Sequence[World]) -> list[float]:
        """Return the RMS of the figures' residuals under each world, in units of their scatter."""
        away = [np.concatenate([m.ravel() for m in self.misplaced(w)]) for w in worlds]
        return [float(np.sqrt(np.nanmean(a**2))) for a in away]

    def depth_error(self, world: World) -> float:
        """Return the RMS depth error over frames and distance bins, mm; only for figures of depth."""
        rows, pairs = self._errors, zip(self.items, self.misplaced(world), strict=True)
        off = [m[:, rows] * i.each[rows] for i, m in pairs]
        return 1e3 * float(np.sqrt(np.nanmean(np.concatenate([o.ravel() for o in off]) ** 2)))

    @property
    def depth_floor(self) -> float:
        """RMS scatter of the depth errors between frames, mm."""
        scatter = [i.each[self._errors][np.isfinite(i.figures.measured[:, self._errors]).any(0)] for i in self.items]
        return 1e3 * float(np.sqrt(np.mean(np.concatenate(scatter) ** 2)))

    @property
    def _errors(self) -> np.ndarray:
        """(figures,) bool: whether a figure is a depth error."""
        return np.array([f.name.startswith(ERROR) for f in self.items[0].figures.table])

    @property
    def floor(self) -> float:
        """RMS expected of a correct model in units of the scatter: 1."""
        return 1.0

    @property
    def floors(self) -> np.ndarray:
        """RMS expected of a correct model, (1,)."""
        return np.ones(1)


def sensor_evidence(
    scene: Scene, shots: Sequence[tuple[Sight, Sequence[Shot]]], kind: Kind, world: World
) -> SensorEvidence | None:
    """Return the figures of some sights' frames, or None if no frame has such a picture.

    Args:
        scene: the cell.
        shots: of each sight.
        kind: of channel.
        world: with the stated sensor, and the stated appearance if there is one.
    """
    world = world.over(scene.stated)
    lit = any(effect(e.effect).family == "appearance" for e in world.effects)
    items = []
    for sight, taken in shots:
        has = [s for s in taken if (s.depth if kind == "depth" else s.rgb) is not None]
        if not has:
            continue
        figures = DepthFigures(has, _ordinary(sight)) if kind == "depth" else LightFigures(has, lit)
        items.append(FigureItem(sight, figures, _scatter(figures, world), kind))
    return SensorEvidence(scene, items, kind) if items else None


def _ordinary(sight: Sight) -> tuple[float, float]:
    """Return the noise s0 + s1 z^2 of a camera's depth, m and 1/m, by its kind if stated.

    The variance is twice that of the noisiest camera of the kind, so that a camera at the end of its range is at half
    the threshold.
    """
    return (0.0, float(np.sqrt(2)) * noise_of(sight.sensor)) if sight.sensor else ORDINARY


def _scatter(figures: Figures, world: World) -> np.ndarray:
    """Return the standard deviation (k,) of each figure's residual between frames, at least its floor."""
    away = figures.measured - figures.modelled(world)
    columns = (c[np.isfinite(c)] for c in away.T)
    scatter = [spread(c) if len(c) else 1.0 for c in columns]
    return np.maximum(scatter, [f.floor for f in figures.table])
