"""Recordings with frames: their diagnosis in the cell that they state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vispeg.core.errors import UserError
from vispeg.diagnosis.pictures.run import diagnose_pictures
from vispeg.diagnosis.run import Diagnosis
from vispeg.recordings.recording import Recording
from vispeg.task.belief import believed, cell_of
from vispeg.worlds.world import World


def photographed(*groups: Sequence[Recording]) -> bool:
    """Whether all recordings hold pictures."""
    return all(rec.frames is not None and len(rec.frames) > 0 for group in groups for rec in group)


def diagnose(
    world: World,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Names what the cameras, or the arm that carries them, do to the pictures.

    Raises:
        UserError: recordings of different cells, or of which one's pictures cannot be compared.
    """
    beliefs = [cell_of(world, rec) or rec.cell for rec in (*fitted, *held_out)]
    for rec, belief in zip((*fitted, *held_out), beliefs, strict=True):
        if belief != beliefs[0]:
            raise UserError("is of another cell", file=rec.path / "recording.yaml", key="cell", expected=beliefs[0])
    scene = believed(beliefs[0], fitted[0].path / "recording.yaml").scene
    return diagnose_pictures(world, scene, fitted, held_out, seed=seed, say=say)
