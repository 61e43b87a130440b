"""Find what changed between two states of one robot: empty and loaded, before and after a repair.

The effects of the arm are found in the baseline's recordings alone, and stay fixed. The effects of the change are
found in the other recordings, added to those of the arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from vispeg.core.errors import UserError
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import Diagnosis, diagnose
from vispeg.diagnosis.schema import ProposalRecord
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World

KEPT = (
    "verdict",
    "reason",
    "effects",
    "ladder",
    "noise_floor",
    "recordings",
)  # of the baseline's record


def diagnose_change(
    world: World,
    baseline: Sequence[Recording],
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    seed: int = 0,
    nthread: int = 2,
    say: Callable[[str], None] = lambda _: None,
    likely: Callable[[ProposalRecord], None] = lambda _: None,
    plan_next: bool = True,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find what `world` lacks in the baseline, then what the other recordings need beyond it.

    The record's `effects` are the change, `baseline` holds what was found in the baseline; the world has both.

    Args:
        world: the user's model.
        baseline: recordings of the robot before the change, two or more; the last one is held out.
        fitted, held_out: recordings of the robot after the change.
        seed, nthread, say, plan_next, progress: as in `diagnose`.
        likely: called with the effects that torques suggest beyond the baseline.

    Raises:
        UserError: fewer than two recordings of the baseline; as `diagnose`.
    """
    if len(baseline) < 2:
        message = "one recording of the baseline is fitted, so another must judge"
        raise UserError(message, key="--baseline", expected="two or more", got=len(baseline))
    both = progress or Progress()  # one file for both diagnoses; the baseline's answers are a part of their own
    options = {"seed": seed, "nthread": nthread, "say": say}
    say("the baseline")
    arm = diagnose(world, baseline[:-1], baseline[-1:], plan_next=False, progress=both.part("baseline"), **options)
    say("what changed")
    marked = {e.label: e for e in arm.world.effects}
    # without the mark `partial` (accepted although error remained), as `diagnose` would refit marked effects
    held = replace(arm.world, effects=tuple(replace(e, partial=False) for e in arm.world.effects))
    change = diagnose(held, fitted, held_out, plan_next=plan_next, likely=likely, progress=both, **options)
    effects = tuple(
        replace(e, partial=marked[e.label].partial) if e.label in marked else e for e in change.world.effects
    )
    return replace(
        change,
        world=replace(change.world, effects=effects),
        record=change.record | {"baseline": {key: arm.record[key] for key in KEPT}},
    )
