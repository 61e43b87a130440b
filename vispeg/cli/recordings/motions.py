"""Lists the motions of `vispeg record`, or writes one as a CSV.

A robot can replay the CSV: `time`, and `q_cmd.*`, `dq_cmd.*` of the joints or, in contact, `ee_cmd.*` of the flange
with the gains (`kp.*`, 1/s^2) and the force limit (N) of the controller that it is made for.

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
    """The motion to write; default: list all."""
    model: str | None = None
    """The robot; default: the default cell for motions in contact and looks, else iiwa14."""
    out: Path | None = None
    """The CSV to write."""
    duration: float | None = None
    """Length, s; default: 5 for a joint motion, 16 for a look. Motions in contact have a fixed length."""
    rate: float = 500.0
    """Rate of commands, Hz."""
    seed: int = 0
    """Seed of the motion."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    family: str | None = None
    """Only motions in this space: joint, cartesian, contact or cell."""
    search: str | None = None
    """Only motions with this text in name or description."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print the list, or write one."""
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
