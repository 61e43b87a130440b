"""Lists the motions that `vispeg record --motion` takes by name; with a name, writes that one as a CSV.

A robot can replay it: `time`, and `q_cmd.*`, `dq_cmd.*` of the joints or, where it touches, `ee_cmd.*` of the flange.

Example:
    vispeg motions
    vispeg motions --family joint
    vispeg motions press --model {cell} --out press.csv
    vispeg motions look --out look.csv
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg motions`."""

    name: tyro.conf.Positional[str | None] = None
    """The motion to write; all are listed where not given."""
    model: str | None = None
    """The robot that moves. Not given, the default cell for motions in contact and of looking, else iiwa14."""
    out: Path | None = None
    """The CSV to write."""
    duration: float | None = None
    """Length of a joint motion (5 s, if not given) or of one that looks at a cell (16 s). Motions in contact have a
    length of their own."""
    rate: float = 500.0
    """Commands a second."""
    seed: int = 0
    """Of the motion."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    family: str | None = None
    """Only those in `joint`, `cartesian`, `contact` or `cell` space."""
    search: str | None = None
    """Only those with this text in their name or description."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Prints the list, or writes one."""
        from vispeg.api.library.catalogue import motions
        from vispeg.cli.listing import show
        from vispeg.core.errors import UserError

        if self.name is None:
            if self.out is not None:
                raise UserError("which motion?", key="--out", expected="vispeg motions NAME --out FILE.csv")
            return show("motions", motions(), "space", self.family, self.search, self.output)
        return self._write(self.name)

    def _write(self, name: str) -> int:
        from vispeg.api.recording.commands import write_motion

        options = {"model": self.model, "duration": self.duration, "overwrite": self.overwrite}
        made = write_motion(name, self.out, rate_hz=self.rate, seed=self.seed, **options)
        self.output.give(made.record, [str(made)])
        return 0
