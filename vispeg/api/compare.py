"""`vispeg.compare`: compare a model with recordings, without fitting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.api.inputs import Inputs, Model, Source, read_inputs, windows
from vispeg.api.result import Result, Traced
from vispeg.channels.channel import CHANNELS, How
from vispeg.channels.pictures import seen
from vispeg.channels.resolve import resolve
from vispeg.core.errors import UserError
from vispeg.diagnosis.schema import ComparisonRecord
from vispeg.kernels.threads import one_blas_thread
from vispeg.recordings.cell import OPEN_CELL
from vispeg.recordings.progress import Reading, silent
from vispeg.recordings.windows import SECONDS
from vispeg.report.live.arm import with_arms
from vispeg.report.text.summary import Block
from vispeg.report.text.terminal import comparison_summary
from vispeg.report.write import finite, write_comparison

UNSEEN = f"frames need the model of a cell, such as {OPEN_CELL}, or a robot's file that shows more than its arm"

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class ComparisonResult(Result, Traced):
    """The error of a model on recordings.

    Attributes:
        record: content of compare.json, see docs/reference/keys.md.
        arrays: measured and predicted values, as in evidence.npz.
        sources: files and folders that were read.
    """

    record: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray] = field(repr=False)
    sources: tuple[str | Path, ...] = ()
    holds = "comparison"  # class attributes, see `Result`
    tables = ("joints", "channels", "ladder")

    @property
    def error(self) -> float:
        """RMS error over all joints, rad; N m if torques are compared, px of borders for pictures only.

        NaN if the model diverged in all recordings.
        """
        # the ladder has one error per model, here of one model; nothing is fitted, so all recordings are held out
        error = self.record["ladder"][-1]["heldout_error"]
        return float("nan") if error is None else error

    @property
    def noise_floor(self) -> float:
        """RMS of the sensor noise, in the unit of `error`; NaN if only pictures are compared, as theirs is unknown."""
        return self.record["noise_floor"]["value"] if "noise_floor" in self.record else float("nan")

    @property
    def summary(self) -> list[Block]:
        """The error in words and for each joint."""
        return comparison_summary(self.record)

    def plot(self, recording: int = 0) -> Figure:
        """Draw measured and predicted values of a recording and their difference, one row per joint; see `Result.plot`.

        Args:
            recording: number of the recording, from 0.

        Raises:
            UserError: no such recording, or only pictures were compared.
        """
        from vispeg.report.drawings.figures import WIDE, styled
        from vispeg.report.evidence import evidence_of
        from vispeg.report.sections.measured_vs_model import trace_figure

        evidence = evidence_of(self.arrays)
        if not evidence.traces:
            return super().plot()
        if not 0 <= recording < len(evidence.traces):
            expected = f"a number from 0 to {len(evidence.traces) - 1}"
            raise UserError("no such recording", expected=expected, got=recording)
        with styled(WIDE):
            return trace_figure(evidence.traces[recording], evidence.joints, points=1500, shape=WIDE)

    def _write(self, folder: Path) -> None:
        write_comparison(folder, dict(self.record), dict(self.arrays))


@one_blas_thread()
def compare(
    model: Model,
    recordings: Source | Sequence[Source],
    *,
    channels: str | Sequence[str] = (),
    seconds: float = SECONDS,
    threads: int = 2,
    reading: Reading = silent,
) -> ComparisonResult:
    """Compare a model, driven by the recorded commands, with recordings: size, joint and time of the error.

    With the model of a cell, the wrench at the wrist is also compared, by axis and phase of contact. Pictures are
    compared with the model of a cell, or of a robot whose file shows more than the arm; they are rendered at the
    measured angles, and `record["pictures"]` holds the errors of borders, depth and colour. Recordings are folders, or
    objects in memory.

    Args:
        model: a world, a model file, a robot's name, or a path to an MJCF or URDF.
        recordings: recordings of one robot to compare with.
        channels: channels to compare; an unknown name lists all; default: the channels that `vispeg diagnose` uses.
        seconds: of longer recordings, use only the most informative windows, this many seconds in total; 0 uses
            everything.
        threads: number of threads for the simulation.
        reading: shows progress while a recording is read.

    Raises:
        UserError: the model or a recording cannot be read, or they cannot be compared.
    """
    options = windows(model, seconds, recordings)
    inputs = read_inputs(model, recordings, (), need_validate=False, **options, reading=reading)
    used = resolve(inputs.world, inputs.fitted, asked=channels)
    how = How(seconds, threads=threads, reading=reading)
    compared = {name: CHANNELS[name].compare(inputs.world, inputs.fitted, how) for name in used}
    lead = compared.pop(min(compared, key=lambda name: CHANNELS[name].lead))  # heads the record
    record: ComparisonRecord = {**lead.record, "provenance": inputs.provenance(None)}
    arrays = dict(lead.arrays)
    for comparison in (lead, *compared.values()):
        if comparison.pictures:  # they have a key of their own, beside `by_channel`
            record["pictures"] = comparison.pictures
            arrays |= comparison.arrays
    others = {name: comparison for name, comparison in compared.items() if not comparison.pictures}
    if others:
        record["by_channel"] = [  # `given`: effects found in other channels, of which a comparison has none
            {"channel": name, "given": [], "record": other.record} for name, other in others.items()
        ]
    for name, other in others.items():
        arrays |= {f"channel/{name}/{key}": value for key, value in other.arrays.items()}
    # adds the shapes of the arm, which the page draws
    with_arms(CHANNELS["joints"].part(inputs.world), arrays)
    if "pictures" not in used and not channels and (text := _unseen(inputs)):
        record["notes"] = [*record.get("notes", ()), text]
    return ComparisonResult(finite(record), arrays, inputs.files)


def _unseen(inputs: Inputs) -> str:
    """Return a note on pictures that were not compared, or on recordings without pictures; empty if neither applies."""
    looked = [rec for rec in inputs.fitted if rec.frames is not None]
    unseen = [rec.name for rec in looked if not seen(inputs.world, rec)]
    if unseen:
        return f"{', '.join(unseen)}: {UNSEEN}"
    blind = [rec.name for rec in inputs.fitted if rec.frames is None]
    return f"{', '.join(blind)}: no frames, so pictures are not compared" if looked and blind else ""
