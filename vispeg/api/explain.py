"""`vispeg explain`: explain why trials fail, by replaying their starts in simulation."""

from __future__ import annotations

import hashlib
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from shutil import rmtree
from typing import Any

import yaml

from vispeg.api.playing import Playing, check_numbers, folders, play, silent, stamped
from vispeg.api.run import opened
from vispeg.api.stress.result import Stressed
from vispeg.core.cluster import Engine
from vispeg.core.counts import count
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.core.several import several
from vispeg.evaluation import explain as why
from vispeg.evaluation import runner, senses
from vispeg.evaluation.bridging import Asked, Bridging, diagnosis_of, recordings_of
from vispeg.evaluation.bridging import said as bridged
from vispeg.evaluation.explain import CLOSED, OPEN, TOGETHER
from vispeg.evaluation.folder import EPISODES, workplace
from vispeg.evaluation.jobs import Job, Setting, make_jobs
from vispeg.evaluation.overlay import Change
from vispeg.evaluation.players import ready
from vispeg.evaluation.prices import Prices
from vispeg.evaluation.records import Episode
from vispeg.evaluation.replay import Replays
from vispeg.evaluation.runner import names_of
from vispeg.evaluation.schema.explain import ExplainRecord, Next
from vispeg.evaluation.senses import DRAWS, Look, Parting, Strip
from vispeg.interface.interface import NoInterface
from vispeg.report.gap import words
from vispeg.report.gap.explain_page import render
from vispeg.report.text.summary import Block, Line
from vispeg.report.text.tables import Column, Sheet
from vispeg.task.config import TaskConfig
from vispeg.task.registry import config_of
from vispeg.task.world_file import BUILT_IN, WorldFile, load_world
from vispeg.trials.trial import FILE, STEPS, Trial, read_trial
from vispeg.trials.trial import folders as trials_in
from vispeg.worlds.identified import acting
from vispeg.worlds.model_file import load_model, write_model

ASSUMED = (
    f"the arm's repeatability is assumed to be {senses.ASSUMED:g} mm; `robot: {{repeatability: M}}` in the world's file"
    " states it"
)
CORRECTED, CORRECTED_MODEL = "world.yaml", "model.yaml"  # files in OUT
UNTRIED = (
    "no cause was tried: give effects with --model FILE, which `vispeg diagnose` finds from a motion in free air"
    " (`vispeg motions` writes one)"
)


@dataclass(frozen=True, repr=False)
class ExplainResult(Stressed):
    """How trials end when replayed in simulation, and what each named effect explains; see `Played`.

    Attributes:
        strip: pictures of one trial beside simulated ones; None for a policy without cameras.
    """

    strip: Strip | None = field(default=None, repr=False)
    command = holds = "explain"
    tables = ("causes", "trials")

    @property
    def summary(self) -> list[Block]:
        """The verdict, one row per cause, and next steps."""
        r = self.record
        out: list[Block] = [Line(f"{r['policy']}: {r['words']}", path=True)]
        out += [
            Line(f"rule: {x['rule']} {x['value']:.3g} {x['unit']} (more than {x['limit']:g}): {x['points_to']}")
            for x in r["rules"]
            if x["speaks"]
        ]
        if r["causes"]:
            heads = [
                Column(h) for h in ("cause", "effect on success", "share of the loss", "points to it", "cure", "hours")
            ]
            out.append(Sheet(heads, [_cause(c) for c in r["causes"]]))
        for x in r["senses"]:
            if x["points_to"]:
                out.append(Line(f"with simulation's {x['sense']} the action moves by {x['words']}: {x['points_to']}"))
        out.append(Line(r["worth"]["words"]))
        if r["remainder"]:
            out.append(Line(r["remainder"]["words"]))
        b = r["bridge"]
        out.append(Line(f"{b['verdict']}: {b['words']}"))
        heads = [Column(h) for h in ("condition of `unbridgeable here`", "here", "met")]
        out.append(Sheet(heads, [[c["condition"], c["here"], words.met(c["met"])] for c in b["conditions"]]))
        heads = [Column(h) for h in ("next step", "wins back at most, points", "hours", "points an hour")]
        out.append(Sheet(heads, [_step(s) for s in r["steps"]]))
        if r["next"]:
            out += [Line(r["next"]["why"]), Line(f"next: {r['next']['command']}", path=True)]
        return [*out, *(Line(note, path=True) for note in r["notes"])]

    def _render(self) -> str:
        return render(self.record, self.strip)


def _cause(c: Mapping[str, Any]) -> list[str]:
    points = "; ".join(c["points_to_it"]) or "-"
    return [c["effect"], c["words"], words.rate(c["share"]), points, c["cure"] or "-", words.hours(c["hours"])]


