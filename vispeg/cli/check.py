"""Checks recordings before anybody fits to them: clock, bad readings, limits, tracking, noise, excitation.

Of frames it says what clock, light, depth and views are like, and which errors of a camera they would tell.

Where a wrench was recorded and the recording says how it is to be read, also what the tool touched, how hard and how
fast, and which effects of contact that can tell.

Exits 0 when the recordings can be used, whatever it warns about; 2 with one line when one cannot.

Example:
    vispeg check rig-a rig-b
    vispeg check rig-a slide-a --out checked
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from vispeg.api.check_contact import check_contact
from vispeg.cli import check_frames
from vispeg.cli.output import Output, Told
from vispeg.cli.reading import size_of, told
from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.provenance import here
from vispeg.recordings.check import SIGNALS, CheckReport, check
from vispeg.recordings.contact_check import said, together
from vispeg.recordings.load import load
from vispeg.recordings.noise import noise_from_repeats, same_motion
from vispeg.recordings.plot import plot
from vispeg.recordings.quality import Limits
from vispeg.recordings.recording import Recording
from vispeg.recordings.schema import Header

if TYPE_CHECKING:
    from vispeg.report.checked.examined import Examined

HEAD = 20_000  # rows of each recording that are held against the others'


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg check`."""

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recording folders."""
    out: Path | None = None
    """Folder for report.html, check.json and a picture of each recording."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: Told = Output()

    def run(self) -> int:
        """Prints what was found, and writes it if asked."""
        if not self.recordings:
            raise UserError("no recording given", expected="vispeg check FOLDER [FOLDER ...]")
        if self.out is None:
            self._examine(None)
        else:
            from vispeg.report.checked.page import render

            with new_folder(self.out, self.overwrite, holds="check", inputs=self.recordings) as folder:
                record, examined = self._examine(folder)
                text = json.dumps(record, indent=2, allow_nan=False) + "\n"
                (folder / "check.json").write_text(text, encoding="utf-8")
                page = render(examined, record["repeats"], here(None, {})["command"])
                (folder / "report.html").write_text(page, encoding="utf-8")
            self.output.line(f"report: {self.out / 'report.html'}")
        return 0

    def _examine(self, folder: Path | None) -> tuple[Mapping[str, Any], list[Examined]]:
        """Checks, shows and draws one recording after the other, so that only one is in memory."""
        if folder is not None:
            from vispeg.report.checked.examined import examined
        reports, heads, looked, pages = [], [], [], []
        for number, path in enumerate(self.recordings, start=1):
            with told(f"reading {path}", size_of(path), self.output.quiet) as share:
                rec = load(path, _signals, share)
            limits = limits_of(rec)
            with told(f"examining {path}", quiet=self.output.quiet) as share:
                contact, touched = check_contact(rec) or (None, None)
                reports.append(replace(check(rec, limits, share), contact=contact))
            heads.append(head_of(rec))
            looked.append((check_frames.examine(rec, self.output.quiet), rec.cell is not None))
            if folder is not None:
                name = "check.png" if len(self.recordings) == 1 else f"check-{number}-{rec.name}.png"
                drawing = plot(rec, reports[-1], limits)
                (folder / name).write_bytes(drawing)
                pages.append(examined(rec, reports[-1], limits, looked[-1][0], touched, drawing))
            del rec
        record = {
            "format": "vispeg-check/1",
            "recordings": [
                {**report.to_json(), **({"cameras": [c.to_json() for c in seen]} if seen else {})}
                for report, (seen, _) in zip(reports, looked, strict=True)
            ],
            "repeats": repeats(heads),
        }
        if self.output.json:
            self.output.give(record, [])
            return record, pages
        for report, (seen, stated) in zip(reports, looked, strict=True):
            show(report)
            check_frames.show(seen, stated)
        touched = [report.contact for report in reports if report.contact is not None]
        if len(touched) > 1:
            print("together:", *said(touched[0], together(touched)), sep="\n  ")
        for found in record["repeats"]:
            print(f"repeats of one motion: {', '.join(found['recordings'])}; noise of q", *_short(found["noise_q"]))
        return record, pages


def _signals(header: Header) -> tuple[str, ...]:
    """What is looked at: the wrench only where it is said how to read it."""
    return (*SIGNALS, "ft") if header.wrench is not None or header.cell is not None else SIGNALS


def limits_of(rec: Recording) -> Limits:
    """The robot's limits in the recording's joint order. Raises UserError for a joint that the robot does not have."""
    from vispeg.robots.model import load as load_robot

    try:
        robot = load_robot(rec.robot)
    except UserError as error:  # a name or a file that a line of this recording gave
        raise UserError(str(error), file=rec.path / "recording.yaml", key="robot") from error
    for joint in rec.joints:
        if joint not in robot.joints:
            file = rec.path / "recording.yaml"
            raise UserError("the robot has no such joint", file=file, key="joints", got=joint, choices=robot.joints)
    order = [robot.joints.index(joint) for joint in rec.joints]
    return Limits(robot.range[order], robot.velocity_limit[order], robot.torque_limit[order])


def head_of(rec: Recording) -> Recording:
    """The first rows of a recording, copied, so that the rest can go: as many as repeats need to show their noise."""
    arrays = ("time", "q", "q_cmd", "tau_cmd", "episode")
    cut = {name: value[:HEAD].copy() for name in arrays if (value := getattr(rec, name)) is not None}
    return replace(rec, tau=None, ft=None, frames=None, **cut)


def repeats(recs: list[Recording]) -> list[Mapping[str, object]]:
    """Groups of recordings that repeat one commanded motion, with the noise that they show (rad, one a joint)."""
    left, out = list(recs), []
    while left:
        group = [left[0], *(rec for rec in left[1:] if same_motion(left[0], rec))]
        left = [rec for rec in left if not any(rec is other for other in group)]
        if len(group) > 1:
            noise = noise_from_repeats(group, "q").tolist()
            out.append({"recordings": [str(rec.path) for rec in group], "noise_q": noise})
    return out


def show(report: CheckReport) -> None:
    """Two tables for a person, and what is to be said."""
    from rich.markup import escape

    from vispeg.report.checked import tables
    from vispeg.report.tables import terminal

    clock = report.timing
    console = terminal()
    gaps = f"{len(clock.gaps)} gap{'s' * (len(clock.gaps) != 1)}"
    console.print(
        f"[bold]{escape(report.recording)}[/bold]  {escape(report.robot)}, {report.mode} control, "
        f"{clock.duration_s:.1f} s at {clock.rate_hz:.1f} Hz (jitter {1e3 * clock.jitter:.3g} ms), "
        f"{clock.episodes} episode{'s' * (clock.episodes != 1)}, {gaps}",
        soft_wrap=True,
    )
    console.print(tables.motion(report))
    console.print()
    console.print(tables.signals(report))
    for line in said(report.contact) if report.contact is not None else ():
        console.print(f"  {escape(line)}", soft_wrap=True)
    for line in report.warnings:
        console.print(f"  [yellow]![/yellow] {escape(line)}", soft_wrap=True)


def _short(values: list[float]) -> list[str]:
    return [f"{value:.2g}" for value in values]
