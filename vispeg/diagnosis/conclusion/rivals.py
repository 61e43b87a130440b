"""Find the rivals of accepted effects: other effects in their place, fitted and judged on the same recordings.

Rivals that explain the held-out data as well are the effect's equals; then the recordings cannot tell which is true.
The accepted effects are `State.added`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect, searchable
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.localise import joint_z
from vispeg.diagnosis.findings import Rivals, Score, Trial
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.prune import prune
from vispeg.diagnosis.selection.searching import Fitting, Searching
from vispeg.diagnosis.selection.state import State
from vispeg.diagnosis.selection.together import prior
from vispeg.diagnosis.selection.tries import try_each
from vispeg.identify.fit import Fit, Race
from vispeg.worlds.places import ALL

AT_ONCE = 2**30  # bytes of residuals and derivatives that concurrent fits may hold


def replaced(search: Searching, state: State) -> bool:
    """Replace an effect by a clearly better or likelier rival; return whether it was. What was replaced stays out.

    The rivals of all accepted effects are left in the state.
    """
    state.rivals = find_rivals(search, state, search.say)
    better = [(t, r) for r in state.rivals for t in r.equals if _better(search, state, t, r.label)]
    if not better or len(state.added) < 2:
        return False
    trial, rival = min(better, key=lambda at: float(at[0].loss.sum()))
    search.say(f"{trial.score.label} replaces {rival.label}")
    _put_in(search, state, trial, rival.label)
    state.replaced |= {rival.label}
    return True


def _put_in(search: Searching, state: State, rival: Trial, label: str) -> None:
    """Put a rival in the place of the effect `label`, and remove the effects that it makes superfluous.

    The gain of this step is over the model with that effect; the rival's own is over the model without it.
    """
    (accepted,) = [e for e in state.world.effects if e.label == label]
    gain = search.judge.gain(state.loss, rival.loss)
    step = replace(rival, score=replace(rival.score, out=(accepted,)), gain=gain, rejected="")
    search.take(state, step, [step])
    prune(search, state)


def _better(search: Searching, state: State, rival: Trial, label: str) -> bool:
    """Return whether a rival should replace the effect `label`: it is better, or likelier a priori and no worse.

    Neither of the two may have been replaced before, or the search would never end.
    """
    if not state.replaced.isdisjoint({rival.score.placed.label, label}):
        return False
    (accepted,) = [e for e in state.world.effects if e.label == label]
    likelier = prior(rival.score.placed, accepted) < 1.0
    least = 0.0 if likelier else RULES.exchange
    return search.judge.gain(state.loss, rival.loss).relative >= least


def find_rivals(search: Searching, state: State, say: Callable[[str], None]) -> list[Rivals]:
    """Find the rivals of every accepted effect of joints.

    Up to `rivals_full` effects, the library is screened for each (`rivals_of_each`). Beyond, the linear model proposes
    the rivals (`_proposed`).
    """
    few = len(state.added) <= RULES.rivals_full
    return (rivals_of_each if few else _proposed)(search, state, say)


def rivals_of_each(search: Fitting, state: State, say: Callable[[str], None]) -> list[Rivals]:
    """Find the rivals of every accepted effect, with all other effects kept and refitted, by screening the library."""
    chosen, alike = state.added, search.evidence.alike  # see `Evidence.alike`
    out = []
    for placed in chosen:
        step = _tried(search, state, placed, len(chosen))
        if step is not None:
            without = search.judge.mean(step[0].loss) + step[0].gain.mean
            out.append(compared(search.judge, state, placed.label, step[1], without, alike))
            continue
        say(f"looking for rivals of {placed.label}")
        (reduced,) = _without(search, state, [placed])
        scores, tested = search.instead(reduced, placed)
        trials = search.try_all(reduced, scores, tested, _goal(search, state)) if scores else []
        out.append(compared(search.judge, state, placed.label, trials, search.judge.mean(reduced.loss), alike))
    return out


def _tried(search: Fitting, state: State, placed: EffectInstance, count: int) -> tuple[Trial, list[Trial]] | None:
    """Return the step of the search in which the rivals of an effect were tried already; None if they must be tried.

    `count` is the number of accepted effects. If the model's form leaves correlated errors (`Evidence.alike`), rivals
    are tried anew, unless the search had one step only.
    """
    single = count == len(state.steps) == 1
    return state.step_that_added(placed, grouped=single) if single or search.evidence.alike == 0 else None


def _goal(search: Fitting, state: State) -> float | None:
    """Return the mean squared residual that a rival's fit must be able to reach, else it stops early.

    A fit with more is far behind that of the accepted effect. None, for no early stop, if nothing is fitted, or if the
    model's form leaves correlated errors, because a rival may then be an equal although it leaves more.
    """
    if state.fit is None or search.evidence.alike > 0:
        return None
    return Race().far_behind(search.evidence.chi2(state.residual))


def _proposed(search: Searching, state: State, say: Callable[[str], None]) -> list[Rivals]:
    """Return the rivals of each of many effects: those that the linear model proposes, fitted and judged in batches.

    At places where the linear model cannot judge (`_beyond`), the library is screened as well.
    """
    say("screening for rivals of each effect")
    asked = {e.label: e.rivals for e in search.exchanges(state) if e.rivals}
    beyond, alike = _beyond(search, state), search.evidence.alike
    placed = [e for e in state.added if e.label in asked or e.where in beyond]
    batch, by_label = max(1, AT_ONCE // _bytes(search, state)), {}
    for start in range(0, len(placed), batch):
        part = placed[start : start + batch]
        say(f"looking for rivals of {', '.join(e.label for e in part)}")
        reduced = _without(search, state, part)
        tries = []
        for e, without in zip(part, reduced, strict=True):
            proposed = [Score(r, 0.0) for r in asked.get(e.label, ())]
            screened, tested = search.instead(without, e) if e.where in beyond else ([], 0)
            scores = {s.key: s for s in (*screened, *proposed)}
            tries.append((without, list(scores.values()), max(tested, len(proposed))))
        found = try_each(search, tries, _goal(search, state))
        for e, without, trials in zip(part, reduced, found, strict=True):
            by_label[e.label] = compared(search.judge, state, e.label, trials, search.judge.mean(without.loss), alike)
    return [by_label.get(e.label, Rivals(e.label, (), ())) for e in state.added]


def _bytes(search: Searching, state: State) -> int:
    """Return the most bytes of residuals and derivatives that the fits of one effect's rivals hold at a time.

    They share the derivatives to the other effects' coordinates; each has its residual and its derivatives to the
    rival's own coordinates at two points (`Point.evaluated`).
    """
    shared = 1 if state.fit is None else 1 + len(state.fit.u)
    own = 1 + max(len(kind.params) for kind in searchable().values() if search.evidence.sees(kind))
    return 8 * state.residual.size * (shared + 2 * (RULES.name_class + RULES.fitted) * own)


def _beyond(search: Searching, state: State) -> set[str]:
    """Return the places where the linear model cannot judge an exchange: `all`, and the joint with the largest error.

    Empty if the error is at the noise floor. An effect shared by all joints moves the arm by far more than noise, where
    the linear model does not hold: to first order a delay looks like a lag. In the joint with the largest error, an
    effect may imitate one without a signature, such as load-dependent friction.
    """
    if search.judge.excess(state.world, state.loss) <= RULES.at_floor - 1.0:
        return set()
    worst = int(np.argmax(joint_z(search.missing(state.world))))
    return {ALL, search.evidence.items[0].robot.joints[worst]}


def _without(search: Fitting, state: State, gone: Sequence[EffectInstance]) -> list[State]:
    """Return for each of these effects the state without it, the others refitted with their previous derivatives."""
    worlds = [state.world.without(e.effect, e.where) for e in gone]
    fits: list[Fit | None] = [None] * len(gone)
    if gone and len(worlds[0].effects) > state.n_fixed and state.fit is not None:
        fits = [*search.reduced(worlds, state.n_fixed, [state.derivatives([e]) for e in gone])]
    worlds = [world if fit is None else fit.world for world, fit in zip(worlds, fits, strict=True)]
    bare = search.evidence.residuals(worlds) if None in fits else []
    out = []
    for k, (world, fit, loss) in enumerate(zip(worlds, fits, search.judge.losses(worlds), strict=True)):
        residual = bare[k] if fit is None else fit.residual
        cross = search.cross.loss_of(fit, residual)
        out.append(State(world, loss, residual, state.n_fixed, fit, state.first, state.steps, cross=cross))
    return out


def merely_richer(judge: Judge, trial: Trial, state: State, label: str) -> bool:
    """Return whether a rival contains the accepted effect `label` as a special case without being clearly better."""
    name, where = _parts(label)
    kind = effect(trial.score.placed.effect)
    nested = name in kind.contains and trial.score.placed.where == where
    return nested and judge.gain(state.loss, trial.loss).z < RULES.richer_sigma


def grown_from(judge: Judge, trial: Trial, state: State, label: str) -> bool:
    """Return whether the accepted effect `label` extends a rival at its place, as backlash extends a rotor's inertia.

    It must remove most of the error that the rival leaves, even if that is little of the original error.
    """
    name, where = _parts(label)
    grows = trial.score.placed.effect in effect(name).grows_from and trial.score.placed.where == where
    gain = judge.gain(trial.loss, state.loss)
    return grows and gain.relative > RULES.decisive and gain.z > stats.norm.isf(RULES.level)


def _parts(label: str) -> tuple[str, str]:
    """Split `effect(place)` into effect and place."""
    name, _, where = label.rstrip(")").partition("(")
    return name, where


def compared(
    judge: Judge,
    state: State,
    label: str,
    trials: Sequence[Trial],
    without: float,
    alike: float = 0.0,
    remaining: bool = True,
) -> Rivals:
    """Return the rivals of the effect `label` among trials in its place. A group of effects is no rival.

    `without` is the held-out mean squared residual without the effect; `alike` and `remaining` are as in `equal`.
    """
    others = [t.bare for t in trials if not t.score.beside and t.score.placed.label != label]
    equals = [
        t
        for t in others
        if equal(judge, t.loss, state.loss, without, alike, remaining)
        and not t.absent
        and t.gain.relative > 0
        and not merely_richer(judge, t, state, label)
        and not grown_from(judge, t, state, label)
    ]
    return Rivals(label, tuple(equals), tuple(others))