def _step(s: Mapping[str, Any]) -> list[str]:
    rate = "-" if s["an_hour"] is None else f"{100 * s['an_hour']:.3g}"
    return [s["step"], words.signed(s["gain"]), f"{words.hours(s['hours'])}: {s['hours_from']}", rate]


def explain(
    trials: str | Path,
    policy: str | Path,
    world: str | Path = "nominal",
    *,
    model: str | Path | None = None,
    replays: int = 20,
    remainder: int = 0,
    held_out: str | Path | Sequence[str | Path] = (),
    demonstrations: int = 50,
    minutes_per_demonstration: float = 1.0,
    minutes_per_recording: float = 17.0,
    training_hours: float | None = None,
    apply: bool = False,
    task: Mapping[str, Any] | None = None,
    seed: int = 0,
    workers: int = 1,
    engine: Engine = "local",
    out: str | Path | None = None,
    overwrite: bool = False,
    playing: Playing = silent,
) -> ExplainResult:
    """Explain why trials of a policy fail.

    Replays every trial's start in `world`, by the policy and by the trial's own actions; then by the policy with each
    effect of `model`.

    Args:
        trials: a folder of trials.
        policy: the policy of the trials: a folder, or a bundled policy's name.
        world: the simulated world: a built-in world's name or a world file. Its draws represent the model's
            uncertainty.
        model: a model file whose effects may be the causes. Default: no cause is tried.
        replays: number of replays of each start.
        remainder: number of episodes with the torque that the found world lacks in the trials' motions, and as many
            without; also in the training world. 200 episodes resolve 5 percentage points.
        held_out: recordings from which this torque is computed. Default: the trials.
        demonstrations: number of demonstrations that would be recorded on the robot, to estimate their cost.
        minutes_per_demonstration: time to set up and do a demonstration, min; 500 fit into a day of eight hours.
        minutes_per_recording: time to set up a motion for `diagnose`, min; two hours for an arm of seven joints.
        training_hours: hours of fine-tuning; default: from the log of the policy's training, if there is one.
        apply: write `out`/world.yaml with the causes, and print the command that trains in it; or, if the policy fails
            in simulation too, the command that collects demonstrations from there.
        task, seed, workers, engine, out, overwrite, playing: as in `vispeg.evaluate`.

    Raises:
        UserError: no trials in which the arm was moved at full speed, trials with actions of another length or period
            than the policy's, a model of another robot than the world's, an effect that the world's cell does not have,
            or as for `vispeg.evaluate`.
    """
    check_numbers(1, workers)
    if replays < 1:
        raise UserError("no replays", key="--replays", expected="1 or more", got=replays)
    asked = Asked(
        remainder,
        tuple(Path(p) for p in several(held_out)),
        Prices(demonstrations, minutes_per_demonstration, minutes_per_recording, training_hours),
    )
    asked.check()
    if apply and out is None:
        raise UserError("a corrected world needs a folder", key="--apply", expected="--out FOLDER")
    who, file = ready([policy]), load_world(world)
    config = config_of({**file.task, **(task or {})})
    notes: list[str] = []
    read = _read(Path(trials), notes)
    if len(who) != 1 or who[0].source is not None:
        raise UserError(
            "not a single stored policy", key="--policy", expected="a folder or a bundled policy", got=policy
        )
    _check_actions(read, config_of({**file.task, **(task or {}), **who[0].task}))
    others = {t.said.policy.name for t in read if t.said.policy.digest not in ("", who[0].digest)}
    if others:
        notes.append(f"the trials are of another policy than {who[0].name}: {', '.join(sorted(others))}")
    named: tuple[EffectInstance, ...] = ()
    if model is not None:
        found = load_model(model)
        named = acting(found.effects, found.robot, file.world.base.robot, model)
    causes: dict[str, tuple[EffectInstance, ...]] = {effect.label: (effect,) for effect in named}
    if len(named) > 1:
        causes[TOGETHER] = named
    if not causes:
        notes.append(UNTRIED)
    recordings = recordings_of(asked.held_out, read)
    diagnosis = diagnosis_of(None if model is None else Path(model))
    sources = [file.path, *folders(who), Path(trials), *asked.held_out, *([] if model is None else [Path(model)])]
    with workplace(out, "explain.json", overwrite, sources) as place:
        if not (place / runner.EPISODES).exists():  # remove replays left by an earlier run
            rmtree(place / "replays", ignore_errors=True)
        digest = _digest(read)
        seeds = [why.seeds_of(i, len(read), replays, seed) for i in range(len(read))]
        trial_of = {s: t for t, own in zip(read, seeds, strict=True) for s in own}  # seed of a replay -> its trial
        starts = {s: replace(t.said.again(), source=(t.path or Path()) / FILE) for s, t in trial_of.items()}
        actions = {s: t.steps.action for s, t in trial_of.items()}
        kinds = {CLOSED: (), OPEN: (), **causes}
        jobs: dict[str, list[Job]] = {}
        kept_in = place / "replays"
        for kind, effects in kinds.items():
            changes = tuple(map(_change, effects))
            setting = Setting(str(world), file.name, f"{kind}, {digest}", changes, dict(task or {}))
            again = Replays(starts, actions if kind == OPEN else {})
            (job,) = make_jobs(who, [setting], [*trial_of], place / "worlds")
            job = replace(job, replays=again)
            jobs[kind] = [job]
            if kind == OPEN:  # keep DRAWS replays of each start as trials, to compare measurements
                # a resumed run may have other trials or another world
                kept_in /= f"{digest}-{job.world_hash[:12]}"
                first = tuple(s for own in seeds for s in own[:DRAWS])
                rest = tuple(s for own in seeds for s in own[DRAWS:])
                jobs[kind] = [replace(job, seeds=first, trials=kept_in), replace(job, seeds=rest)]
        flat = [job for group in jobs.values() for job in group if job.seeds]
        ends = play(flat, place, workers, playing, engine)
        played = {kind: _of(ends, group[0].configuration, seeds) for kind, group in jobs.items()}
        kept = {int(p.name.rpartition("-")[2]): p for p in trials_in(kept_in)}
        replayed = [[read_trial(kept[s]) for s in own[:DRAWS]] for own in seeds]
        parted, strip = _parted(jobs[CLOSED][0], policy, read, replayed, workers, engine, notes)
        repeats = config.robot.repeats_mm
        if parted and repeats is None:
            notes.append(ASSUMED)
        options = {"notes": notes, "parted": parted, "repeats": repeats or senses.ASSUMED}
        record = why.summarise(who[0].name, read, played, [group[0] for group in replayed], causes, **options)
        # the missing torque; episodes as found, with it, in the training world, and there with random torque; its name
        torque, more, home = None, [], ""
        if remainder:
            bridging = Bridging(who[0], str(world), file, named, dict(task or {}), place / "worlds", seed)
            simulated = [r for group in replayed for r in group]
            torque = bridging.remainder(recordings, simulated, config.control_period, record["notes"])
            if torque is not None:

                def play_more(further: list[Job]) -> list[Episode]:
                    return play(further, place, workers, playing, engine)

                more = bridging.play(torque, remainder, play_more, record["notes"])
                home = more[2][0].world if more[2] else ""
        tuning = _command("finetune", str(policy), world=_world_option(file), dataset="demonstrations", out="tuned")
        bridged(
            record,
            more,
            torque,
            home,
            diagnosis=diagnosis,
            config=config,
            asked=asked,
            policy=who[0].path if who[0].stored else None,
            trials=read,
            named=named,
            commands={"causes": "vispeg explain ... --apply" if causes else "", "demonstrations": tuning},
        )
        ends = [*ends, *(e for group in more for e in group)]
        if apply and out is not None:
            record["next"] = _applied(
                record, place, Path(out), str(policy), file, dict(task or {}), model, Path(trials)
            )
        about = {**record, "world": {"name": file.name, "hash": file.hash}, "replays": replays}
        result = ExplainResult(
            stamped(about, seed, folders(who)), tuple(ends), (), tuple(sources), names_of(place / EPISODES), strip
        )
        if out is not None:
            result._write(place)
    return result


