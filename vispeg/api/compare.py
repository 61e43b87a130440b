"""`vispeg.compare`: a model against recordings, nothing fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.api.inputs import Model, Reading, Source, read_inputs, silent
from vispeg.api.result import Result
from vispeg.diagnosis import compare as rooms
from vispeg.recordings.windows import SECONDS
from vispeg.report.summary import Block
from vispeg.report.terminal import comparison_summary
from vispeg.report.write import finite, write_comparison


@dataclass(frozen=True)
class ComparisonResult(Result):
    """How far a model is off.

    Attributes:
        record: what compare.json holds, see docs/formats.md.
        arrays: measured and predicted values behind the pictures, as in evidence.npz.
        sources: what was read.
    """

    record: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray] = field(repr=False)
    sources: tuple[str | Path, ...] = ()
    holds = "comparison"

    @property
    def error(self) -> float:
        """RMS error over all joints, rad; N m where the recordings are compared by torque; NaN where all diverged."""
        error = self.record["ladder"][-1]["heldout_error"]
        return float("nan") if error is None else error

    @property
    def noise_floor(self) -> float:
        """RMS of the sensor noise, in the unit of `error`."""
        return self.record["noise_floor"]["value"]

    @property
    def summary(self) -> list[Block]:
        """The error in words and joint by joint."""
        return comparison_summary(self.record)

    def _write(self, folder: Path) -> None:
        write_comparison(folder, dict(self.record), dict(self.arrays))


def compare(
    model: Model,
    recordings: Source | Sequence[Source],
    *,
    seconds: float = SECONDS,
    threads: int = 2,
    reading: Reading = silent,
) -> ComparisonResult:
    """Drives the model as the robot was driven and says how far it is off, at which joint, and when.

    Args:
        model: a world, a model file, a robot's name, or a path to an MJCF or URDF.
        recordings: folders, or recordings in memory, of one robot.
        seconds: of a longer recording, the windows that show the most, this long in all; 0 uses all of it.
        threads: of the simulation.
        reading: shows how far a recording is read.

    Raises:
        UserError: a model or a recording that cannot be read, or that cannot be compared with each other.
    """
    given = read_inputs(model, recordings, (), need_validate=False, seconds=seconds, reading=reading)
    result = rooms.compare(given.world, given.fitted, nthread=threads)
    record = finite({**result.record, "provenance": given.provenance(None)})
    return ComparisonResult(record, result.arrays, given.files)
