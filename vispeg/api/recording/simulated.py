"""The result of `record`: a recording of a simulated robot, before it is saved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from vispeg.api.result import Result
from vispeg.recordings.recording import Recording
from vispeg.recordings.write import write
from vispeg.report.text.summary import Block, Line


@dataclass(frozen=True, repr=False)
class SimulatedRecording(Result):
    """A recording of a simulated robot.

    Attributes:
        recording: the recording, as `load_recording` reads it from the folder that `save` writes.
        robot: label of the robot with its hidden effects.
        repeat: number of runs of the motion.
        look: appearance of its pictures, WORLD/SEED; None for the plain cell.
        scaled: joint -> factor by which its motion was scaled down, so as not to exceed its speed limit.
        table: format of the samples that `save` writes.
        sources: files from which the recording was made.
    """

    recording: Recording
    robot: str
    repeat: int = 1
    look: str | None = None
    scaled: Mapping[str, float] = field(default_factory=dict)
    table: Literal["csv", "parquet"] = "csv"
    sources: tuple[str | Path, ...] = ()
    holds = "recording"  # class attribute, see `Result`

    @property
    def record(self) -> Mapping[str, object]:
        """The output of `vispeg record --json`, without the folder's name."""
        rec = self.recording
        values: dict[str, object] = {"samples": len(rec.time), "rate_hz": rec.rate_hz, "control": rec.control.mode}
        values |= {"motion": rec.motion, "robot": self.robot, "repeat": self.repeat}
        if rec.frames is not None:
            values |= {"frames": len(rec.frames), "cameras": [*rec.frames.cameras], "look": self.look}
        if self.scaled:
            values["scaled"] = dict(self.scaled)
        if rec.outcomes:
            values["outcomes"] = [o.category or ("success" if o.success else "failure") for o in rec.outcomes]
        return values

    @property
    def summary(self) -> list[Block]:
        """Motion, rate, controller and robot, and how its episodes ended."""
        return [Line(text, path=True) for text in self._lines()]

    def _lines(self) -> Iterator[str]:
        rec = self.recording
        runs = f"{self.repeat} runs of " if self.repeat > 1 else ""
        text = f"{runs}{rec.motion}, {rec.time[-1]:.3g} s at {rec.rate_hz:g} Hz, {rec.control.mode} control"
        if rec.frames is not None:
            text += f", {len(rec.frames)} pictures of {', '.join(rec.frames.cameras)}"
        yield f"{text}, {self.robot}" + (f", looking as {self.look}" if self.look is not None else "")
        if self.scaled:
            shares = ", ".join(f"{joint} {100 * share:.0f} %" for joint, share in self.scaled.items())
            yield f"made smaller, so that no joint passes its speed limit: {shares} of the motion"
        for o in rec.outcomes:
            end = o.category or ("success" if o.success else "failure")
            force = "" if o.peak_force is None else f", peak force {o.peak_force:.0f} N"
            depth = "" if o.depth is None else f", depth {1e3 * o.depth:.1f} mm"
            yield f"episode {o.episode}: {end}{force}{depth}"

    def save(self, out: str | Path, *, overwrite: bool = False) -> Path:
        """Write recording.yaml, the samples and the pictures; see `Result.save`."""
        return write(self.recording, out, overwrite=overwrite, table=self.table, inputs=self.sources)

    def _write(self, folder: Path) -> None:
        write(self.recording, folder, table=self.table)
