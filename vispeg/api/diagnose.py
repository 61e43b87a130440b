"""`vispeg.diagnose`: name the effects that a model lacks."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vispeg.api.inputs import Inputs, Model, Source, read_inputs, windows
from vispeg.api.objects import diagnose_tosses, object_world
from vispeg.api.result import Result, Traced
from vispeg.api.stress.remainder import Price
from vispeg.channels import conduct
from vispeg.channels.change import diagnose_change
from vispeg.channels.channel import How
from vispeg.channels.resolve import resolve
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import check_seed
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.schema import DiagnosisRecord, ProposalRecord
from vispeg.kernels.threads import one_blas_thread
from vispeg.recordings.progress import Reading, silent
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import SECONDS
from vispeg.report.live.arm import with_arms
from vispeg.report.text.summary import Block
from vispeg.report.text.terminal import diagnosis_summary
from vispeg.report.write import finite, write_diagnosis
from vispeg.worlds.world import World

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class DiagnosisResult(Result, Traced):
    """The effects that a model lacks, with errors on the held-out recordings.

    Attributes:
        record: content of diagnosis.json, see docs/reference/keys.md.
        world: the model with the accepted effects.
        arrays: measured and predicted values, as in evidence.npz.
        effects: the accepted effects with values and 95 % intervals; marked `partial` if a residual remains.
        sources: files and folders that were read.
    """

    record: DiagnosisRecord
    world: World
    arrays: Mapping[str, np.ndarray] = field(repr=False)
    effects: tuple[EffectInstance, ...] = ()
    sources: tuple[str | Path, ...] = ()
    _progress: Progress | None = field(default=None, repr=False)
    holds = "diagnosis"  # class attributes, see `Result`
    tables = ("effects", "ladder")

    @property
    def verdict(self) -> str:
        """`adequate`, `identified`, `ambiguous` or `unexplained`."""
        return self.record["verdict"]

    @property
    def errors(self) -> tuple[float, float]:
        """Held-out RMS error of the given and of the corrected model, rad (or N m, see `record`)."""
        first, last = (self.record["ladder"][at]["heldout_error"] for at in (0, -1))
        return float("nan" if first is None else first), float("nan" if last is None else last)

    @property
    def summary(self) -> list[Block]:
        """The verdict, the decrease of the error, the effects with intervals, and the next step."""
        return diagnosis_summary(self.record)

    def plot(self) -> Figure:
        """Draw the error of each model of the ladder, with the noise floor; see `Result.plot`."""
        from vispeg.report.drawings.figures import WIDE, styled
        from vispeg.report.drawings.ladder import ladder_figure
        from vispeg.report.evidence import Evidence
        from vispeg.report.record import Record

        with styled(WIDE):
            figure = ladder_figure(Record("diagnosis", self.record, Evidence()))
        return super().plot() if figure is None else figure

    def save(self, out: str | Path, *, overwrite: bool = False) -> Path:
        """Write diagnosis.json, evidence.npz, model.yaml, report.html and the next motion; see `Result.save`."""
        path = super().save(out, overwrite=overwrite)
        if self._progress is not None:
            self._progress.remove()
        return path

    def _write(self, folder: Path) -> None:
        write_diagnosis(folder, dict(self.record), self.world, dict(self.arrays))


@one_blas_thread()
def diagnose(
    model: Model,
    recordings: Source | Sequence[Source],
    validate: Source | Sequence[Source] = (),
    *,
    hold_out: float | None = None,
    baseline: Source | Sequence[Source] = (),
    seconds: float = SECONDS,
    seed: int = 0,
    threads: int = 2,
    policies: str | Path | Sequence[str | Path] = (),
    cell: str | Path = "nominal",
    episodes: int = 100,
    part: str | Path | None = None,
    channels: str | Sequence[str] = (),
    rooms: Sequence[str] = (),
    say: Callable[[str], None] = lambda text: None,
    likely: Callable[[ProposalRecord], None] = lambda record: None,
    reading: Reading = silent,
) -> DiagnosisResult:
    """Name the physical effects that a model lacks, and add them to it.

    Recordings are folders, or objects in memory. `record["baseline"]` holds the effects before a change,
    `record["cost"]` the cost of the remaining error to a policy.

    Args:
        model: a world, a model file, a robot's name, or a path to an MJCF or URDF; an MJCF of one free body is an
            object, whose recordings are tosses (docs/formats.md).
        recordings: recordings to fit.
        validate: held-out recordings, never fitted.
        hold_out: without `validate`: hold out the end of each recording, this share of it; 0.3 is usual. A recording of
            another motion is a better test.
        baseline: two or more earlier recordings of the same robot, of which the last is held out. The named effects are
            then the change since.
        seconds: of longer recordings, use only the most informative windows, this many seconds in total; 0 uses
            everything.
        seed: seed of everything random.
        threads: number of threads for the simulation.
        policies: a policy's folder or name, or `expert`, to state what the remaining error costs it in success.
        cell: world of the policy: a built-in world's name or a world file.
        episodes: number of episodes of the policy, with and without the remaining error each.
        part: folder that keeps finished steps until the result is saved; with the same arguments and folder, a stopped
            diagnosis continues.
        channels: channels to diagnose; default: all that the recordings hold, but in a cell the joints only together
            with contact and pictures.
        rooms: former name of `channels`; to be removed in the next release.
        say: called with a line of text at each step.
        likely: called after a few seconds with the effects that torques suggest, which the search then confirms or
            corrects: the `proposal` of docs/reference/keys.md.
        reading: shows progress while a recording is read.

    Raises:
        UserError: the model or a recording cannot be read or compared, or nothing moves in it; or a policy cannot be
            played, or its cell has another robot.
    """
    channels = renamed([channels] if isinstance(channels, str) else channels, rooms)
    check_seed(seed)
    thing = object_world(model)
    if thing is not None:
        if policies:
            raise UserError("a policy needs a robot, not a free object", key="--policy", expected="a robot's model")
        if not isinstance(baseline, Sequence) or len(baseline):
            raise UserError("an object has no baseline", key="--baseline", expected="two diagnoses, one of each state")
        resolve(thing, asked=channels)  # refuses channels that an object does not have
        tosses = diagnose_tosses(thing, recordings, validate, seed, threads, say, None if part is None else Path(part))
        record = finite({**tosses.result.record, "provenance": tosses.provenance})
        found = tosses.result
        return DiagnosisResult(record, found.world, {}, found.added, tosses.files, tosses.progress)
    options = {**windows(model, seconds, recordings, validate), "hold_out": hold_out, "reading": reading}
    inputs = read_inputs(model, recordings, validate, **options)
    price = Price.of(policies, cell, episodes, inputs.world) if policies else None
    before = _before(model, baseline, seconds, reading)
    stamp = inputs.provenance(seed)
    progress = None if part is None else progress_of(inputs, seconds, seed, Path(part), before)
    say("going on" if progress is not None and progress.resumed else "simulating")
    both = inputs.fitted, inputs.held_out
    how = How(seconds, seed, threads, say, likely, Progress() if progress is None else progress)
    if before is None:
        used = resolve(inputs.world, *both, asked=channels)
        result = conduct.diagnose(used, inputs.world, both, how)
    else:
        earlier = before.fitted, before.held_out
        used = resolve(inputs.world, *earlier, *both, asked=channels)
        result = diagnose_change(used, inputs.world, earlier, both, how)
        stamp["inputs"] = dict(sorted({**stamp["inputs"], **before.provenance(seed)["inputs"]}.items()))
    with_arms(inputs.world, result.arrays)
    remainder = result.record.get("remainder", [])
    cost = {}
    if price is not None:
        folder = None if part is None else Path(part) / "policy"
        cost["cost"] = price.paid(result.world, remainder, seed=seed, part=folder, say=say)
        stamp["inputs"] |= {e.name: e.digest for e in price.who}
    record = finite({**result.record, **cost, "provenance": stamp})
    files = inputs.files if before is None else (*inputs.files, *before.files)
    return DiagnosisResult(record, result.world, result.arrays, result.added, files, progress)


def renamed(channels: Sequence[str], rooms: Sequence[str]) -> Sequence[str]:
    """Return the requested channels; warn if the former argument `rooms` is used.

    Raises:
        UserError: both arguments are given.
    """
    if not rooms:
        return channels
    warnings.warn("rooms is called channels now; the old name goes with the next release", FutureWarning, stacklevel=4)
    if channels:
        raise UserError("is the former name of --channels; both are given", key="--rooms", expected="only --channels")
    return rooms


def progress_of(inputs: Inputs, seconds: float, seed: int, part: Path, before: Inputs | None = None) -> Progress:
    """Load the intermediate results of a diagnosis with these arguments from the folder `part`."""
    stamp = inputs.provenance(seed)
    key = [*inputs.key(), seconds, seed, stamp["versions"], *([] if before is None else before.key())]
    return Progress(part / "progress.json", key)


def _before(model: Model, baseline: Source | Sequence[Source], seconds: float, reading: Reading) -> Inputs | None:
    """Read the recordings of the baseline, the last of which is held out; None without any."""
    sources = [baseline] if isinstance(baseline, Recording | str | Path) else [*baseline]
    if not sources:
        return None
    if len(sources) < 2:
        message = "one recording of the baseline is fitted, so another must judge"
        raise UserError(message, key="--baseline", expected="two or more", got=len(sources))
    return read_inputs(model, sources[:-1], sources[-1:], seconds=seconds, reading=reading)
