"""Recordings with frames: their diagnosis in the cell that they state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vispeg.core.errors import UserError
from vispeg.diagnosis.pictures.run import diagnose_pictures
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import Diagnosis
from vispeg.identify.pictures.build import border_evidence, seeing
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.read import sights_of
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.task import belief
from vispeg.task.belief import cell_of
from vispeg.worlds.world import World


def diagnose(
    world: World,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Names what the cameras, or the arm that carries them, do to the pictures.

    Raises:
        UserError: recordings of different cells, or of which one's pictures cannot be compared.
    """
    return diagnose_pictures(
        world, scene_of(world, (*fitted, *held_out)), fitted, held_out, seed=seed, say=say, progress=progress
    )


def unseen(world: World, fitted: Sequence[Recording], held_out: Sequence[Recording]) -> str:
    """Say why no camera of the recordings sees anything of what the model shows; empty where one does."""
    scene = scene_of(world, (*fitted, *held_out))
    (mine, _), blind = seeing(scene, (sights_of(fitted), sights_of(held_out)), world)
    return "" if mine else f"no camera sees the cell: {'; '.join(blind)}"


def border_evidence_of(
    world: World,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    progress: Progress | None = None,
) -> tuple[BorderEvidence, BorderEvidence | None]:
    """Give the edges in the pictures of recordings to fit, and of those to judge on if there are any.

    `progress` keeps where they were found.

    Raises:
        UserError: as `diagnose`.
    """
    scene, kept = scene_of(world, (*fitted, *held_out)), Progress() if progress is None else progress
    (mine, theirs), blind = seeing(scene, (sights_of(fitted), sights_of(held_out)), world)
    if not mine:
        raise UserError(f"no camera sees the cell: {'; '.join(blind)}", file=fitted[0].path)
    evidence, judged = border_evidence(scene, mine, theirs, world, recall=kept.recall)
    evidence.notes += blind
    evidence.recordings, judged.recordings = list(fitted), list(held_out)
    return evidence, judged if held_out else None


def scene_of(world: World, recordings: Sequence[Recording]) -> Scene:
    """Give the one scene that the recordings show under a model."""
    cells = [cell_of(world, rec) for rec in recordings]
    for rec, cell in zip(recordings, cells, strict=True):
        if cell != cells[0]:
            raise UserError("is of another cell", file=rec.path / "recording.yaml", key="cell", expected=cells[0])
    return belief.scene_of(world, recordings[0])