def _read(place: Path, notes: list[str]) -> list[Trial]:
    """Read the trials in which the arm was moved at full speed. Raises UserError: there are none."""
    every = [read_trial(folder) for folder in trials_in(place)]
    moved = [t for t in every if t.said.full_speed and len(t.steps.time)]
    if len(moved) < len(every):
        notes.append(f"{len(every) - len(moved)} of {count(len(every), 'trial')} left out: shadows or slowed down")
    if not moved:
        raise UserError("no trials in which the arm was moved at full speed", file=place)
    return moved


def _check_actions(trials: Sequence[Trial], config: TaskConfig) -> None:
    """Raise UserError if the trials' actions are not those of a policy that is played with these settings."""
    for t in trials:
        count, period = t.steps.action.shape[1], t.said.timing.period_s
        if count != len(config.dof):
            what = "actions of another length than the policy's"
            raise UserError(what, file=t.path, key="action", expected=len(config.dof), got=count)
        if period and not math.isclose(period, config.policy_period):
            what = "another policy period than the policy's"
            raise UserError(what, file=t.path, key="timing.period_s", expected=config.policy_period, got=period)


def _digest(trials: Sequence[Trial]) -> str:
    """Return a digest of the trials, so that a resumed run can check that they are unchanged."""
    hashed = hashlib.sha256()
    for trial in trials:
        for name in (FILE, STEPS):
            hashed.update((trial.path or Path()).joinpath(name).read_bytes())
    return hashed.hexdigest()[:12]


