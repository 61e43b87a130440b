"""Find sensor effects on depth and light, once the borders are aligned with the pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.shares import Share, by_label, each_left_out
from vispeg.diagnosis.findings import Rivals
from vispeg.diagnosis.pictures.excited import Excitation
from vispeg.diagnosis.pictures.parts import in_parts
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.diagnosis.pictures.spread import confirmed
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.schema import Channel, NoiseFloor, Rung, ShowsFrom
from vispeg.diagnosis.selection.state import State
from vispeg.identify.pictures.depth_figures import ERROR
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.sensor import Kind, SensorEvidence, sensor_evidence
from vispeg.identify.pictures.shots import Shot, shots_of
from vispeg.identify.pictures.sight import Sight
from vispeg.robots.scene import Scene
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

KINDS: tuple[Kind, ...] = ("depth", "light")
FINER = 3  # rays per pixel and direction, so that a rendered border is as soft as a pixel makes it


class SensorSearch(PictureSearch):
    """A search restricted to effects that change a figure outside its ordinary range."""

    def places(self, world: World) -> list[tuple[str, str]]:
        """Return (effect, place) of every such effect that the world lacks; empty if no figure is out of range."""
        evidence = self.evidence
        assert isinstance(evidence, SensorEvidence)
        odd = {name for name, size in evidence.off(world).items() if abs(size) > self.least}
        out = []
        for at in super().places(world) if odd else ():
            changed = [evidence.moves(world.add(e), world) for e in self._secants(*at).values()]
            if any(abs(c.get(figure, 0.0)) > RULES.figure_repeats for c in changed for figure in odd):
                out.append(at)
        return out

    def least_times(self, placed: EffectInstance, world: World, without: World) -> float:
        """Return the multiple as `PictureSearch` does, but at least that at which a figure leaves its ordinary range.

        It does so even if its present error is of the other sign.
        """
        evidence = self.evidence
        assert isinstance(evidence, SensorEvidence)
        off, moves = evidence.off(without), evidence.moves(world, without)
        leaves = [(self.least + abs(off.get(k, 0.0))) / abs(v) for k, v in moves.items() if v]
        return max(super().least_times(placed, world, without), min(leaves, default=np.inf))

    def excitations(self, world: World) -> list[Excitation]:
        """Return the change of the held-out frames due to each parameter of every effect at a typical size."""
        return [self._excitation(world, *at) for at in super().places(world)]

    def _excitation(self, world: World, name: str, where: str) -> Excitation:
        judged = self.judged
        assert isinstance(judged, SensorEvidence)
        sizes = {k: judged.change(world.add(e), world) for k, e in self._secants(name, where).items()}
        silent = tuple(k for k, size in sizes.items() if size < RULES.figure_repeats)
        return Excitation(name, where, judged.kind, max(sizes.values(), default=0.0), RULES.figure_repeats, silent)


@dataclass(frozen=True)
class Sensed:
    """Result of the sensor search on one kind of pictures.

    Attributes:
        kind: of the pictures.
        state: final state of the search.
        rivals: of the effects that were found.
        evidence, judged: fitted and held-out figures.
        before: the user's model.
        excitations: which effects these pictures could show.
        shows_from: from which size they would have shown an effect.
        alike: which parameters of one effect are confounded, in words.
    """

    kind: Kind
    state: State
    rivals: list[Rivals]
    evidence: SensorEvidence
    judged: SensorEvidence
    before: World
    excitations: list[Excitation]
    shows_from: list[ShowsFrom]
    alike: tuple[str, ...] = ()

    @property
    def added(self) -> tuple[EffectInstance, ...]:
        """Effects that were found."""
        return self.state.world.effects[len(self.before.effects) :]

    @property
    def errors(self) -> tuple[float, float]:
        """Held-out RMS of the figures in units of their scatter, before and after."""
        before, after = self.judged.errors([self.before, self.state.world])
        return before, after

    @property
    def worst(self) -> tuple[str, float, float]:
        """Figure with the largest final error, and that error before and after, in units of its `ordinary`."""
        after, before = (self.judged.off(w) for w in (self.state.world, self.before))
        name = max(after, key=lambda k: abs(after[k]), default="")
        return (name, abs(before[name]), abs(after[name])) if name else ("no figure", 0.0, 0.0)

    @property
    def in_metres(self) -> bool:
        """Whether the found effects change the depth error by more than good cameras differ."""
        moved = self.judged.moves(self.before, self.state.world)
        return any(abs(v) > 1.0 for k, v in moved.items() if k.startswith(ERROR))

    def ladder(self) -> tuple[list[Rung], NoiseFloor]:
        """Return the errors of each intermediate model and the noise floor; in mm of depth if `in_metres`."""
        models = [("nominal", self.before), *((f"+ {t.score.label}", t.fit.world) for t, _ in self.state.steps)]
        if self.added and self.state.world != models[-1][1]:
            models[-1] = (f"+ {' + '.join(e.label for e in self.added)}", self.state.world)
        metres = self.in_metres
        unit = "mm RMS" if metres else f"{self.judged.unit} RMS"
        rungs: list[Rung] = []
        for name, world in models:
            fit, held = (self._error(e, world) for e in (self.evidence, self.judged))
            rungs.append({"model": name, "fit_error": fit, "heldout_error": held, "unit": unit})
        return rungs, {"value": self._floor, "unit": unit, "from": self.evidence.floor_from}

    @property
    def explained(self) -> dict[str, Share]:
        """What each found effect explains, by its label: its error is that of the ladder, its share that of figures."""
        n_fixed, (before, after) = len(self.before.effects), self.errors
        worlds = each_left_out(self.state.world, n_fixed)
        times = [self._error(self.judged, world) / self._floor for world in worlds]
        squares = [error**2 for error in self.judged.errors(worlds)]
        return by_label(self.state.world, n_fixed, times, squares, before**2, after**2)

    def _error(self, evidence: SensorEvidence, world: World) -> float:
        """Return the error of a world in the ladder."""
        return evidence.depth_error(world) if self.in_metres else evidence.errors([world])[0]

    @property
    def _floor(self) -> float:
        """The noise floor of the ladder."""
        return self.judged.depth_floor if self.in_metres else self.judged.floor

    @property
    def fall(self) -> str:
        """Text on the change of the held-out error."""
        if self.in_metres:
            ends = [self.judged.depth_error(w) for w in (self.before, self.state.world)]
            return f"held-out depth moved from {ends[0]:.1f} to {ends[1]:.1f} mm off"
        return f"held-out figures of {self.kind} from {self.errors[0]:.1f} to {self.errors[1]:.1f} times their scatter"

    @property
    def channel(self) -> Channel:
        """The channel's entry in a record."""
        cameras = " and ".join(dict.fromkeys(i.sight.camera.name for i in self.judged.items))
        if self.in_metres:
            before, after = (self.judged.depth_error(w) for w in (self.before, self.state.world))
            floor, unit = self.judged.depth_floor, "mm RMS"
        else:
            (before, after), floor, unit = self.errors, self.judged.floor, self.judged.unit
        return {"channel": self.kind, "joint": cameras, "floor": floor, "before": before, "after": after, "unit": unit}

    def as_dict(self) -> dict:
        """Return the record's entry: each figure's deviation in units of its `ordinary`, before and after."""
        before, after = (self.judged.off(w) for w in (self.before, self.state.world))
        both = [k for k in before if k in after]  # a world may leave too few frames with a figure
        figures = [{"figure": k, "before": round(before[k], 2), "after": round(after[k], 2)} for k in both]
        return {"kind": self.kind, "figures": figures, "ladder": self.ladder()[0] if self.added else []}


