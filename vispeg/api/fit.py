"""`vispeg.fit`: fit the parameters of effects that the user names, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from vispeg.api.inputs import Model, Source, read_inputs, windows
from vispeg.api.result import Result, Traced
from vispeg.channels.channel import CHANNELS, Both, How
from vispeg.channels.resolve import fitted_in, resolve
from vispeg.core.cluster import Engine, cluster
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import check_seed
from vispeg.core.several import several
from vispeg.identify.calibrate import ITERATIONS, Method, calibrate
from vispeg.identify.checkpoint import Checkpoint, Trace
from vispeg.identify.evidence import Evidence
from vispeg.identify.spread import spread
from vispeg.kernels.threads import one_blas_thread
from vispeg.recordings.progress import Reading, silent
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import SECONDS
from vispeg.report.fitted import fit_record, fit_summary
from vispeg.report.live.arm import with_arms
from vispeg.report.text.summary import Block
from vispeg.report.write import finite, write_fit
from vispeg.robots.scene import Scene
from vispeg.task.belief import robot_of_world
from vispeg.worlds.model_file import model_text, write_model
from vispeg.worlds.places import ALL
from vispeg.worlds.words import parse
from vispeg.worlds.world import World

Watch = Callable[[int, Trace], None]

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class FitResult(Result, Traced):
    """Fitted effects.

    Attributes:
        record: content of fit.json, see docs/reference/keys.md.
        world: the model with the fitted values and their 95 % intervals.
        effects: the fitted effects of `world`.
        sources: files and folders that were read.
        arrays: measured and predicted values, as in evidence.npz.
    """

    record: Mapping[str, Any]
    world: World
    effects: tuple[EffectInstance, ...] = ()
    sources: tuple[str | Path, ...] = ()
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)
    _checkpoint: Checkpoint | None = field(default=None, repr=False)
    holds = "fit"  # class attributes, see `Result`
    tables = ("effects",)

    @property
    def summary(self) -> list[Block]:
        """Errors before and after, fitted values with intervals, and warnings about them."""
        return fit_summary(self.record)

    def plot(self) -> Figure:
        """Draw the error of each model of the ladder, with the noise floor; see `Result.plot`."""
        from vispeg.report.drawings.figures import WIDE, styled
        from vispeg.report.drawings.ladder import ladder_figure
        from vispeg.report.evidence import Evidence
        from vispeg.report.record import Record

        with styled(WIDE):
            figure = ladder_figure(Record("fit", self.record, Evidence()))
        return super().plot() if figure is None else figure

    def save(self, out: str | Path, *, overwrite: bool = False) -> Path:
        """Write fit.json, evidence.npz, model.yaml and report.html; see `Result.save`."""
        path = super().save(out, overwrite=overwrite)
        if self._checkpoint is not None:
            self._checkpoint.remove()
        return path

    def _write(self, folder: Path) -> None:
        write_fit(folder, self.record, self.arrays)
        write_model(folder / "model.yaml", self.world)


@one_blas_thread()
def fit(
    model: Model,
    recordings: Source | Sequence[Source],
    effects: str | EffectInstance | Sequence[str | EffectInstance] = (),
    validate: Source | Sequence[Source] = (),
    *,
    channels: str | Sequence[str] = (),
    seconds: float = SECONDS,
    method: Method = "auto",
    iterations: int | None = None,
    starts: int = 1,
    seed: int = 0,
    threads: int = 2,
    engine: Engine = "local",
    part: str | Path | None = None,
    resume: bool = False,
    watch: Watch = lambda start, trace: None,
    reading: Reading = silent,
) -> FitResult:
    """Fit the parameters of named effects to recordings, with 95 % intervals.

    Recordings are folders or `Recording` objects. Effects are texts, or instances whose values are where the fit
    starts. Of two for one effect at one place the later counts; beside one at `all`, a place of its own keeps its own
    value.

    Args:
        model: a world, a model file, a robot's name, or a path to an MJCF or URDF.
        recordings: recordings to fit.
        effects: effects to fit, each EFFECT:WHERE[:param=start,...]; WHERE all fits one value shared by all places,
            WHERE each fits one value per place; default: the effects of the model. A parameter without a start value
            starts at the model's value, or else at a typical one; a servo or a limit that the model lacks, without any
            start value, starts at an estimate from the recordings.
        validate: held-out recordings, never fitted.
        channels: channels to choose from; an unknown name lists all. The fit uses one, the first in which most of the
            effects are visible; default: the channels that `vispeg diagnose` uses.
        seconds: of longer recordings, use only the most informative windows, this many seconds in total; 0 uses
            everything.
        method: auto: least squares, with CMA-ES before it if an effect is not smooth.
        iterations: largest number of points that least squares evaluates, the start included: 1 takes no step. CMA-ES
            gets ten times as many generations. Default: 15.
        starts: number of starts, of which the best result is kept: the first as stated, the others random.
        seed: seed of the random starts and of CMA-ES.
        threads: number of threads for the simulation.
        engine: where candidates are simulated: local, or ray for a Ray cluster of `threads` workers.
        part: folder that keeps the state of the optimizers until the result is saved.
        resume: continue a fit that was stopped.
        watch: called after each step of an optimizer, with the number of the start and the optimizer's trace.
        reading: shows progress while a recording is read.

    Raises:
        UserError: a model, a recording or an effect that cannot be read, an unknown method or engine, or nothing to
            fit.
    """
    check_seed(seed)
    for flag, choice, choices in (("--method", method, get_args(Method)), ("--engine", engine, get_args(Engine))):
        if choice not in choices:
            raise UserError("no such choice", key=flag, got=choice, choices=choices)
    iterations = ITERATIONS if iterations is None else iterations
    for flag, number in (("--starts", starts), ("--iterations", iterations)):
        if number < 1:
            raise UserError("nothing to fit", key=flag, expected="1 or more", got=number)
    inputs = read_inputs(
        model,
        recordings,
        validate,
        need_validate=False,
        **windows(model, seconds, recordings, validate),
        reading=reading,
    )
    world, free, unstated = _with_effects(inputs.world, several(effects), inputs.fitted)
    stamp = inputs.provenance(seed)
    both = inputs.fitted, inputs.held_out
    used = resolve(world, *both, asked=channels)
    name = fitted_in(used, [world.effects[i].effect for i in free])
    key = [model_text(world), *inputs.key(), list(free), seconds, method, starts, seed, stamp["versions"], name]
    checkpoint = None
    if part is not None:
        checkpoint = Checkpoint(Path(part) / "checkpoint.json", key, starts, resume, watch)
    channel = CHANNELS[name]
    evidence, judged = channel.evidence(world, both, How(seconds, threads=threads))
    start, free, unstated = _observed_part(world, name, free, unstated)  # the indices are now those of `start`
    start = channel.begin(evidence, start, unstated)
    make = partial(_fitted, world, both, name, How(seconds))
    options = {"method": method, "starts": starts, "iterations": iterations, "checkpoint": checkpoint}
    with cluster(threads) if engine == "ray" else nullcontext():
        evaluate = spread(make, threads) if engine == "ray" else None
        result = calibrate(evidence, start, free, seed=seed, evaluate=evaluate, **options)
    result = replace(result, fit=channel.finish(evidence, result.fit))
    given = channel.part(inputs.world)
    record, final = fit_record(given, result, free, evidence, judged)
    record = finite(record | {"channel": name, "provenance": stamp})
    arrays = channel.drawn(evidence if judged is None else judged, [given, final])
    with_arms(given, arrays)  # adds the arm's shapes to them
    fitted = tuple(final.effects[i] for i in free)
    return FitResult(record, world.add(*fitted), fitted, inputs.files, arrays, checkpoint)


def _observed_part(
    world: World, channel: str, free: tuple[int, ...], unstated: tuple[int, ...]
) -> tuple[World, tuple[int, ...], tuple[int, ...]]:
    """Return the part of the world that a channel observes, and the indices of the fitted effects in that part.

    Raises:
        UserError: the channel does not observe an effect that is to be fitted.
    """
    part = CHANNELS[channel].part(world)
    at = {e.label: i for i, e in enumerate(part.effects)}
    for i in free:
        if (label := world.effects[i].label) not in at:
            expected = "effects of one channel at a time; --channels chooses it"
            raise UserError(f"does not show in the channel {channel}", key="--effects", got=label, expected=expected)
    free, unstated = (tuple(at[world.effects[i].label] for i in group) for group in (free, unstated))
    return part, free, unstated


def _fitted(world: World, both: Both, channel: str, how: How) -> Evidence:
    """Return the evidence of the fitted recordings; called in each Ray worker."""
    return CHANNELS[channel].evidence(world, both, how)[0]  # what is compared depends on both groups of recordings


def _with_effects(
    world: World, effects: Sequence[str | EffectInstance], recordings: Sequence[Recording]
) -> tuple[World, tuple[int, ...], tuple[int, ...]]:
    """Return the world with the named effects added, their indices, and the indices of those without a start value."""
    if not effects:
        if not world.effects:
            raise UserError("nothing to fit", key="--effects", expected="EFFECT:WHERE, or a model file with effects")
        return world, tuple(range(len(world.effects))), ()
    robot = robot_of_world(world)
    cameras = dict.fromkeys(name for rec in recordings if rec.frames is not None for name in rec.frames.names)
    if isinstance(robot, Scene) and cameras:
        robot = replace(robot, cameras=tuple(cameras))
    present = {(e.effect, e.where) for e in world.effects}
    wanted: dict[tuple[str, str], EffectInstance] = {}
    stated: dict[tuple[str, str], bool] = {}  # whether it has a start value
    for named in effects:
        if isinstance(named, EffectInstance):
            placed, values = [named], named.params != EffectInstance.of(named.effect, named.where).params
        else:
            placed, values = parse(named, robot, world.effects), named.count(":") > 1  # EFFECT:WHERE:param=start
        for e in placed:
            at = e.effect, e.where
            wanted[at], stated[at] = e, values or at in present
    # an effect at `all` comes first: of two that act at one place the later counts
    world = world.add(*sorted(wanted.values(), key=lambda e: e.where != ALL))
    free = tuple(i for i, e in enumerate(world.effects) if (e.effect, e.where) in wanted)
    return world, free, tuple(i for i in free if not stated[world.effects[i].effect, world.effects[i].where])
