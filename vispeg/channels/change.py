"""Find what changed between two states of one robot: empty and loaded, before and after a repair.

The arm's effects are found in the baseline's recordings alone. In the other recordings they are fixed, and effects are
added to them. An effect of the arm has changed, and is fitted anew, if that explains the held-out recordings as well as
one of the added effects does, or significantly better beside them: a change of what is there is simpler than a new
cause. The search is then made again with it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from vispeg.channels import conduct
from vispeg.channels.channel import CHANNELS, Both, Channel, How
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.params import Value
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.selection.accept import equal, threshold
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.state import without
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
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


def _part(how: How, changed: Collection[str]):
    """Return the stored answers of the search in which these effects are fitted anew."""
    return how.progress.part("changed " + ", ".join(sorted(changed))) if changed else how.progress


def _opened(world: World, changed: Collection[str]) -> World:
    """Return the arm with only the `changed` effects marked partial, which a diagnosis fits anew."""
    return replace(world, effects=tuple(replace(e, partial=e.label in changed) for e in world.effects))


@dataclass(frozen=True)
class _Tried:
    """An effect of the arm that is fitted anew, in the place of an added one (`instead`) or beside all (None)."""

    label: str
    instead: str | None
    world: World


def _changed(channel: Channel, start: World, found: Diagnosis, both: Both, how: How, changed: Collection[str]) -> str:
    """Return the label of the effect of the arm that has changed and explains most in a channel; empty if none has.

    `start` is the arm from which the diagnosis `found` searched; its `changed` effects are fitted anew already.
    """
    shown = [e for e in start.effects if channel.shows(effect(e.effect)) and e.label not in changed]
    now = channel.part(found.world)
    shown = [e for e in shown if e.label in {a.label for a in now.effects}]
    if not shown:
        return ""
    how.say(f"{channel.name}: asking whether {', '.join(e.label for e in shown)} changed")
    evidence, judged = channel.evidence(found.world, both, how)
    assert judged is not None  # a diagnosis has recordings to judge on
    tried, judge = list(_alternatives(now, start, shown)), Judge(judged)
    jobs = [fit_job(evidence, t.world, _free(t.world, start, t.label)) for t in tried]
    fits = run_together(jobs, evidence.residuals, length=evidence.length)
    kept, *losses = judge.losses([now, *(f.world for f in fits)])
    gains = [judge.gain(kept, loss) for loss in losses]
    level = threshold([g.z for t, g in zip(tried, gains, strict=True) if t.instead is None], len(shown))
    passed: list[tuple[bool, float, str]] = []
    for t, loss, gain in zip(tried, losses, gains, strict=True):
        better = gain.relative >= judged.least_gain and (gain.z >= level or judge.apart(gain))
        if better or t.instead is not None and (loss.sum() <= kept.sum() or equal(judge, loss, kept)):
            passed.append((t.instead is None, float(loss.sum()), t.label))
    return min(passed, default=(False, 0.0, ""))[2]


def _alternatives(now: World, start: World, shown: Sequence[EffectInstance]) -> Iterator[_Tried]:
    """Yield the models in which one of the effects `shown` is fitted anew, beside the added ones or for one of them."""
    had = {e.label for e in start.effects}
    added = [e for e in now.effects if e.label not in had]
    for e in shown:
        yield _Tried(e.label, None, now)
        for a in added:
            yield _Tried(e.label, a.label, without(now, [a]))


def _free(world: World, start: World, label: str) -> list[int]:
    """Return the indices of the effect `label` and of those that `start` lacks."""
    had = {e.label for e in start.effects} - {label}
    return [k for k, e in enumerate(world.effects) if e.label not in had]


def _told(found: Diagnosis, arm: Diagnosis) -> Diagnosis:
    """Return the diagnosis with what was found in the baseline, and the former values of what has changed.

    Effects of the arm that have not changed are marked partial as they were in the baseline.
    """
    had: Mapping[str, EffectInstance] = {e.label: e for e in arm.world.effects}
    rows = [{**row, **_was(had.get(f"{row['effect']}({row['where']})"))} for row in found.record["effects"]]
    change = {f"{row['effect']}({row['where']})" for row in rows}
    effects = tuple(
        replace(e, partial=had[e.label].partial) if e.label in had and e.label not in change else e
        for e in found.world.effects
    )
    record = {**found.record, "effects": rows, "baseline": {key: arm.record[key] for key in KEPT}}
    return replace(found, world=replace(found.world, effects=effects), record=record)


def _was(placed: EffectInstance | None) -> dict[str, dict[str, dict[str, float | None]]]:
    """Return the former values of an effect as the record has them; nothing for one that is new."""
    if placed is None:
        return {}
    return {"was": {name: _ends(v) for name, v in placed.params.items()}}


def _ends(v: Value) -> dict[str, float | None]:
    return {"value": v.value, "low": v.low, "high": v.high}
