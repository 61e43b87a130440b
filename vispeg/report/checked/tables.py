"""The findings of `check` as lines and tables, for terminal, notebook and page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.counts import count
from vispeg.diagnosis.pictures.excited import Excitation
from vispeg.recordings.checks.check import CheckReport
from vispeg.recordings.checks.contact_check import said
from vispeg.report.text.effect_words import unit
from vispeg.report.text.quantities import plain
from vispeg.report.text.summary import Block, Line
from vispeg.report.text.tables import Column, Sheet
from vispeg.vision.check import CameraCheck, warnings_of

NO_CELL = "state `cell:` in recording.yaml (`cell: nominal`), so that these frames can show errors of their cameras"


def clock(report: CheckReport) -> str:
    """Return one line with robot, control mode, length and clock of a recording."""
    timing = report.timing
    jitter = plain(1e3 * timing.jitter if timing.jitter * timing.rate_hz > 1e-6 else 0.0)
    return (
        f"{report.robot.rsplit('/', 1)[-1]}, {report.mode} control, {timing.duration_s:.1f} s "
        f"at {timing.rate_hz:.4g} Hz (jitter {jitter} ms), {count(timing.episodes, 'episode')}, "
        f"{count(len(timing.gaps), 'gap')}"
    )


def motion(report: CheckReport) -> Sheet:
    """Return a table of each joint's range, top speed, reversals and tracking error."""
    heads = ["lowest\nrad", "highest\nrad", "top speed\nrad/s", "reversals\n"]
    tracked = any(joint.tracking_rms is not None for joint in report.joints)
    heads += ["off its command\ndeg RMS", "at most\ndeg"] if tracked else []
    rows = []
    for joint in report.joints:
        moved = joint.excitation
        off = ["-" if x is None else f"{np.degrees(x):.2f}" for x in (joint.tracking_rms, joint.tracking_worst)]
        low, high = (f"{x:+.2f}".replace("-", "−") for x in (joint.low, joint.high))
        rows.append([joint.name, low, high, f"{moved.peak_speed:.2f}", str(moved.reversals), *(off if tracked else ())])
    return _by_joint(heads, rows)


def signals(report: CheckReport) -> Sheet:
    """Return a table of each joint's largest torque, noise, and the resulting precision of dry friction."""
    heads = ["largest torque\nN m", "angle noise\nrad", "torque noise\nN m", "dry friction known to\nN m (1 sigma)"]
    rows = []
    for joint in report.joints:
        friction = (joint.excitation.sigma or {}).get("coulomb")
        values = (joint.peak_torque, joint.noise_q, joint.noise_tau, friction)
        rows.append([joint.name, *("-" if value is None else plain(value, 2) for value in values)])
    return _by_joint(heads, rows)


def cameras(checks: Sequence[CameraCheck], excited: Sequence[Excitation]) -> list[Sheet]:
    """Return tables of the cameras: clock, light and depth; views; precision of camera errors; effects that show."""
    if not checks:
        return []
    made = []
    for heads, cells in (
        (["frames", "1/s", "lost", "repeated", "saturated\n%", "black\n%", "soft\npx", "depth\n% read"], _pictures),
        (["jitter\nms", "depth\nm", "covered\n%", "distance\nm", "tilt\ndeg", "roll\ndeg", "speed\nm/s"], _views),
    ):
        columns = [Column("camera"), *(Column(head, right=True) for head in heads)]
        made.append(Sheet(columns, [[c.camera, *cells(c)] for c in checks]))
    informative = [c for c in checks if c.precision]
    if informative:
        columns = [Column("precision, 1 sigma"), *(Column(c.camera, right=True) for c in informative)]
        rows = [
            [
                f"{row[0].effect}.{row[0].parameter}",
                *(f"{t.sigma:.2g} {unit(t.unit)}".strip() + ("" if t.determined else " !") for t in row),
            ]
            for row in zip(*(c.precision for c in informative), strict=True)
        ]
        made.append(Sheet(columns, rows))
    return [*made, *([_excited(excited)] if excited else ())]


def _excited(rows: Sequence[Excitation]) -> Sheet:
    """Return a table of how much each effect changes the images, and of the motions that effects need that do not show.

    The change is that by a typical size of the effect, beside the smallest change that is detectable.
    """
    heads = Column("changes images by", right=True), Column("detectable from", right=True), Column("not shown: needs")
    return Sheet([Column("effect"), *heads], [_effect(x) for x in rows])


def _effect(x: Excitation) -> list[str]:
    """Return a row; changes are in px for borders, else as multiples of the usual value."""
    mark = " px" if x.channel == "border" else "-fold"
    needs = x.motion.split(":")[0] if x.silent else ""
    silent = f"{', '.join(x.silent)}: " if x.silent and x.excited else ""  # some of its parameters, or all of it
    return [f"{x.effect}({x.where})", f"{x.change:.2f}{mark}", f"{x.needed:.2f}{mark}", silent + needs]


def _by_joint(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Sheet:
    return Sheet([Column("joint\n"), *(Column(head, right=True) for head in heads)], rows)


def _pictures(c: CameraCheck) -> list[str]:
    counts = [str(c.frames), f"{c.rate_hz:.3g}", str(c.lost), str(c.repeated)]
    light = [None if share is None else 100 * share for share in (c.saturated, c.dark)]
    return [*counts, *(_span(".0f", share) for share in light), _span(".1f", c.softness), _span(".0f", c.fill_rate)]


def _views(c: CameraCheck) -> list[str]:
    covered = None if c.coverage is None else 100 * c.coverage
    distance = c.distance or (None, None)  # of borders; `c.near` and `c.far` are of depth readings
    pose = [_span(".0f", c.tilt), _span(".0f", c.roll), _span(".2f", None if c.speed is None else c.speed[0])]
    jitter = f"{1e3 * c.jitter_s:.2g}"
    return [jitter, _span(".2f", c.near, c.far), _span(".0f", covered), _span(".2f", *distance), *pose]


def _span(form: str, *values: float | None) -> str:
    """Return a number, or the ends of a range joined by a dash; `-` if one is unknown."""
    return "-" if None in values else "–".join(f"{v:{form}}" for v in values if v is not None)


def recording_blocks(report: CheckReport) -> list[Block]:
    """Return blocks for a recording: the line of `clock`, two tables of the joints, lines on contact, and warnings."""
    blocks: list[Block] = [Line(clock(report), head=report.recording, path=True)]
    blocks += [motion(report), Line(""), signals(report)]
    contact = [] if report.contact is None else said(report.contact)
    return [*blocks, *(Line(f"  {line}", path=True) for line in contact), *map(_warning, report.warnings)]


def camera_blocks(checks: Sequence[CameraCheck], excited: Sequence[Excitation], stated: bool) -> list[Block]:
    """Return blocks for the cameras: tables and warnings.

    Args:
        checks: findings on each camera.
        excited: how much effects would change the images.
        stated: whether the recording describes the objects in the cell.
    """
    blocks = [block for sheet in cameras(checks, excited) for block in (Line(""), sheet)]
    blocks += [_warning(line) for c in checks for line in warnings_of(c)]
    return [*blocks, *([_warning(NO_CELL)] if checks and not stated else [])]


def _warning(text: str) -> Block:
    return Line(text, warning=True)
