"""Checks recordings before anybody fits to them: clock, gaps, limits, saturation, noise, excitation.

Exits 0 when the recordings can be used, whatever it warns about; 2 with one line when one cannot.

Example:
    vispeg check rig-a rig-b
    vispeg check rig-a --out checked
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.recordings.check import CheckReport, check
from vispeg.recordings.load import load
from vispeg.recordings.noise import noise_from_repeats, same_motion
from vispeg.recordings.quality import Limits
from vispeg.recordings.recording import Recording


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg check`."""

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recording folders."""
    out: Path | None = None
    """Folder for check.json and a picture of each recording."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    json: bool = False
    """Print JSON instead of tables."""

    def run(self) -> int:
        """Prints what was found, and writes it if asked."""
        if not self.recordings:
            raise UserError("no recording given", expected="vispeg check FOLDER [FOLDER ...]")
        recs = [load(path) for path in self.recordings]
        limits = [limits_of(rec) for rec in recs]
        reports = [check(rec, limit) for rec, limit in zip(recs, limits, strict=True)]
        record = {
            "format": "vispeg-check/1",
            "recordings": [report.to_json() for report in reports],
            "repeats": repeats(recs),
        }
        if self.json:
            print(json.dumps(record, indent=2, allow_nan=False))
        else:
            for report in reports:
                show(report)
            for found in record["repeats"]:
                print(f"repeats of one motion: {', '.join(found['recordings'])}; noise of q", *_short(found["noise_q"]))
        if self.out is not None:
            self._write(self.out, recs, limits, reports, record)
        return 0

    def _write(
        self, out: Path, recs: list[Recording], limits: list[Limits], reports: list[CheckReport], record: Any
    ) -> None:
        from vispeg.recordings.plot import plot

        with new_folder(out, self.overwrite, holds="check", inputs=self.recordings) as folder:
            (folder / "check.json").write_text(json.dumps(record, indent=2, allow_nan=False) + "\n", encoding="utf-8")
            for number, (rec, limit, report) in enumerate(zip(recs, limits, reports, strict=True), start=1):
                name = "check.png" if len(recs) == 1 else f"check-{number}-{rec.name}.png"
                (folder / name).write_bytes(plot(rec, report, limit))


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


def repeats(recs: list[Recording]) -> list[dict[str, Any]]:
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
    """A table for a person."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    clock = report.timing
    console = Console(soft_wrap=True, highlight=False)
    console.print(
        f"[bold]{escape(report.recording)}[/bold]  {escape(report.robot)}, {report.mode} control, "
        f"{clock.duration_s:.1f} s at {clock.rate_hz:.1f} Hz (jitter {1e3 * clock.jitter:.3g} ms), "
        f"{clock.episodes} episode{'s' * (clock.episodes != 1)}, {len(clock.gaps)} gaps"
    )
    named = ("joint", "from", "to", "speed", "turns", "torque", "noise q", "noise tau", "friction to")
    units = ("", "rad", "rad", "rad/s", "", "N m", "rad", "N m", "N m")
    heads = (f"{name}\n{unit}" for name, unit in zip(named, units, strict=True))
    table = Table(*heads, box=None, padding=(0, 1), header_style="dim")
    for joint in report.joints:
        motion = joint.excitation
        table.add_row(
            escape(joint.name),
            f"{joint.low:+.2f}",
            f"{joint.high:+.2f}",
            f"{motion.peak_speed:.2f}",
            str(motion.reversals),
            *_cells(joint.peak_torque, joint.noise_q, joint.noise_tau, (motion.sigma or {}).get("coulomb")),
        )
    console.print(table)
    for line in report.warnings:
        console.print(f"  [yellow]![/yellow] {escape(line)}")


def _cells(*values: float | None) -> list[str]:
    return ["-" if value is None else f"{value:.2g}" for value in values]


def _short(values: list[float]) -> list[str]:
    return [f"{value:.2g}" for value in values]
