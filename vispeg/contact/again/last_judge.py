"""Check a verdict by simulating an insertion again: if the model's outcome differs, an effect is missing.

It is used only if the arm alone follows its measured path, since an error of the arm is no evidence on contact.
Trajectories diverge where contacts begin and end, so even the correct model's peak force is slightly off, and
uncertain parameters may change it more. The verdict is changed only if no values within the intervals come near the
measured outcome.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vispeg.contact.again.closed_loop import closed_loop
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Verdict, left_unexplained
from vispeg.diagnosis.schema import Replayed, Trial
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World


def judged(
    verdict: Verdict,
    replayed: Sequence[Replayed],
    held_out: Sequence[Recording],
    world: World,
    n_fixed: int,
    threads: int,
) -> Verdict:
    """Change a verdict to `unexplained` if no simulation of the corrected model comes near the measured insertion.

    It is simulated at its values, and with each value in turn at either end of its interval.

    Args:
        verdict: the verdict by the wrench along the measured path.
        replayed: result of `closed_loop`, with the corrected model as its last trial.
        held_out: the recordings that it simulated.
        world: the corrected model.
        n_fixed: number of effects given by the user.
        threads: threads of the simulation.
    """
    if verdict.verdict == "unexplained":
        return verdict
    for row in replayed:
        measured, (name, last) = row["trials"]["measured"], list(row["trials"].items())[-1]
        if last.get("free_off", np.inf) > RULES.arm_free or alike(measured, [last]):
            continue
        source = [r for r in held_out if r.name == row["recording"]]
        ends, _ = closed_loop(source, {str(k): w for k, w in enumerate(at_ends(world, n_fixed))}, threads)
        others = [trial for end in ends for key, trial in end["trials"].items() if key != "measured"]
        if alike(measured, [last, *others]):
            continue
        text = (
            f"{row['recording']} in closed loop: peak {last['peak_force']:.1f} N and {last['outcome']} in the {name} "
            f"model, {measured['peak_force']:.1f} N and {measured['outcome']} measured, which no known effect explains"
        )
        return left_unexplained(text)
    return verdict


def alike(measured: Trial, runs: Sequence[Trial]) -> bool:
    """Return whether a run ends as the measured one did, and the measured peak force lies within those of the runs."""
    peaks = [run["peak_force"] for run in runs]
    off = max(RULES.peak_share * measured["peak_force"], RULES.peak_least)
    ended = any((run["outcome"] == "success") == (measured["outcome"] == "success") for run in runs)
    return ended and min(peaks) - off <= measured["peak_force"] <= max(peaks) + off


def at_ends(world: World, n_fixed: int) -> Iterator[World]:
    """Yield worlds with one value at one end of its interval."""
    for k, placed in enumerate(world.effects[n_fixed:], n_fixed):
        for name, value in placed.params.items():
            for end in {value.low, value.high} - {value.value}:
                if end is not None:
                    moved = placed.with_values(**{name: end})
                    yield replace(world, effects=(*world.effects[:k], moved, *world.effects[k + 1 :]))
