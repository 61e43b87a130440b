"""Refine simple laws to richer ones that contain them as a special case, in all joints at once.

An example is dry friction, refined to friction with presliding. In a single joint a refinement is too small to be
distinguished from the error of the model's form. The gears of one arm are alike, so all joints are refined together, as
one candidate with one test. In joints where the refinement hardly matters the simple law is restored. Effects whose
richer form has other parameters are refined one by one when they are added (`grow`). The first `n_fixed` effects of a
world are not fitted.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy import stats

from vispeg.core.effect import Effect, EffectInstance, effect, searchable
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.dictionary import null_of
from vispeg.diagnosis.evidence.localise import joint_data
from vispeg.diagnosis.findings import Score, Trial
from vispeg.diagnosis.selection.bic import bic_gain
from vispeg.diagnosis.selection.cross import reduced
from vispeg.diagnosis.selection.judge import present
from vispeg.diagnosis.selection.searching import Searching
from vispeg.diagnosis.selection.state import State, without
from vispeg.identify.fit import Chase, Race, squares
from vispeg.worlds.world import World


def refined(search: Searching, state: State) -> bool:
    """Refine the first simple law whose refinement passes the test; return whether one was refined."""
    excess = search.judge.excess(state.world, state.loss)
    for simple, kind in laws(search, state.world, state.n_fixed):
        removed = _removed(search, state, simple)
        if excess < RULES.refinement * removed:
            continue
        starts = _starts(search, state, simple, kind)
        trial = _fitted(search, state, simple, starts)
        crossed = state.cross, search.cross.loss_of(trial.fit, trial.fit.residual)
        tested = search.judge.gain(state.loss, trial.loss, crossed)
        if (
            trial.gain.mean < RULES.refinement * removed
            or tested.z < stats.norm.isf(RULES.discoveries)
            or trial.gain.z < stats.norm.isf(RULES.level)
            or bic_gain(search.evidence, state.world, state.residual, trial.fit) <= 0
        ):
            continue
        joints = list(search.evidence.items[0].robot.joints)
        visible = [e for e in simple if trial.gain.joints[joints.index(e.where)] >= search.evidence.least_gain]
        if visible and len(visible) < len(simple):
            by_joint = {e.where: e for e in trial.fit.world.effects if e.effect == kind.name}
            trial = _fitted(search, state, visible, [[by_joint[e.where] for e in visible]])
        search.say(f"{trial.score.label} in the place of {simple[0].effect}")
        state.steps.append((trial.bare, [trial.bare]))
        state.take(trial.fit, trial.loss)
        state.cross = search.cross.loss_of(trial.fit, trial.fit.residual)
        return True
    return False


def laws(search: Searching, world: World, n_fixed: int) -> Iterator[tuple[list[EffectInstance], Effect]]:
    """Yield each simple law that several joints of a world have, with each richer kind that the evidence can show.

    A richer kind contains the law and has magnitudes of the same names. Joints that have it already are left out.
    """
    for name in dict.fromkeys(e.effect for e in world.effects[n_fixed:] if effect(e.effect).family == "joint"):
        simple = [e for e in world.effects[n_fixed:] if e.effect == name]
        taken = {(e.effect, e.where) for e in world.effects}
        for kind in searchable().values():
            same = name in kind.contains and set(effect(name).magnitudes) == set(kind.magnitudes)
            free = [e for e in simple if (kind.name, e.where) not in taken]
            if same and search.evidence.sees(kind) and len(free) > 1:
                yield free, kind


def _removed(search: Searching, state: State, simple: list[EffectInstance]) -> float:
    """Return by how much these effects lower the mean squared whitened residual of the fitted recordings, predicted."""
    fit = state.fit
    assert fit is not None
    labels = {e.label for e in simple}
    out = [i for i, a in enumerate(fit.space.axes) if fit.world.effects[a.index].label in labels]
    judge, (_, residual, _) = search.cross.judge, reduced(fit, out, null_of(fit))
    return judge.mean(judge.loss(residual)) - judge.mean(judge.loss(fit.residual))


def _starts(search: Searching, state: State, simple: list[EffectInstance], kind: Effect) -> list[list[EffectInstance]]:
    """Return starts of the refined law in all joints: the simple one's magnitudes, with each of the guessed shapes."""
    data = joint_data(search.missing(state.world), search.evidence.items)
    joints = list(search.evidence.items[0].robot.joints)
    guesses = [kind.guesses(data[joints.index(e.where)]) or [{}] for e in simple]
    shapes = [[{k: v for k, v in g.items() if kind.params[k].shape} for g in options] for options in guesses]
    out = []
    for n in range(max(map(len, shapes))):
        placed = zip(simple, (options[min(n, len(options) - 1)] for options in shapes), strict=True)
        out.append([
            EffectInstance.of(kind.name, e.where, **{**shape, **{m: e.params[m].value for m in kind.magnitudes}})
            for e, shape in placed
        ])  # fmt: skip
    return out