def sensor_search(
    scene: Scene,
    sights: tuple[Sequence[Sight], Sequence[Sight]],
    borders: tuple[BorderEvidence, BorderEvidence],
    world: World,
    placed: World,
    say: Callable[[str], None],
    progress: Progress | None = None,
) -> list[Sensed]:
    """Search the frames for effects on depth and light.

    Args:
        scene: the cell.
        sights: fitted and held-out.
        borders: evidence of the same two, with the aligned world.
        world: the user's model; sensor effects in it are not searched again.
        placed: the model with the effects found by borders, from which the frames are rendered.
        say: called with progress messages.
        progress: caches the result of each fit.

    Returns:
        A result for each kind of pictures of which both have enough.
    """
    cameras = list({s.camera.name: s.camera for group in sights for s in group}.values())
    out = []
    with Predictor(scene, cameras, finer=FINER) as predictor:
        shots = [shots_by(predictor, group, e, placed) for group, e in zip(sights, borders, strict=True)]
        scene = predictor.scene
    for kind in KINDS:
        evidence, judged = (sensor_evidence(scene, s, kind, world) for s in shots)
        if evidence is None or judged is None:
            continue
        say(f"fitting what the sensor does to {kind}")
        search = SensorSearch(evidence, judged, say, progress)
        state = search.run(world)
        rivals = search.rivals(state)
        state, alike = in_parts(search, confirmed(search, state))
        kept = {e.label for e in state.world.effects}
        rivals = [r for r in rivals if r.label in kept]
        excitations, shows_from = search.excitations(world), search.shows_from(state)
        out.append(Sensed(kind, state, rivals, evidence, judged, world, excitations, shows_from, alike))
    return out


def shots_by(
    predictor: Predictor, sights: Sequence[Sight], borders: BorderEvidence, world: World
) -> list[tuple[Sight, list[Shot]]]:
    """Return the frames of sights as a world predicts them, at the postures fitted to their borders."""
    return [
        (sight, shots_of(predictor, sight, world, posture))
        for sight, posture in zip(sights, borders.postures(world), strict=True)
    ]
