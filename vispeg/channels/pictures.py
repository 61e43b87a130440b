"""The pictures channel: what cameras see of the things around the arm: their borders, their depth, their light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from vispeg.channels.channel import Both, Channel, How
from vispeg.channels.joints import READINGS, comparable
from vispeg.core.effect import OPTICAL, Effect, effect
from vispeg.core.errors import UserError
from vispeg.diagnosis.compare import Comparison
from vispeg.diagnosis.pictures.run import diagnose_pictures
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.schema import ComparisonRecord, Rung
from vispeg.identify.pictures.build import border_evidence, seeing
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.read import sights_of
from vispeg.recordings.progress import Reading, silent
from vispeg.recordings.recording import Recording
from vispeg.render.cameras.camera import Camera
from vispeg.robots.bench import shows
from vispeg.robots.objects import is_object
from vispeg.robots.scene import Scene
from vispeg.task import belief
from vispeg.task.belief import bench_of, cell_of
from vispeg.vision.compare import Compared, border_rms, compare_frames
from vispeg.vision.eye import camera_of
from vispeg.vision.show import pictures
from vispeg.worlds.words import place
from vispeg.worlds.world import World

STANDS = {"body_pos", "body_quat"}  # an effect that writes one of these moves the fixture or the held part


class Pictures(Channel):
    """What cameras see of a cell, or of the things in a robot's own file beside the arm."""

    name = "pictures"
    order = 20
    lead = 60

    def has(self, world: World, recordings: Sequence[Recording]) -> bool:
        """Say whether all hold pictures, and the model has things beside the arm for the cameras to see."""
        if is_object(world.robot) or not all(rec.frames is not None and len(rec.frames) > 0 for rec in recordings):
            return False
        return all(seen(world, rec) for rec in recordings)

    def shows(self, kind: Effect) -> bool:
        """Say whether the effect is of cameras and light, or moves borders in the picture."""
        return kind.family in OPTICAL or "border" in kind.channels()

    def heeds(self, kind: Effect) -> bool:
        """Say whether the effect is an encoder offset, or moves the fixture or the held part."""
        return kind.name == READINGS or (kind.family in ("task", "contact") and bool(kind.writes & STANDS))

    def blind(self, world: World, both: Both) -> str:
        """Say why no camera of the fitted recordings sees the cell; empty if one does."""
        scene = scene_of(world, [rec for recordings in both for rec in recordings])
        (fitted_sights, _), unseen = seeing(scene, tuple(sights_of(recordings) for recordings in both), world)
        return "" if fitted_sights else f"no camera sees the cell: {'; '.join(unseen)}"

    def evidence(self, world: World, both: Both, how: How) -> tuple[BorderEvidence, BorderEvidence | None]:
        """Return the borders found in the pictures."""
        return border_evidence_of(world, *both, progress=how.progress)

    def compare(self, world: World, recordings: Sequence[Recording], how: How) -> Comparison:
        """Return the errors of borders, depth and colour, predicted at the measured angles."""
        compared = [frame for rec in recordings for frame in compared_pictures(rec, world, how.reading)]
        rung: Rung = {"model": world.label, "fit_error": None, "heldout_error": border_rms(compared), "unit": "px RMS"}
        note = "neither commands nor torques to compare the joints by: pictures alone are compared"
        if all(map(comparable, recordings)):
            note = "pictures alone are compared; the channel `joints` compares the joints"
        text, drawn = pictures(compared)
        record: ComparisonRecord = {
            "format": "vispeg-compare/1",
            "ladder": [rung],
            "recordings": {"fit": [], "validate": [rec.name for rec in recordings]},
            "notes": [note],
        }
        return Comparison(record, drawn, text)

    def diagnose(self, world: World, both: Both, how: How) -> Diagnosis:
        """Find the effects that pictures show and the model lacks: of cameras, of light, and of the arm's angles."""
        scene = scene_of(world, [rec for recordings in both for rec in recordings])
        return diagnose_pictures(world, scene, *both, seed=how.seed, say=how.say, progress=how.progress)


def seen(world: World, rec: Recording) -> bool:
    """Return whether a model has something beside the arm that could be seen: a cell, or a bench in its own file."""
    return cell_of(world, rec) is not None or shows(bench_of(world))


def border_evidence_of(
    world: World,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    progress: Progress | None = None,
) -> tuple[BorderEvidence, BorderEvidence | None]:
    """Return the borders found in the fitted and in the held-out recordings' pictures; None if none are held out.

    `progress` stores the results of the search for them.

    Raises:
        UserError: recordings of different cells, pictures that cannot be compared, or no camera of the fitted
            recordings that sees the cell.
    """
    scene, kept = scene_of(world, (*fitted, *held_out)), Progress() if progress is None else progress
    (fitted_sights, held_sights), unseen = seeing(scene, (sights_of(fitted), sights_of(held_out)), world)
    if not fitted_sights:
        raise UserError(f"no camera sees the cell: {'; '.join(unseen)}", file=fitted[0].path)
    evidence, judged = border_evidence(scene, fitted_sights, held_sights, world, recall=kept.recall)
    evidence.notes += unseen
    evidence.recordings, judged.recordings = list(fitted), list(held_out)
    return evidence, judged if held_out else None


def scene_of(world: World, recordings: Sequence[Recording]) -> Scene:
    """Return the scene of the model that all recordings are compared with.

    Raises:
        UserError: recordings of different cells, or with different calibrations of one camera.
    """
    cells = [cell_of(world, rec) for rec in recordings]
    for rec, cell in zip(recordings, cells, strict=True):
        if cell != cells[0]:
            raise UserError("is of another cell", file=rec.path / "recording.yaml", key="cell", expected=cells[0])
    known: dict[str, tuple[Camera, str]] = {}
    for rec in recordings:
        if rec.frames is None:
            continue
        for name in rec.frames.names:
            camera = camera_of(rec.frames.cameras[name])
            other, where = known.setdefault(name, (camera, rec.name))
            if camera != other:
                raise UserError(
                    f"camera '{name}' has another calibration than in recording '{where}'",
                    file=rec.path / "frames/cameras.yaml",
                    expected="one calibration for each name of a camera",
                )
    return belief.scene_of(world, recordings[0])


def compared_pictures(rec: Recording, world: World, reading: Reading = silent) -> list[Compared]:
    """Compare each frame of a recording with the model's picture of its cell, or of its robot's own bench.

    Raises:
        UserError: an effect of the model is at a camera that the recording does not have.
    """
    scene = replace(belief.scene_of(world, rec), cameras=tuple(rec.frames.names) if rec.frames is not None else ())
    for placed in world.effects:
        if effect(placed.effect).family == "camera":
            try:
                place(effect(placed.effect), placed.where, scene)
            except UserError as error:
                raise UserError(str(error), file=rec.path / "frames/cameras.yaml") from error
    with reading(rec.path) as progress:
        return compare_frames(rec, scene, World(rec.robot).add(*world.effects), progress=progress)
