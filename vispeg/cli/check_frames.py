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
    """Two tables and sentences for a person; `stated`: whether the recording says what stands in the cell."""
    if not checks:
        return
    from rich.markup import escape

    from vispeg.report.tables import Column, Sheet, terminal
    from vispeg.vision.check import warnings_of

    console = terminal()
    for heads, cells in (
        (["frames", "1/s", "lost", "repeated", "saturated\n%", "black\n%", "soft\npx", "depth\n% read"], _pictures),
        (["depth\nm", "covered\n%", "distance\nm", "tilt\ndeg", "roll\ndeg", "speed\nm/s"], _views),
    ):
        console.print()
        columns = [Column("camera"), *(Column(head, right=True) for head in heads)]
        console.print(Sheet(columns, [[c.camera, *cells(c)] for c in checks]))
    if any(c.told for c in checks):
        console.print()
        columns = [Column("would tell, 1 sigma"), *(Column(c.camera, right=True) for c in checks if c.told)]
        known = [c.told for c in checks if c.told]
        table = [
            [
                f"{row[0].effect}.{row[0].parameter}",
                *(f"{t.sigma:.2g} {t.unit}" + ("" if t.told else " !") for t in row),
            ]
            for row in zip(*known, strict=True)
        ]
        console.print(Sheet(columns, table))
    for line in (line for c in checks for line in warnings_of(c)):
        console.print(f"  [yellow]![/yellow] {escape(line)}", soft_wrap=True)
    if not stated:
        said = "state `cell:` in recording.yaml to know what these frames tell of their cameras (`cell: nominal`)"
        console.print(f"  [yellow]![/yellow] {said}", soft_wrap=True)


def _pictures(c: CameraCheck) -> list[str]:
    lost = [str(c.frames), f"{c.rate_hz:.3g}", str(c.lost), str(c.repeated)]
    light = [None if share is None else 100 * share for share in (c.saturated, c.dark)]
    return [*lost, *(_some(".0f", share) for share in light), _some(".1f", c.softness), _some(".0f", c.fill_rate)]


def _views(c: CameraCheck) -> list[str]:
    covered = None if c.coverage is None else 100 * c.coverage
    near, far = c.distance or (None, None)
    rest = [_some(".0f", c.tilt), _some(".0f", c.roll), _some(".2f", None if c.speed is None else c.speed[0])]
    return [_some(".2f", c.near, c.far), _some(".0f", covered), _some(".2f", near, far), *rest]


def _some(form: str, *values: float | None) -> str:
    return "-" if None in values else "-".join(f"{v:{form}}" for v in values if v is not None)
