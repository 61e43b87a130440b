"""Effects that one recording's pictures could show, before any fit: the same sizes as in a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vispeg.diagnosis.pictures.borders import BorderSearch
from vispeg.diagnosis.pictures.excited import Excitation, border_excitations
from vispeg.diagnosis.pictures.sensors import FINER, KINDS, SensorSearch, shots_by
from vispeg.identify.pictures.build import border_evidence, seeing
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.read import sights_of
from vispeg.identify.pictures.sensor import sensor_evidence
from vispeg.identify.pictures.sight import Sight
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

EXACT = 0.0  # rad: the difference of two predictions hardly depends on joint errors


def excitations(
    scene: Scene, rec: Recording, world: World, progress: Callable[[float], None] = lambda share: None
) -> list[Excitation]:
    """Return the change of a recording's pictures due to a typical size of each effect of camera, sensor and arm.

    Empty if no camera sees the cell.

    Args:
        scene: the nominal cell.
        rec: with frames.
        world: the model.
        progress: called with the finished share.

    Raises:
        UserError: a camera whose pose is not stated, or with too few frames.
    """
    (sights,), _ = seeing(scene, (sights_of([rec]),), world)
    if not sights:
        return []
    evidence, _ = border_evidence(scene, sights, [], world, EXACT)
    progress(0.4)
    out = border_excitations(BorderSearch(evidence, evidence), world)
    progress(0.5)
    return [*out, *_of_sensor(scene, sights, evidence, world)]


def _of_sensor(scene: Scene, sights: Sequence[Sight], evidence: BorderEvidence, world: World) -> list[Excitation]:
    """Return the change of the pictures by depth and light effects, once borders are matched."""
    cameras = list({s.camera.name: s.camera for s in sights}.values())
    with Predictor(scene, cameras, finer=FINER) as predictor:
        shots = shots_by(predictor, sights, evidence, evidence.settled)
    figures = (sensor_evidence(scene, shots, kind, world) for kind in KINDS)
    return [x for f in figures if f is not None for x in SensorSearch(f, f).excitations(world)]
