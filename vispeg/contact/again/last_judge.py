"""Check a verdict by simulating an insertion again: if the model's outcome differs, the model lacks something.

It judges where the arm by itself is known to go as it was measured: what an arm lacks is no evidence of contact.
Paths part where contacts come and go, so that the right model's peak force is off a little, and what is uncertain may
move it more. A verdict falls only where no value within the intervals comes near what was measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vispeg.contact.again.closed_loop import closed_loop
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Verdict
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
    """`unexplained` in place of a verdict where no run of the corrected model, at either end of an interval or between
    them, comes near the measured one.

    Args:
        verdict: by the wrench along the measured path.
        replayed: of `closed_loop`: the last trial is the corrected model's.
        held_out: the recordings that it ran again.
        world: the corrected model.
        n_fixed: effects that it was given.
        threads: of the simulation.
    """
    if verdict.verdict == "unexplained":
        return verdict
    for row in replayed:
        measured, (name, last) = row["trials"]["measured"], list(row["trials"].items())[-1]
        if last.get("free_off", np.inf) > RULES.arm_free or alike(measured, [last]):
            continue
        of = [r for r in held_out if r.name == row["recording"]]
        ends, _ = closed_loop(of, {str(k): w for k, w in enumerate(at_ends(world, n_fixed))}, threads)
        others = [trial for end in ends for key, trial in end["trials"].items() if key != "measured"]
        if alike(measured, [last, *others]):
            continue
        text = (
            f"{row['recording']} in closed loop: peak {last['peak_force']:.1f} N and {last['outcome']} in the {name} "
            f"model, {measured['peak_force']:.1f} N and {measured['outcome']} measured, which no known effect explains"
        )
        return Verdict("unexplained", text, {"depends_on": [], "text": text}, partial=True)
    return verdict


def alike(measured: Trial, runs: Sequence[Trial]) -> bool:
    """Return whether a run ends as the measured one did, and the measured peak force lies within those of the runs."""
    peaks = [run["peak_force"] for run in runs]
    off = max(RULES.peak_share * measured["peak_force"], RULES.peak_least)
    ended = any((run["outcome"] == "success") == (measured["outcome"] == "success") for run in runs)
    return ended and min(peaks) - off <= measured["peak_force"] <= max(peaks) + off


def at_ends(world: World, n_fixed: int) -> Iterator[World]:
    """Worlds with one value at one end of its interval."""
    for k, placed in enumerate(world.effects[n_fixed:], n_fixed):
        for name, value in placed.params.items():
            for end in {value.low, value.high} - {value.value}:
                if end is not None:
                    moved = placed.with_values(**{name: end})
                    yield replace(world, effects=(*world.effects[:k], moved, *world.effects[k + 1 :]))
