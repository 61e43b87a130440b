"""Which other effects explain the held-out data as well as a chosen one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.localise import joint_z
from vispeg.diagnosis.findings import Rivals, Score, Trial
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.searching import Searching
from vispeg.diagnosis.selection.state import State
from vispeg.diagnosis.selection.together import prior
from vispeg.identify.fit import Fit
from vispeg.worlds.places import ALL

AT_ONCE = 2**30  # bytes of derivatives that fits side by side may hold


def settled(search: Searching, state: State, n_fixed: int, say: Callable[[str], None]) -> list[Rivals]:
    """Rivals of what was accepted, after those of them that are better on held-out data have taken its place."""
    rivals = find_rivals(search, state, n_fixed, say) if len(state.world.effects) > n_fixed else []
    for _ in range(RULES.exchanges):
        better = [(t, r) for r in rivals for t in r.equals if _better(search, state, t, r.label)]
        if not better or len(state.world.effects) - n_fixed < 2:
            break
        trial, rival = min(better, key=lambda at: float(at[0].loss.sum()))
        out = next(e for e in state.world.effects if e.label == rival.label)
        say(f"{trial.score.label} comes in the place of {out.label}")
        swapped = replace(trial, score=replace(trial.score, out=(out,)))
        search.take(state, swapped, [swapped], n_fixed)
        search.go_on(state, n_fixed)  # beside it, something else may pass
        rivals = find_rivals(search, state, n_fixed, say)
    return rivals


def _better(search: Searching, state: State, rival: Trial, label: str) -> bool:
    """Whether a rival belongs in the place of the effect `label`."""
    (accepted,) = [e for e in state.world.effects if e.label == label]
    least = 0.0 if prior(rival.score.placed, accepted) < 1.0 else RULES.exchange
    return search.judge.gain(state.loss, rival.loss).relative >= least


def find_rivals(search: Searching, state: State, n_fixed: int, say: Callable[[str], None]) -> list[Rivals]:
    """Rivals of every accepted effect, all the others kept and refitted."""
    chosen = state.world.effects[n_fixed:]
    if len(chosen) > search.few:
        return _proposed(search, state, n_fixed, say)
    out = []
    for placed in chosen:
        step = _tried(search, state, placed, len(chosen))
        if step is not None:
            without = search.judge.mean(step[0].loss) + step[0].gain.mean
            out.append(_compare(search, state, placed.label, step[1], without))
            continue
        say(f"looking for rivals of {placed.label}")
        (reduced,) = _without(search, state, [placed], n_fixed)
        scores, tested = search.instead(reduced, placed)
        trials = search.try_all(reduced, scores, n_fixed, tested, _goal(search, state)) if scores else []
        out.append(_compare(search, state, placed.label, trials, search.judge.mean(reduced.loss)))
    return out


def _tried(search: Searching, state: State, placed: EffectInstance, count: int) -> tuple[Trial, list[Trial]] | None:
    """Give the step whose candidates were tried in the place of an effect, one of `count`; None where it must be asked
    anew.

    Where a model's form leaves errors that last, what looks alike must be asked for by name.
    """
    if count == len(state.steps) == 1:
        return state.steps[0]
    return state.brought(placed) if search.evidence.alike == 0 else None


def _goal(search: Searching, state: State) -> float | None:
    """Mean squared residual that a rival's fit must come near to, or else it gives up: near what the chosen one leaves.

    None where a model's form leaves errors that last, so that a rival may be as good and leave more.
    """
    if state.fit is None or search.evidence.alike > 0:
        return None
    size = len(state.residual)
    remains, noise = float(state.residual @ state.residual) / size, search.evidence.count / size
    return remains + RULES.rival_far * max(remains - noise, RULES.rival_room)


def _proposed(search: Searching, state: State, n_fixed: int, say: Callable[[str], None]) -> list[Rivals]:
    """Rivals that linear algebra proposes in the place of each of many effects, fitted and judged side by side.

    Where linear algebra does not judge (`_beyond`) the library is screened as well.
    """
    say("asking what may stand in the place of each effect")
    asked = {e.label: e.rivals for e in search.exchanges(state) if e.rivals}
    beyond = _beyond(search, state)
    placed = [e for e in state.world.effects[n_fixed:] if e.label in asked or e.where in beyond]
    # bytes of derivatives, an effect:
    size = (
        8
        * state.residual.size
        * (1 + len(state.world.effects))
        * (1 + 2 * (RULES.rivals_linear + RULES.rivals_screened))
    )
    some, by_label = max(1, AT_ONCE // size), {}
    for start in range(0, len(placed), some):
        part = placed[start : start + some]
        say(f"looking for rivals of {', '.join(e.label for e in part)}")
        reduced = _without(search, state, part, n_fixed)
        tries = []
        for e, beside in zip(part, reduced, strict=True):
            proposed = [Score(r, 0.0) for r in asked.get(e.label, ())]
            screened, tested = search.instead(beside, e) if e.where in beyond else ([], 0)
            scores = {s.key: s for s in (*screened, *proposed[: RULES.rivals_linear])}
            tries.append((beside, list(scores.values()), max(tested, len(proposed))))
        for e, beside, trials in zip(part, reduced, search.try_each(tries, n_fixed, _goal(search, state)), strict=True):
            by_label[e.label] = _compare(search, state, e.label, trials, search.judge.mean(beside.loss))
    return [by_label.get(e.label, Rivals(e.label, (), ())) for e in state.world.effects[n_fixed:]]


def _beyond(search: Searching, state: State) -> set[str]:
    """Places where more than noise is left and linear algebra cannot judge an exchange; none at the noise floor.

    What all joints share, such as a delay, moves the arm by far more than noise: at first order a lag looks alike. In
    the joint that misses most, something may stand in for what has no signature, as friction that grows with load.
    """
    if search.judge.mean(state.loss) - search.judge.floor(state.world) <= RULES.at_floor - 1.0:
        return set()
    worst = int(np.argmax(joint_z(search.missing(state.world))))
    return {ALL, search.evidence.items[0].robot.joints[worst]}


def _without(search: Searching, state: State, gone: Sequence[EffectInstance], n_fixed: int) -> list[State]:
    """Give the state without each of these effects, the others fitted anew with the derivatives that they had."""
    worlds = [state.world.without(e.effect, e.where) for e in gone]
    fits: list[Fit | None] = [None] * len(gone)
    if gone and len(worlds[0].effects) > n_fixed and state.fit is not None:
        fits = [*search.reduced(worlds, n_fixed, [state.derivatives([e]) for e in gone])]
    worlds = [world if fit is None else fit.world for world, fit in zip(worlds, fits, strict=True)]
    bare = search.evidence.residuals(worlds) if None in fits else []
    out = []
    for k, (world, fit, loss) in enumerate(zip(worlds, fits, search.judge.losses(worlds), strict=True)):
        residual = bare[k] if fit is None else fit.residual
        cross = search.cross.loss_of(fit, residual)
        out.append(State(world, loss, residual, fit, state.first, state.steps, cross=cross))
    return out


def merely_richer(judge: Judge, trial: Trial, state: State, label: str) -> bool:
    """Whether a rival contains the chosen effect as a special case and is not better for it."""
    name, where = _parts(label)
    kind = effect(trial.score.placed.effect)
    nested = name in kind.contains and trial.score.placed.where == where
    return nested and judge.gain(state.loss, trial.loss).z < RULES.richer_sigma


def grown_from(judge: Judge, trial: Trial, state: State, label: str) -> bool:
    """Whether the chosen effect grows from a rival at its place, and decisively so: gear play from a rotor's inertia.

    What a rival leaves may be little of all that there was, and yet most of it is mended by what it lacks.
    """
    name, where = _parts(label)
    grows = trial.score.placed.effect in effect(name).grows_from and trial.score.placed.where == where
    gain = judge.gain(trial.loss, state.loss)
    return grows and gain.relative > RULES.decisive and gain.z > stats.norm.isf(RULES.large_level)


def _parts(label: str) -> tuple[str, str]:
    """Effect and place of `effect(place)`."""
    name, _, where = label.rstrip(")").partition("(")
    return name, where


def _compare(search: Searching, state: State, label: str, trials: list[Trial], without: float) -> Rivals:
    others = [t for t in trials if not t.score.beside and t.score.placed.label != label]
    equals = [
        t
        for t in others
        if equal(search.judge, t.loss, state.loss, without, search.evidence.alike, remaining=True)
        and not t.absent
        and t.gain.relative > 0
        and not merely_richer(search.judge, t, state, label)
        and not grown_from(search.judge, t, state, label)
    ]
    return Rivals(label, tuple(t.bare for t in equals), tuple(t.bare for t in others))
