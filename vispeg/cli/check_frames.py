"""The part of `vispeg check` that looks at pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vispeg.recordings.recording import Recording

if TYPE_CHECKING:
    from vispeg.vision.check import CameraCheck


def examine(rec: Recording, quiet: bool) -> list[CameraCheck]:
    """Checks the frames of a recording, against the cell that it states; none where it has no frames."""
    if rec.frames is None:
        return []
    from dataclasses import replace

    from vispeg.cli.reading import told
    from vispeg.task.belief import believed
    from vispeg.vision.check import check_frames

    scene = None
    if rec.cell is not None:
        found = believed(rec.cell, rec.path / "recording.yaml").scene
        scene = replace(found, cameras=tuple(rec.frames.names)) if found.joints == tuple(rec.joints) else None
    with told(f"looking at the frames of {rec.path}", quiet=quiet) as share:
        return check_frames(rec, scene, share)


def show(checks: Sequence[CameraCheck], stated: bool) -> None:
    """Tables and sentences for a person; `stated`: whether the recording says what stands in the cell."""
    if not checks:
        return
    from rich.markup import escape

    from vispeg.report.checked import tables
    from vispeg.report.tables import terminal
    from vispeg.vision.check import warnings_of

    console = terminal()
    for sheet in tables.cameras(checks):
        console.print()
        console.print(sheet)
    for line in (line for c in checks for line in warnings_of(c)):
        console.print(f"  [yellow]![/yellow] {escape(line)}", soft_wrap=True)
    if not stated:
        said = "state `cell:` in recording.yaml to know what these frames tell of their cameras (`cell: nominal`)"
        console.print(f"  [yellow]![/yellow] {said}", soft_wrap=True)
