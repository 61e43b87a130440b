"""The sensor's own effects, on depth and on light, once the borders stand where the pictures have them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.conclusion.rivals import Rivals
from vispeg.diagnosis.pictures.excited import Excitation
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.diagnosis.pictures.spread import confirmed
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.schema import Channel
from vispeg.diagnosis.selection.state import State
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.sensor import Kind, SensorEvidence, sensor_evidence
from vispeg.identify.pictures.shots import Shot, shots_of
from vispeg.identify.pictures.sight import Sight
from vispeg.robots.scene import Scene
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

KINDS: tuple[Kind, ...] = ("depth", "light")
ODD = 0.8  # times the ordinary, from which on a figure asks for an effect
CHANGED = 0.2  # ... and by which an effect of a typical size has to change it
FINER = 3  # rays a pixel in each direction: a rendered border is as soft as a pixel makes it


class SensorSearch(PictureSearch):
    """A search among the effects that change a figure which is out of the ordinary, and no others."""

    def places(self, world: World) -> list[tuple[str, str]]:
        """Every such effect, at every place that the world has it not at yet."""
        evidence = self.evidence
        assert isinstance(evidence, SensorEvidence)
        odd = {name for name, size in evidence.off(world).items() if abs(size) > ODD}
        out = []
        for at in super().places(world) if odd else ():
            changed = [evidence.moves(world.add(e), world) for e in self._secants(*at).values()]
            if any(abs(c.get(figure, 0.0)) > CHANGED for c in changed for figure in odd):
                out.append(at)
        return out

    def excitations(self, world: World) -> list[Excitation]:
        """What every effect's numbers, one by one at a typical size, change in the frames to judge on."""
        return [self._excitation(world, *at) for at in super().places(world)]

    def _excitation(self, world: World, name: str, where: str) -> Excitation:
        judged = self.judged
        assert isinstance(judged, SensorEvidence)
        sizes = {k: judged.change(world.add(e), world) for k, e in self._secants(name, where).items()}
        silent = tuple(k for k, size in sizes.items() if size < CHANGED)
        return Excitation(name, where, judged.kind, max(sizes.values(), default=0.0), CHANGED, silent)


@dataclass(frozen=True)
class Sensed:
    """What one kind of pictures says of the sensor: where a search of it ended, and the evidence that it judged on.

    `excitations` says which effects these pictures could show.
    """

    kind: Kind
    state: State
    rivals: list[Rivals]
    judged: SensorEvidence
    before: World
    excitations: list[Excitation]

    @property
    def added(self) -> tuple[EffectInstance, ...]:
        """The effects that were found."""
        return self.state.world.effects[len(self.before.effects) :]

    @property
    def errors(self) -> tuple[float, float]:
        """Held-out RMS of the figures in units of their scatter, before and after."""
        return self.judged.error(self.before), self.judged.error(self.state.world)

    @property
    def channel(self) -> Channel:
        """For a record."""
        before, after = self.errors
        cameras = " and ".join(dict.fromkeys(i.sight.camera.name for i in self.judged.items))
        floor, unit = self.judged.floor, self.judged.unit
        return {"channel": self.kind, "joint": cameras, "floor": floor, "before": before, "after": after, "unit": unit}

    def as_dict(self) -> dict:
        """For a record: each figure's deviation in multiples of what is ordinary, before and after."""
        before, after = (self.judged.off(w) for w in (self.before, self.state.world))
        figures = [{"figure": k, "before": round(v, 2), "after": round(after[k], 2)} for k, v in before.items()]
        return {"kind": self.kind, "figures": figures}


def sensor_search(
    scene: Scene,
    sights: tuple[Sequence[Sight], Sequence[Sight]],
    borders: tuple[BorderEvidence, BorderEvidence],
    world: World,
    placed: World,
    say: Callable[[str], None],
    progress: Progress | None = None,
) -> list[Sensed]:
    """What the frames say of depth and light.

    Args:
        scene: the cell.
        sights: to fit and to judge on.
        borders: the same two, where everything stands.
        world: the model; what it states of the sensor is not searched again.
        placed: the model with what the borders found.
        say: is told what is being done.
        progress: remembers where each fit ended.
    """
    cameras = list({s.camera.name: s.camera for some in sights for s in some}.values())
    out = []
    with Predictor(scene, cameras, finer=FINER) as predictor:
        shots = [shots_by(predictor, some, e, placed) for some, e in zip(sights, borders, strict=True)]
    for kind in KINDS:
        evidence, judged = (sensor_evidence(scene, s, kind, world) for s in shots)
        if evidence is None or judged is None:
            continue
        say(f"fitting what the sensor does to {kind}")
        search, n_fixed = SensorSearch(evidence, judged, say, progress), len(world.effects)
        state = search.run(world)
        rivals = search.rivals(state, n_fixed)
        out.append(Sensed(kind, confirmed(search, state, n_fixed), rivals, judged, world, search.excitations(world)))
    return out


def shots_by(
    predictor: Predictor, sights: Sequence[Sight], borders: BorderEvidence, world: World
) -> list[tuple[Sight, list[Shot]]]:
    """The frames of sights as a world predicts them, at the postures that their borders ask for."""
    return [
        (sight, shots_of(predictor, sight, world, posture))
        for sight, posture in zip(sights, borders.postures(world), strict=True)
    ]