def _fitted(search: Searching, state: State, simple: list[EffectInstance], starts: list[list[EffectInstance]]) -> Trial:
    """Fit the refined law in place of the simple one from several starts; return the fit with the least held-out loss.

    `simple` are its effects, one for each joint to refine; each start has a refined effect for each of them.
    """
    worlds = [without(state.world, simple).add(*start) for start in starts]
    fits = search.fits(worlds, state.n_fixed, races=[Race()] * len(worlds))
    losses = search.judge.losses([f.world for f in fits])
    k = int(np.argmin([search.judge.mean(loss) for loss in losses]))
    score = Score(starts[k][0], 0.0, tuple(starts[k][1:]), tuple(simple))
    return Trial(score, fits[k], losses[k], search.judge.gain(state.loss, losses[k]))


def _grown(search: Searching, state: State, simple: EffectInstance) -> list[EffectInstance]:
    """Return richer effects to start from in place of the simple one.

    They take over its value; their other parameters are guessed from the data, magnitudes also smaller and larger. At a
    place that is no joint there are none.
    """
    joints = search.evidence.items[0].robot.joints
    if simple.where not in joints:
        return []
    data = joint_data(search.missing(state.world), search.evidence.items)[joints.index(simple.where)]
    starts: list[EffectInstance] = []
    for name, kind in searchable().items():
        for param_name, simple_param in kind.grows_from.get(simple.effect, {}).items():
            for guess, scale in product(kind.guesses(data), RULES.law_scales):
                scaled = {k: v * scale for k, v in guess.items() if k in kind.magnitudes}
                start = EffectInstance.of(
                    name, simple.where, **{**guess, **scaled, param_name: simple.params[simple_param].value}
                )
                starts += [start] if start not in starts and search.evidence.sees(kind) else []
    return starts


def _first(starts: list[EffectInstance]) -> list[EffectInstance]:
    """Return the first few starts of each kind of effect."""
    by_kind = [[s for s in starts if s.effect == name] for name in dict.fromkeys(s.effect for s in starts)]
    return [s for of_kind in by_kind for s in of_kind[: RULES.law_fitted]]


def grow(search: Searching, state: State, placed: EffectInstance) -> None:
    """Replace the effect just added (`placed`) by a richer one if that removes most of the rest.

    The added effect may be an alias of it: rotor inertia imitates backlash. A fit of the richer effect from scratch
    tends to end in a local minimum in which the simpler one explains most, so it starts from the simpler one's value.
    """
    simple = next(e for e in state.world.effects if (e.effect, e.where) == (placed.effect, placed.where))
    bare = state.world.without(simple.effect, simple.where)
    starts = _grown(search, state, simple)
    if not starts:
        return
    squared = [squares(r) for r in search.evidence.each_residual([bare.add(s) for s in starts])]
    starts = _first([starts[k] for k in np.argsort(squared)])  # a fit of backlash converges slowly from far away
    remains = search.evidence.chi2(state.residual)
    goal = remains - RULES.decisive * max(remains - 1.0, 0.0)
    chases = [Chase(goal) for _ in starts]
    columns = [state.derivatives([simple])] * len(starts)
    fits = search.fits([bare.add(s) for s in starts], state.n_fixed, races=chases, columns=columns)
    losses = search.judge.losses([f.world for f in fits])
    k = int(np.argmin([search.judge.mean(loss) for loss in losses]))
    crossed = state.cross, search.cross.loss_of(fits[k], fits[k].residual)
    trial = Trial(Score(starts[k], 0.0, out=(simple,)), fits[k], losses[k], search.judge.gain(state.loss, losses[k]))
    if _explains_more(search, state, trial, search.judge.gain(state.loss, losses[k], crossed).z):
        search.say(f"{starts[k].label} replaces {simple.label}, as it explains most of the remaining error")
        search.take(state, trial, [trial])


def _explains_more(search: Searching, state: State, trial: Trial, crossed: float) -> bool:
    """Return whether a richer effect removes most of the residual above noise that the simple one leaves.

    `crossed` is the standard normal score of its gain, cross-fitted blocks included. A gain that is a small share of
    the total residual, noise included, may be chance, so more is required. An effect that contains the simple one as a
    special case need not have an interval without null: the gain itself is the test, since the interval would also
    count errors of form common to both.
    """
    gain, judge = trial.gain, search.judge
    contained = any(e.effect in effect(trial.score.placed.effect).contains for e in trial.score.out)
    most = gain.mean > RULES.decisive * max(judge.excess(state.world, state.loss), 0.0)
    if not most or not (contained or present(trial.fit, -1)):
        return False
    if gain.relative > RULES.decisive:
        # linear prediction of folds is poor far from its fit
        sure = contained and gain.z > stats.norm.isf(RULES.discoveries)
        return sure or (crossed if contained else gain.z) > stats.norm.isf(RULES.level)
    if contained or gain.relative < search.evidence.least_gain or gain.z < stats.norm.isf(RULES.level):
        return False
    if crossed < stats.norm.isf(RULES.discoveries):
        return False
    return bic_gain(search.evidence, state.world, state.residual, trial.fit) > 0
