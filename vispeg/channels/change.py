"""Find what changed between two states of one robot: empty and loaded, before and after a repair.

The arm's effects are found in the baseline's recordings alone. In the other recordings they are fixed, and effects are
added to them. An effect of the arm has changed, and is fitted anew, if that explains the held-out recordings as well as
one of the added effects does, or significantly better beside them: a change of what is there is simpler than a new
cause. The search is then made again with it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from vispeg.channels import conduct
from vispeg.channels.channel import CHANNELS, Both, Channel, How
from vispeg.core.effect import effect
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.selection.accept import equal, threshold
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.state import without
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.worlds.model_file import placed_dict
from vispeg.worlds.world import World

KEPT = ("verdict", "reason", "effects", "ladder", "noise_floor", "recordings")  # of the baseline's record


def diagnose_change(channels: Sequence[str], world: World, before: Both, both: Both, how: How) -> Diagnosis:
    """Find what `world` lacks in the baseline, then what the other recordings need beyond it.

    The record's `effects` are the change, `baseline` holds what was found in the baseline; the world has both. A
    changed effect of the baseline has its former values as `was`.

    Args:
        channels: names, from `resolve`.
        world: the user's model.
        before: the baseline's fitted and held-out recordings.
        both: those of the robot after the change.
        how: options; `likely` is called with what torques suggest beyond the baseline.

    Raises:
        UserError: as `conduct.diagnose`.
    """
    how.say("the baseline")
    once = replace(how, plan_next=False, likely=lambda record: None, progress=how.progress.part("baseline"))
    arm = conduct.diagnose(channels, world, before, once)
    how.say("what changed")
    changed: frozenset[str] = frozenset()
    while True:
        start = _opened(arm.world, changed)
        found = conduct.diagnose(channels, start, both, replace(how, progress=_part(how, changed)))
        more = next(filter(None, (_changed(CHANNELS[c], start, found, both, how, changed) for c in channels)), "")
        if not more:
            return _told(found, arm)
        how.say(f"{more} has changed")
        changed |= {more}


def _part(how: How, changed: Collection[str]) -> Progress:
    """Return the stored answers of the search in which these effects are fitted anew."""
    return how.progress.part("changed " + ", ".join(sorted(changed))) if changed else how.progress


def _opened(world: World, changed: Collection[str]) -> World:
    """Return the arm with only the `changed` effects marked partial, which a diagnosis fits anew."""
    return replace(world, effects=tuple(replace(e, partial=e.label in changed) for e in world.effects))


def _changed(channel: Channel, start: World, found: Diagnosis, both: Both, how: How, changed: Collection[str]) -> str:
    """Return the label of the effect of the arm that has changed and explains most in a channel; empty if none has.

    `start` is the arm from which the diagnosis `found` searched; its `changed` effects are fitted anew already.
    """
    now = channel.part(found.world)
    had, here = {e.label for e in start.effects}, {e.label for e in now.effects} - set(changed)
    shown = [e.label for e in start.effects if e.label in here and channel.shows(effect(e.effect))]
    if not shown:
        return ""
    how.say(f"{channel.name}: asking whether {', '.join(shown)} changed")
    evidence, judged = channel.evidence(found.world, both, how)
    assert judged is not None  # a diagnosis has recordings to judge on
    # beside all added effects (None), or for one of them
    places = [None, *(e for e in now.effects if e.label not in had)]
    tried = [(label, gone, now if gone is None else without(now, [gone])) for label in shown for gone in places]
    jobs = [fit_job(evidence, world, _free(world, had - {label})) for label, _, world in tried]
    fits, judge = run_together(jobs, evidence.residuals, length=evidence.length), Judge(judged)
    kept, *losses = judge.losses([now, *(f.world for f in fits)])
    gains = [judge.gain(kept, loss) for loss in losses]
    level = threshold([g.z for (_, gone, _), g in zip(tried, gains, strict=True) if gone is None], len(shown))
    passed: list[tuple[bool, float, str]] = []
    for (label, gone, _), loss, gain in zip(tried, losses, gains, strict=True):
        better = gain.relative >= judged.least_gain and (gain.z >= level or judge.apart(gain))
        if better or gone is not None and (loss.sum() <= kept.sum() or equal(judge, loss, kept)):
            passed.append((gone is None, float(loss.sum()), label))
    return min(passed, default=(False, 0.0, ""))[2]


def _free(world: World, fixed: Collection[str]) -> list[int]:
    """Return the indices of the effects whose labels are not among the `fixed` ones."""
    return [k for k, e in enumerate(world.effects) if e.label not in fixed]


def _told(found: Diagnosis, arm: Diagnosis) -> Diagnosis:
    """Return the diagnosis with what was found in the baseline, and the former values of what has changed.

    Effects of the arm that have not changed are marked partial as they were in the baseline.
    """
    had = {e.label: e for e in arm.world.effects}
    rows: list[dict[str, object]] = []
    for row in found.record["effects"]:
        was = had.pop(f"{row['effect']}({row['where']})", None)  # what is left has not changed
        rows.append({**row} if was is None else {**row, "was": placed_dict(was)["params"]})
    effects = tuple(replace(e, partial=had[e.label].partial) if e.label in had else e for e in found.world.effects)
    record = {**found.record, "effects": rows, "baseline": {key: arm.record[key] for key in KEPT}}
    return replace(found, world=replace(found.world, effects=effects), record=record)
