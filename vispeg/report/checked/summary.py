"""What `check` has to say of a recording, as lines and tables for a terminal and a notebook."""

from __future__ import annotations

from collections.abc import Sequence

from vispeg.diagnosis.pictures.excited import Excitation
from vispeg.recordings.checks.check import CheckReport
from vispeg.recordings.checks.contact_check import said
from vispeg.report.checked import tables
from vispeg.report.text.summary import Block, Line
from vispeg.vision.check import CameraCheck, warnings_of

NO_CELL = "state `cell:` in recording.yaml to know what these frames tell of their cameras (`cell: nominal`)"


def recording_blocks(report: CheckReport) -> list[Block]:
    """Clock and gaps, two tables of the joints, what contact tells, and the warnings."""
    blocks: list[Block] = [Line(tables.clock(report), head=report.recording, path=True)]
    blocks += [tables.motion(report), Line(""), tables.signals(report)]
    contact = [] if report.contact is None else said(report.contact)
    return [*blocks, *(Line(f"  {line}", path=True) for line in contact), *map(_warning, report.warnings)]


def camera_blocks(checks: Sequence[CameraCheck], excited: Sequence[Excitation], stated: bool) -> list[Block]:
    """Tables of the cameras and their warnings.

    Args:
        checks: of the cameras.
        excited: what effects would do to the pictures.
        stated: whether the recording says what stands in the cell.
    """
    blocks = [block for sheet in tables.cameras(checks, excited) for block in (Line(""), sheet)]
    blocks += [_warning(line) for c in checks for line in warnings_of(c)]
    return [*blocks, *([_warning(NO_CELL)] if checks and not stated else [])]


def _warning(text: str) -> Block:
    return Line(text, warning=True)
