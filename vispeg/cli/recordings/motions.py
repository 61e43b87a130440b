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
        from vispeg.api.catalogue import motions
        from vispeg.cli.listing import show
        from vispeg.core.errors import UserError

        if self.name is None:
            if self.out is not None:
                raise UserError("which motion?", key="--out", expected="vispeg motions NAME --out FILE.csv")
            return show("motions", motions(), "space", self.family, self.search, self.output)
        return self._write(self.name)

    def _write(self, name: str) -> int:
        from vispeg.api.recording.cell import commands, names
        from vispeg.core.errors import UserError
        from vispeg.core.files import write_text_atomic
        from vispeg.recordings.cell import OPEN_CELL

        choices = names(model=self.model)
        if name not in choices:
            raise UserError("unknown motion", key="name", got=name, choices=choices)
        if self.out is None or self.out.suffix != ".csv":
            raise UserError("where to?", key="--out", expected="a .csv file", got=self.out)
        if self.overwrite and self.out.exists():
            _refuse_other(self.out)
        model = self.model or (OPEN_CELL if name in (*names("contact"), *names("cell")) else "iiwa14")
        text, seconds = commands(model, name, rate_hz=self.rate, seed=self.seed, duration=self.duration)
        write_text_atomic(self.out, text, overwrite=self.overwrite)
        values = {"motion": name, "model": model, "seconds": seconds, "rate_hz": self.rate, "out": str(self.out)}
        self.output.give(values, [f"{self.out}: {name}, {seconds:.3g} s at {self.rate:g} Hz"])
        return 0


def _refuse_other(path: Path) -> None:
    """Only a file of commands is replaced, no log.

    Raises:
        UserError: the first line has other columns than a motion's.
    """
    from vispeg.core.errors import UserError

    if not path.is_file():
        raise UserError("not a file", file=path)
    with path.open("rb") as file:
        names = file.readline(100_000).decode("utf-8", "replace").strip().split(",")
    if names[0] != "time" or not all(n.partition(".")[0] in ("q_cmd", "dq_cmd", "ee_cmd", "q_null") for n in names[1:]):
        raise UserError("not a motion; it is not replaced", file=path, expected="time, q_cmd.*, dq_cmd.*, ee_cmd.*")
