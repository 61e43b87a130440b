"""Rank next steps by what they can gain and the hours that they cost.

A step can gain at most the loss of success that paired replays found. A machine's hours are measured; a person's are
stated by the user. Their defaults follow from the practitioners' article (docs/sources.md): 500 demonstrations in a day
of eight hours take a minute each, a contact task takes 50 to 200 of them, and two hours for an arm of seven joints make
17 minutes per recording.
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
RECORDINGS = 2  # recordings: one to fit, one to judge on


@dataclass(frozen=True)
class Prices:
    """Hours of work for the possible next steps.

    Attributes:
        demonstrations: number to record.
        minutes_per_demonstration: time to set up and do one, min.
        minutes_per_recording: time to set up a recorded motion, min.
        training_hours: duration of fine-tuning, h; None for that in the policy's own training log.
    """

    demonstrations: int = 50
    minutes_per_demonstration: float = 1.0
    minutes_per_recording: float = 17.0
    training_hours: float | None = None

    def check(self) -> None:
        """Raise UserError for a number that is not positive and finite."""
        for name in ("demonstrations", "minutes_per_demonstration", "minutes_per_recording", "training_hours"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise UserError("must be above 0", key=f"--{name.replace('_', '-')}", got=value)


@dataclass(frozen=True)
class Training:
    """Hours of a training (None where not known), and a phrase on where the number comes from."""

    hours: float | None
    source: str


def training_of(policy: Path | None, prices: Prices) -> Training:
    """Return the hours of training: as stated, else measured from progress.csv of the policy's run."""
    if prices.training_hours is not None:
        return Training(prices.training_hours, f"{prices.training_hours:g} h of training, stated")
    # a run keeps its policies in checkpoints/NAME
    for folder in () if policy is None else (policy, *policy.parents[:2]):
        log = folder / "progress.csv"
        if log.is_file():
            try:
                with log.open(encoding="utf-8", newline="") as file:
                    seconds = [float(row["seconds"]) for row in csv.DictReader(file)]
            except (OSError, ValueError, KeyError, TypeError):
                continue
            hours = max(seconds, default=0.0) / HOUR
            if 0.0 < hours < float("inf"):  # else it was not measured
                return Training(hours, f"{hours:.3g} h of training, as {log.name} measured")
    return Training(None, "the policy's training time is not known: --training-hours states it")


def recording_step(
    prices: Prices, left: Interval, trial_s: float, motion: Mapping[str, Any] | None, command: str
) -> Step:
    """Return the step that records a motion and diagnoses it.

    Args:
        prices: hours of a person's work.
        left: success from the trials' starts in a simulation with all causes minus that of the robot.
        trial_s: median duration of a trial, s.
        motion: `next_experiment` of the diagnosis, or None.
        command: what records it; empty if there is none.
    """
    seconds = float((motion or {}).get("duration_s") or trial_s)
    name = str((motion or {}).get("motion") or "a motion in free air")
    hours = RECORDINGS * (prices.minutes_per_recording * MINUTE + seconds) / HOUR
    source = f"{RECORDINGS} recordings of {seconds:.0f} s, {prices.minutes_per_recording:g} min of setup each (stated)"
    return _step(f"record {name}, diagnose", left, hours, source, command)


def steps(
    prices: Prices,
    training: Training,
    *,
    recording: Step,
    gap: Interval,
    causes: Interval | None,
    remainder: Interval | None,
    trial_s: float,
    commands: Mapping[str, str],
) -> list[Step]:
    """Return the next steps, ordered by gain per hour; steps of unknown hours come last.

    Args:
        prices: hours of a person's work.
        training: hours of fine-tuning.
        recording: the step of a further recording, `recording_step`.
        gap: success from the trials' starts in simulation minus that of the robot.
        causes: loss of success due to all causes together; None if there are none.
        remainder: loss of success due to the unexplained torque; None if not played.
        trial_s: median duration of a trial, s.
        commands: command of each of `demonstrations`, `causes` and `remainder`, where there is one.
    """
    made = [recording]
    each = max(prices.minutes_per_demonstration, trial_s / MINUTE)  # min
    hours, source = prices.demonstrations * each / MINUTE, f"{prices.demonstrations} of {each:.2g} min (stated)"
    if training.hours is None:
        source += "; training not counted, its time is not known"
    else:
        hours, source = hours + training.hours, f"{source}; {training.source}"
    step = f"{prices.demonstrations} demonstrations on the robot, fine-tune"
    made.append(_step(step, gap, hours, source, commands.get("demonstrations", "")))
    for kind, lost, step in (
        ("causes", causes, "fine-tune in a world with the causes"),
        ("remainder", remainder, "train with as much random torque as is unexplained"),
    ):
        if lost is not None:
            made.append(_step(step, lost, training.hours, training.source, commands.get(kind, "")))
    return ranked(made)


def _step(step: str, gain: Interval, hours: float | None, source: str, command: str) -> Step:
    points = max(gain["value"] or 0.0, 0.0)
    return {
        "step": step,
        "gain": gain,
        "hours": hours,
        "hours_from": source,
        "an_hour": None if hours is None else points / hours,
        "command": command,
    }


def ranked(made: Sequence[Step]) -> list[Step]:
    """Return the steps ordered by gain per hour; those without one come last, ordered by gain."""

    def key(s: Step) -> tuple[bool, float, float]:
        gain = (s["gain"] or {}).get("value") or 0.0
        return s["an_hour"] is None, -(s["an_hour"] or 0.0), -float(gain)

    return sorted(made, key=key)
