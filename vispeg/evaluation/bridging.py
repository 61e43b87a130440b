"""The parts of `vispeg explain` beyond causes: the unexplained torque played back, costs of steps, and the verdict."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.evaluation import bridge, prices
from vispeg.evaluation.entrants import Entrant
from vispeg.evaluation.explain import TOGETHER
from vispeg.evaluation.jobs import Job, Setting, make_jobs, seeds_of
from vispeg.evaluation.outlook import Sign, outlook
from vispeg.evaluation.overlay import Change
from vispeg.evaluation.prices import Prices
from vispeg.evaluation.records import Episode
from vispeg.evaluation.remainder import Missing, Remainder, missing_of
from vispeg.evaluation.schema.explain import ExplainRecord
from vispeg.formats.json_data import read_json
from vispeg.recordings.load import load
from vispeg.recordings.recording import Recording
from vispeg.task.config import TaskConfig
from vispeg.task.registry import scene_of
from vispeg.task.world_file import WorldFile, load_world
from vispeg.trials.trial import Trial
from vispeg.worlds.split import of_arm
from vispeg.worlds.world import World

# HOME plays without the remainder, RANDOM with a random torque of the same size
FOUND, LEFT, HOME, RANDOM = "as found", "as found, with the remainder", "home", "home, as much at random"
DIAGNOSIS = "diagnosis.json"
WIDER = 2.0  # upper end of the random torque as a multiple of the remainder, so that draws lie around the remainder
SMALL = 0.02  # share of the worst joint's torque; joints with less are not randomized
MM = {"mm": 1.0, "m": 1e3}  # mm per unit of a tolerance
PlayJobs = Callable[[list[Job]], list[Episode]]


@dataclass(frozen=True)
class Asked:
    """Options of an explanation that do not concern causes.

    Attributes:
        remainder: number of episodes without and with the unexplained torque; 0 for none.
        held_out: recordings from which this torque is computed; if empty, those of the trials.
        prices: costs of a person's work.
    """

    remainder: int = 0
    held_out: tuple[Path, ...] = ()
    prices: Prices = field(default_factory=Prices)

    def check(self) -> None:
        """Raise UserError for impossible values."""
        if self.remainder < 0:
            raise UserError("no number of episodes", key="--remainder", expected="0 or more", got=self.remainder)
        self.prices.check()


def diagnosis_of(model: Path | None) -> Mapping[str, Any] | None:
    """Return the diagnosis.json in the folder of a model file; None if there is none."""
    if model is None or not (beside := model.parent / DIAGNOSIS).is_file():
        return None
    values = read_json(beside, finite=False)
    return values if isinstance(values, dict) else None


def tolerance_mm(config: TaskConfig) -> float | None:
    """Return the width of the goal minus that of the part, mm; None for a task without a tolerance."""
    about = config.tolerance
    return None if about is None else getattr(config, about.setting) * MM[about.unit]


def signs_of(config: TaskConfig) -> Sequence[Sign]:
    """Return the signs of an unbridgeable gap (SVRC's guide, docs/sources.md) from tolerance and repeatability.

    Empty if the world does not state both.
    """
    tolerance, repeats = tolerance_mm(config), config.robot.repeats_mm
    if tolerance is None or repeats is None:
        return ()
    return [s for s in outlook(tolerance, repeats)["signs"] if s["sign"].startswith(("precision", "repeatability"))]


@dataclass(frozen=True)
class Bridging:
    """Compute and play the remainder of trials.

    Attributes:
        who: the policy.
        world: name or file of the world.
        file: the world, as read.
        named: effects that may be causes.
        task: settings of the task.
        folder: folder for changed worlds.
        seed: seed of the episodes.
    """

    who: Entrant
    world: str
    file: WorldFile
    named: tuple[EffectInstance, ...]
    task: Mapping[str, Any]
    folder: Path
    seed: int

    def arm(self, robot: str) -> World:
        """Return the identified arm: the world's effects, with ranges at their middle, and the named ones."""
        drawn = of_arm(self.file.world).middle(scene_of({**self.file.task, **self.task}))
        return _arm_with(robot, (*drawn.effects, *self.named))

    def remainder(
        self, recordings: Sequence[Recording], replayed: Sequence[Trial], tick: float, notes: list[str]
    ) -> Remainder | None:
        """Return the missing torque of the identified arm in the recordings, beyond that in its simulated replays.

        None, with a note, if no recording is long enough.
        """
        missing = _missing(recordings, self.arm(recordings[0].robot))
        floor: list[Missing] = []
        for t in replayed:
            world = _arm_with(t.recording.robot, t.said.begin().effects or ())
            floor += _missing([t.recording], world)
        found = Remainder.of(missing, floor, recordings[0].joints, tick)
        if found is None:
            notes.append("what no cause explains is not played: no recording is long enough")
        return found

    def play(self, remainder: Remainder, episodes: int, play: PlayJobs, notes: list[str]) -> list[list[Episode]]:
        """Play episodes as found, with the remainder, at home, and at home with as much random torque.

        Returns:
            The four lists of episodes; the last two are empty if the training world is unknown.
        """
        changes = tuple(Change(e.effect, {k: v.value for k, v in e.params.items()}, e.where) for e in self.named)
        digest = _digest(remainder)
        plain = Setting(self.world, self.file.name, FOUND, changes, dict(self.task))
        (found,) = make_jobs([self.who], [plain], seeds_of(episodes, self.seed), self.folder)
        jobs = [found, replace(found, configuration=f"{LEFT}, {digest}", remainder=remainder)]
        home = self.home(notes)
        if home is not None:
            random = tuple(
                Change("torque_noise", {"rms": {"uniform": [0.0, largest]}, "time": time}, joint)
                for joint, largest, time in _at_random(remainder)
            )
            for name, noise in ((HOME, ()), (f"{RANDOM}, {digest}", random)):
                setting = Setting(home, load_world(home).name, name, noise, dict(self.task))
                jobs += make_jobs([self.who], [setting], seeds_of(episodes, self.seed), self.folder)
        by_configuration: dict[str, list[Episode]] = {}
        for e in play(jobs):
            by_configuration.setdefault(e.configuration, []).append(e)
        return [by_configuration.get(job.configuration, []) for job in jobs] + [[] for _ in range(4 - len(jobs))]

    def home(self, notes: list[str]) -> str | None:
        """Return the policy's training world, for the scripted policy the given one; None if it is gone or changed."""
        if self.who.scripted:
            return self.world
        from vispeg.learn.coarse_to_fine import open_policy
        from vispeg.learn.envs import home

        try:
            at = home(open_policy(self.who.path))
            load_world(at)
        except UserError as error:
            notes.append(f"the world that it was trained in is not played: {error}")
            return None
        return at


def _arm_with(robot: str, effects: Sequence[EffectInstance]) -> World:
    """Return an arm with those effects that inverse dynamics shows; of several with one label, the last."""
    arm = of_arm(World(effects=tuple({e.label: e for e in effects}.values())))
    return World(robot).add(*(e for e in arm.effects if effect(e.effect).searchable))


def _missing(recordings: Sequence[Recording], world: World) -> list[Missing]:
    return [m for rec in recordings if (m := missing_of(rec, world)) is not None]


def _at_random(remainder: Remainder) -> list[tuple[str, float, float]]:
    """Return (joint, largest RMS, N m, correlation time, s) of random torques that cover the remainder."""
    params = effect("torque_noise").params
    time = float(np.clip(remainder.block / 2, params["time"].low, params["time"].high))
    sizes = remainder.sizes()
    return [
        (s["joint"], min(WIDER * s["rms"], params["rms"].high), time)
        for s in sizes
        if s["rms"] > SMALL * sizes[0]["rms"] and s["rms"] > 0
    ]


def _digest(remainder: Remainder) -> str:
    """Return a digest of a remainder, so that a resumed run can check that it is unchanged."""
    hashed = hashlib.sha256(repr((remainder.joints, remainder.period, remainder.tick)).encode())
    for piece in remainder.pieces:
        hashed.update(np.round(piece, 6).tobytes())
    return hashed.hexdigest()[:12]


def recordings_of(places: Sequence[Path], trials: Sequence[Trial]) -> list[Recording]:
    """Return the held-out recordings; those of the trials if none are named.

    Raises:
        UserError: there is no recording, or it is of another robot than the trials.
    """
    if not places:
        return [t.recording for t in trials]
    found = [load(place) for place in places]
    for rec in found:
        if (rec.robot, rec.joints) != (trials[0].recording.robot, trials[0].recording.joints):
            raise UserError("of another robot than the trials", file=rec.path, expected=trials[0].recording.robot)
    return found


def said(
    record: ExplainRecord,
    played: Sequence[Sequence[Episode]],
    remainder: Remainder | None,
    home_world: str,
    *,
    diagnosis: Mapping[str, Any] | None,
    config: TaskConfig,
    asked: Asked,
    policy: Path | None,
    trials: Sequence[Trial],
    named: Sequence[EffectInstance],
    commands: Mapping[str, str],
) -> None:
    """Add the remainder, the verdict, the cures and the next steps to a record."""
    if remainder is not None and played:
        without, with_it, home, home_random = played
        both = (home, home_random) if home and home_random else None
        record["remainder"] = bridge.replayed(remainder, without, with_it, both, home_world)
    record["bridge"] = bridge.bridge(record["remainder"], diagnosis, signs_of(config))
    training, work = prices.training_of(policy, asked.prices), asked.prices
    trial_s = float(np.median([t.said.outcome.time_s for t in trials]))
    motion = (diagnosis or {}).get("next_experiment")
    together = record["causes"][-1] if record["causes"] else None
    next_motion = motion if isinstance(motion, dict) else None
    recording = prices.recording_step(work, record["left"], trial_s, next_motion, commands.get("record", ""))
    record["steps"] = prices.steps(
        work,
        training,
        recording=recording,
        gap=record["gap"],
        causes=None if together is None else together["cost"],
        remainder=None if record["remainder"] is None else record["remainder"]["cost"],
        trial_s=trial_s,
        commands=commands,
    )
    doubtful = {e.label for e in named if e.partial or e.tentative} | _indistinguishable(diagnosis)
    for cause in record["causes"]:
        unsure = cause["effect"] in doubtful and cause["effect"] != TOGETHER
        cause["cure"] = recording["step"] if unsure else "fine-tune in a world that has it"
        cause["hours"] = recording["hours"] if unsure else training.hours


def _indistinguishable(diagnosis: Mapping[str, Any] | None) -> set[str]:
    """Return the labels of effects that the diagnosis could not distinguish from others."""
    rows = [r for r in (diagnosis or {}).get("effects") or () if isinstance(r, dict)]
    return {f"{r.get('effect')}({r.get('where')})" for r in rows if r.get("indistinguishable_from")}