def _change(effect: EffectInstance) -> Change:
    return Change(effect.effect, {key: value.value for key, value in effect.params.items()}, effect.where)


def _of(ends: Sequence[Episode], configuration: str, seeds: Sequence[Sequence[int]]) -> list[Episode]:
    """Return the episodes of a configuration in the order of the seeds."""
    by_seed = {e.seed: e for e in ends if e.configuration == configuration}
    return [by_seed[s] for own in seeds for s in own]


def _applied(
    record: ExplainRecord,
    place: Path,
    out: Path,
    policy: str,
    world: WorldFile,
    task: dict[str, Any],
    model: str | Path | None,
    trials: Path,
) -> Next | None:
    """Return the next step: train in a world with the causes, which is written, or collect demonstrations.

    None if no effect of a model is a cause, unless the policy fails in simulation too.

    Args:
        record: the explanation so far.
        place: folder in which the world is written.
        out: final path of that folder.
        policy: the policy, as named by the user.
        world: the world of the replays.
        task: settings of the task in the replays, in place of the world's.
        model: the model file whose effects were tried.
        trials: folder of the trials.
    """
    base: str | Path = _world_option(world)
    values: dict[str, Any] = {"format": "vispeg-world/1", "about": f"what {trials.name} showed", "base": base}
    if task:
        values["task"] = task
    if record["verdict"] == "policy":
        why = "it fails in simulation from these starts too: demonstrations from there teach it"
        if task:
            _write_world(place, values)
            base = out / CORRECTED
        return {"why": why, "command": _command("finetune", policy, world=base, starts=trials, out="tuned")}
    if model is None or not any(c["verdict"] == "different" for c in record["causes"]):
        return None
    write_model(place / CORRECTED_MODEL, load_model(model), overwrite=True)
    _write_world(place, {**values, "model": CORRECTED_MODEL})
    why = f"{CORRECTED} has what {Path(model).name} names, each value within its interval, besides all of {world.name}"
    return {"why": why, "command": _command("finetune", policy, world=out / CORRECTED, out="tuned")}


def _write_world(place: Path, values: Mapping[str, Any]) -> None:
    """Write a world's file into a folder. Raises UserError: the world is invalid."""
    write_text_atomic(place / CORRECTED, yaml.safe_dump(dict(values), sort_keys=False), overwrite=True)
    load_world(place / CORRECTED)


def _world_option(world: WorldFile) -> str:
    """Return a world's name, or its absolute path, for the command line."""
    return world.name if world.path.parent == BUILT_IN else str(world.path.resolve())


def _command(verb: str, policy: str, **options: str | Path) -> str:
    return shlex.join(["vispeg", verb, policy, *(w for k, v in options.items() for w in (f"--{k}", str(v)))])


def _parted(
    job: Job,
    policy: str | Path,
    trials: Sequence[Trial],
    replayed: Sequence[Sequence[Trial]],
    workers: int,
    engine: Engine,
    notes: list[str],
) -> tuple[list[Parting], Strip | None]:
    """Return how each trial's actions change with simulated senses, and pictures of the trial that shows it best.

    Empty, with a note, if the policy has no interface to a robot, if there are fewer than DRAWS replays, or if a trial
    lacks pictures that the policy sees.

    Raises:
        UserError: a policy that cannot be read.
    """
    if len(replayed[0]) < DRAWS:
        notes.append(f"senses are not compared: that takes --replays {DRAWS} or more")
        return [], None
    try:
        acts, meaning, _ = opened(policy, None, None)
    except NoInterface as error:
        notes.append(f"senses are not compared: {error}")
        return [], None
    needed = {seen.eye.name for seen in meaning.images.values()}
    for t in trials:  # those of another policy may have other pictures, or none
        taken = () if t.recording.frames is None else t.recording.frames.cameras
        if lacking := sorted(needed - {*taken}):
            notes.append(f"senses are not compared: {t.path} has no pictures of {', '.join(lacking)}")
            return [], None
    drawn: list[list[Any]] = [[()] * DRAWS for _ in trials]
    if meaning.images:
        looks = [
            Look.of(job, replay.said.seed or 0, (i, k), senses.places(t))
            for i, t in enumerate(trials)
            for k, replay in enumerate(replayed[i])
        ]
        for (i, k), pictures in runner.each(looks, workers, senses.look, engine):
            drawn[i][k] = pictures
    parted = [senses.part(acts, meaning, *each) for each in zip(trials, replayed, drawn, strict=True)]
    if not meaning.images:
        return parted, None
    shown = senses.moment(trials, parted, senses.PICTURES)
    i = shown["number"]
    return parted, senses.strip(senses.seen(trials[i], meaning), drawn[i][0], shown["step"])
