"""`vispeg.compare`: a model against recordings, nothing fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.api.channels import arm_of, carrying
from vispeg.api.inputs import Inputs, Model, Reading, Source, read_inputs, silent, windows
from vispeg.api.result import Result
from vispeg.contact.picture import worst_moment
from vispeg.contact.run import compare_contact
from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.diagnosis import compare as joints
from vispeg.diagnosis.compare import Comparison
from vispeg.diagnosis.drift import drifts
from vispeg.diagnosis.resolve import ChannelName, available, resolve, seen
from vispeg.diagnosis.schema import ComparisonRecord, Rung
from vispeg.kernels.threads import one_blas_thread
from vispeg.recordings.cell import OPEN_CELL
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import SECONDS, choose
from vispeg.report.live.arm import arm_arrays
from vispeg.report.text.summary import Block
from vispeg.report.text.terminal import comparison_summary
from vispeg.report.write import finite, write_comparison
from vispeg.task.belief import cell_of, recorded_cell, scene_of
from vispeg.vision.compare import Compared, border_rms, compare_frames
from vispeg.vision.show import pictures
from vispeg.worlds.words import place
from vispeg.worlds.world import World

UNSEEN = f"frames are compared with a cell, as {OPEN_CELL} is, or with a robot's file that shows more than its arm"

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
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
    tables = ("joints", "channels", "ladder")

    @property
    def error(self) -> float:
        """RMS error over all joints, rad; N m where compared by torque, px of borders where by pictures
        alone; NaN where all diverged.
        """
        error = self.record["ladder"][-1]["heldout_error"]
        return float("nan") if error is None else error

    @property
    def noise_floor(self) -> float:
        """RMS of the sensor noise, in the unit of `error`; NaN where only pictures are compared, whose is not known."""
        return self.record["noise_floor"]["value"] if "noise_floor" in self.record else float("nan")

    @property
    def summary(self) -> list[Block]:
        """The error in words and joint by joint."""
        return comparison_summary(self.record)

    def plot(self, recording: int = 0) -> Figure:
        """Draw measured values, the model's, and their difference of one recording, a row a joint; see `Result.plot`.

        Args:
            recording: its number.
        """
        from vispeg.report.drawings.figures import WIDE, styled
        from vispeg.report.evidence import evidence_of
        from vispeg.report.sections.measured_vs_model import trace_figure

        evidence = evidence_of(self.arrays)
        if recording >= len(evidence.traces):
            return super().plot()
        with styled(WIDE):
            return trace_figure(evidence.traces[recording], evidence.joints, 1500, WIDE)

    def _write(self, folder: Path) -> None:
        write_comparison(folder, dict(self.record), dict(self.arrays))


@one_blas_thread()
def compare(
    model: Model,
    recordings: Source | Sequence[Source],
    *,
    channels: Sequence[ChannelName] = (),
    seconds: float = SECONDS,
    threads: int = 2,
    reading: Reading = silent,
) -> ComparisonResult:
    """Compare a model, driven by the recorded commands, with recordings: size, joint and time of its error.

    A model of a cell is also compared by the wrench at the wrist, by axis and phase of contact. So are pictures with a
    model of a cell, or of a robot whose file shows more than the arm. They are predicted at the measured angles:
    `record["pictures"]` holds the errors of borders, depth and colour. Recordings are folders, or in memory.

    Args:
        model: a world, a model file, a robot's name, or a path to an MJCF or URDF.
        recordings: recordings of one robot to compare with.
        channels: the evidence to compare: joints, contact, pictures; default: what `vispeg diagnose` looks in.
        seconds: of longer recordings, use the most informative windows, this many seconds in all; 0 uses everything.
        threads: threads of the simulation.
        reading: progress display of reading a recording.

    Raises:
        UserError: a model or a recording that cannot be read, or that cannot be compared with each other.
    """
    whole = windows(model, seconds, recordings)
    inputs = read_inputs(model, recordings, (), need_validate=False, **whole, reading=reading)
    used = resolve(inputs.world, inputs.fitted, asked=channels)
    by_channel = {name: _compared(name, inputs, seconds, threads) for name in used if name != "pictures"}
    lead = by_channel.pop("contact", None) or by_channel.pop("joints", None) or Comparison(_seen_alone(inputs), {})
    record: ComparisonRecord = {**lead.record, "provenance": inputs.provenance(None)}
    arrays = dict(lead.arrays)
    if by_channel:
        record["by_channel"] = [
            {"channel": name, "given": [], "record": other.record} for name, other in by_channel.items()
        ]
    for name, other in by_channel.items():
        arrays |= {f"channel/{name}/{key}": value for key, value in other.arrays.items()}
    if "pictures" in used:
        compared = [frame for rec in inputs.fitted for frame in compared_pictures(rec, inputs.world, reading)]
        record["pictures"], drawn = pictures(compared)
        arrays |= drawn
        if used == ("pictures",):
            record["ladder"][0]["heldout_error"] = border_rms(compared)
    elif not channels and (said := _unseen(inputs)):
        record["notes"] = [*record.get("notes", ()), said]
    return ComparisonResult(finite(record), arrays, inputs.files)


def _compared(channel: ChannelName, inputs: Inputs, seconds: float, threads: int) -> Comparison:
    """Give the joints or the wrench of the recordings against the model."""
    if channel == "contact":
        result = compare_contact(inputs.world, inputs.fitted, nthread=threads)
        result.arrays.update(worst_moment(result.arrays, inputs.fitted))
        return result
    arm, some = arm_of(inputs.world), [choose(carrying(rec, inputs.world), seconds) for rec in inputs.fitted]
    result = joints.compare(arm, some, nthread=threads, label=inputs.world.label)
    if not result.record.get("diverged") and (moved := drifts(arm, some, threads)):
        result.record["drift"] = moved
    result.arrays.update(arm_arrays(arm, result.arrays["joints"]))
    return result


def _unseen(inputs: Inputs) -> str:
    """Why pictures that there are were not compared; empty where there are none."""
    looked = [rec for rec in inputs.fitted if rec.frames is not None]
    unseen = [rec.name for rec in looked if not seen(inputs.world, rec)]
    if unseen:
        return f"{', '.join(unseen)}: {UNSEEN}"
    blind = [rec.name for rec in inputs.fitted if rec.frames is None]
    return f"{', '.join(blind)}: no frames, so pictures are not compared" if looked and blind else ""


def _seen_alone(inputs: Inputs) -> ComparisonRecord:
    """Give the record of recordings of which pictures alone are compared, before these are."""
    rung: Rung = {"model": inputs.world.label, "fit_error": None, "heldout_error": None, "unit": "px RMS"}
    names = [rec.name for rec in inputs.fitted]
    note = "neither commands nor torques to compare the joints by: pictures alone are compared"
    if "joints" in available(inputs.world, inputs.fitted):
        note = "pictures alone are compared; the channel `joints` compares the joints"
    return {
        "format": "vispeg-compare/1",
        "ladder": [rung],
        "recordings": {"fit": [], "validate": names},
        "notes": [note],
    }


def compared_pictures(rec: Recording, world: World, reading: Reading = silent) -> list[Compared]:
    """Give the frames of a recording against what a model shows: its cell, or its robot's own bench."""
    scene = replace(scene_of(world, rec), cameras=tuple(rec.frames.names) if rec.frames is not None else ())
    assumed = () if cell_of(world, rec) is None else recorded_cell(rec).world.effects
    for placed in world.effects:
        if effect(placed.effect).family == "camera":
            try:
                place(effect(placed.effect), placed.where, scene)
            except UserError as error:
                raise UserError(str(error), file=rec.path / "frames/cameras.yaml") from error
    with reading(rec.path) as progress:
        return compare_frames(rec, scene, World(rec.robot).add(*assumed, *world.effects), progress=progress)
