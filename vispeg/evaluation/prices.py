"""Next steps by what they can gain and the hours that they cost.

A gain is what a paired replay says is lost, all of which the step would win back at most. Hours of a machine are
measured; those of a person are stated by whoever asks. Their defaults follow from the article of practitioners (see
docs/sources.md): 500 demonstrations in a day of eight hours are a minute each, a contact task takes 50 to 200 of them,
and two hours for the joints of an arm of seven are 17 minutes a recording.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.evaluation.schema.estimate import Interval
from vispeg.evaluation.schema.explain import Step

HOUR, MINUTE = 3600.0, 60.0
TWICE = 2  # a recording to fit, one to judge on


@dataclass(frozen=True)
class Prices:
    """Hours of work for the possible next steps.

    Attributes:
        demonstrations: number that would be recorded.
        minutes_per_demonstration: setting up and doing one, min.
        minutes_per_recording: setting up a motion, min.
        training_hours: duration of fine-tuning, h; None: from the policy's own training log.
    """

    demonstrations: int = 50
    minutes_per_demonstration: float = 1.0
    minutes_per_recording: float = 17.0
    training_hours: float | None = None

    def check(self) -> None:
        """Raise UserError for a number that cannot be."""
        for name in ("demonstrations", "minutes_per_demonstration", "minutes_per_recording", "training_hours"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise UserError("must be above 0", key=f"--{name.replace('_', '-')}", got=value)


@dataclass(frozen=True)
class Training:
    """Hours of a training, and where the number is from; None where nothing says it."""

    hours: float | None
    source: str


def training_of(policy: Path | None, prices: Prices) -> Training:
    """Return the hours of training: as stated, else measured from progress.csv of the policy's run."""
    if prices.training_hours is not None:
        return Training(prices.training_hours, f"{prices.training_hours:g} h of training, stated")
    for folder in () if policy is None else (policy, *policy.parents[:2]):
        log = folder / "progress.csv"
        if log.is_file():
            try:
                with log.open(encoding="utf-8", newline="") as file:
                    seconds = [float(row["seconds"]) for row in csv.DictReader(file)]
            except (OSError, ValueError, KeyError, TypeError):
                continue
            if seconds:
                return Training(max(seconds) / HOUR, f"{max(seconds) / HOUR:.2g} h of training, as {log.name} measured")
    return Training(None, "the policy's training time is not known: --training-hours states it")


def steps(
    prices: Prices,
    training: Training,
    *,
    gap: Interval,
    left: Interval,
    causes: Interval | None,
    remainder: Interval | None,
    trial_s: float,
    motion: Mapping[str, Any] | None,
    commands: Mapping[str, str],
) -> list[Step]:
    """Give the next steps, the one first that gains most an hour; those without a price last.

    Args:
        prices: of a person's work.
        training: of fine-tuning.
        gap: success from the trials' starts in simulation less that of the robot.
        left: the same with all causes in simulation.
        causes: what all causes cost together; None: there are none.
        remainder: what the unexplained torque costs; None: not played.
        trial_s: median length of a trial, s.
        motion: `next_experiment` of the diagnosis.
        commands: of `record`, `demonstrations`, `causes` and `remainder`, where there is one.
    """
    seconds = float((motion or {}).get("duration_s") or trial_s)
    name = str((motion or {}).get("motion") or "a motion in free air")
    hours = TWICE * (prices.minutes_per_recording * MINUTE + seconds) / HOUR
    said = f"{TWICE} recordings of {seconds:.0f} s, {prices.minutes_per_recording:g} min of setup each (stated)"
    made = [_step(f"record {name}, diagnose", left, hours, said, commands.get("record", ""))]
    each = max(prices.minutes_per_demonstration, trial_s / MINUTE)
    work, said = prices.demonstrations * each / MINUTE, f"{prices.demonstrations} of {each:.2g} min (stated)"
    if training.hours is None:
        said += "; training not counted, its time is not known"
    else:
        work, said = work + training.hours, f"{said}; {training.source}"
    step = f"{prices.demonstrations} demonstrations on the robot, fine-tune"
    made.append(_step(step, gap, work, said, commands.get("demonstrations", "")))
    for kind, lost, step in (
        ("causes", causes, "fine-tune in a world with the causes"),
        ("remainder", remainder, "train with what remains as a random torque"),
    ):
        if lost is not None:
            made.append(_step(step, lost, training.hours, training.source, commands.get(kind, "")))
    return ranked(made)


def _step(step: str, gain: Interval, hours: float | None, source: str, command: str) -> Step:
    most = max(gain["value"] or 0.0, 0.0)
    return {
        "step": step,
        "gain": gain,
        "hours": hours,
        "hours_from": source,
        "an_hour": None if hours is None else most / hours,
        "command": command,
    }


def ranked(made: Sequence[Step]) -> list[Step]:
    """Order steps by what they gain an hour; those of which that is not known last, the greatest gain first."""

    def key(s: Step) -> tuple[bool, float, float]:
        gain = (s["gain"] or {}).get("value") or 0.0
        return s["an_hour"] is None, -(s["an_hour"] or 0.0), -float(gain)  # type: ignore[arg-type]

    return sorted(made, key=key)
