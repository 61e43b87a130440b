"""Acceptance tests of the fitted candidates of a step (trials), and choice of the simplest of equal ones.

Two worlds are equal if held-out recordings cannot tell which is better. An alias is an effect that lowers the error
only because it imitates a missing one; a value pushed to its bound is a sign of one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.signatures import at_bound
from vispeg.diagnosis.findings import Trial
from vispeg.diagnosis.selection.bic import bic_gain
from vispeg.diagnosis.selection.judge import Judge, parameters
from vispeg.diagnosis.selection.searching import ShareTesting, Testing
from vispeg.diagnosis.selection.state import State, without


def ranked(search: Testing, state: State, trials: list[Trial], tested: int) -> list[Trial]:
    """Return the trials with reasons for those that fail a test; those that pass first, led by the simplest of equals.

    `tested` is the number of places among which the trials were chosen (`threshold`).
    """
    level, out = threshold([t.gain.z for t in trials], tested), []
    for t in trials:
        absent = not search.shows(state, t)
        out.append(Trial(t.score, t.fit, t.loss, t.gain, search.refusal(state, t, level, absent), absent))
    return in_order(search.judge, state, out)


def refusal(search: ShareTesting, state: State, t: Trial, level: float, absent: bool) -> str:
    """Return why a trial fails a criterion, "" if it passes.

    `level` is the required standard errors of its gain, `absent` whether none of its effects is clearly present.
    """
    if t.gain.mean <= 0:
        return "the held-out error does not fall"
    share = t.gain.mean / state.scale
    stays = without(state.world, t.score.out).effects if not t.score.beside else ()
    same = [e for e in stays if same_kind(e, t.score.placed)]
    beside = max(same, key=state.removed_by, default=None)
    refines = t.gain.mean / state.removed_by(beside) if beside is not None else 1.0
    # no error in a law of friction leaves a torque that depends on the angle alone
    of_angle = effect(t.score.placed.effect).conservative and not any(effect(e.effect).conservative for e in same)
    clear = RULES.clear_of_angle if of_angle else RULES.alone
    if beside is not None and refines < RULES.refinement and t.gain.relative < clear:
        return f"only refines {beside.label} at the same place ({100 * refines:.2g} % of what that removed)"
    if share < search.least_share:
        least = f"under {100 * search.least_share:.1g} %"
        return f"removes {100 * share:.2g} % of what an accepted effect typically removed, {least}"
    if t.gain.relative < search.evidence.least_gain:
        return f"held-out gain {100 * t.gain.relative:.1f} % is under {100 * search.evidence.least_gain:.0f} %"
    if t.gain.z < (level if t.gain.relative < RULES.large else stats.norm.isf(RULES.level)):
        return f"held-out gain is {t.gain.z:.1f} standard errors, under {level:.1f}"
    if not search.holds(state, t):
        return "it does not show in the held-out recordings alone"
    if absent:
        return "it may be absent: its 95 % interval includes the value at which it does nothing"
    if bic_gain(search.evidence, state.world, state.residual, t.fit) <= 0:
        return "BIC with the effective sample size does not improve"
    return ""


def in_order(judge: Judge, state: State, trials: list[Trial]) -> list[Trial]:
    """Return the trials that passed, led by the simplest of equals, then the rejected ones, both by held-out loss.

    Of those that passed, ones whose effects all ended at a bound come last, unless one is the simplest of the equals.
    """
    passed = sorted((t for t in trials if not t.rejected), key=lambda t: (not sound(t), float(t.loss.sum())))
    if passed:
        alone = [t for t in passed if not t.score.beside and t.gain.relative >= RULES.alone and sound(t)]
        best = (alone or passed)[0]
        alike = [t for t in passed if equal(judge, t.loss, best.loss, judge.mean(state.loss))]
        # one cause is simpler than several: a load at the flange has more parameters than masses of two links
        first = min(alike, key=lambda t: (doubtful(t), t.score.count, parameters(t.fit.world), float(t.loss.sum())))
        # a likelier effect goes first, unless one explains nearly everything: a lone error may as well be a link's
        others = state.fit is not None or first.gain.mean < RULES.alone * (judge.mean(state.loss) - 1.0)
        instead = [t for t in alike if others and likelier(t, first) and doubtful(t) <= doubtful(first)]
        first = min(instead, key=lambda t: float(t.loss.sum()), default=first)
        passed.remove(first)
        passed.insert(0, first)
    refused = sorted((t for t in trials if t.rejected), key=lambda t: float(t.loss.sum()))
    return passed + refused


def passes(trials: Sequence[Trial]) -> bool:
    """Return whether one of them passed, not all of its effects at a bound."""
    return any(not t.rejected and sound(t) for t in trials)


def sound(t: Trial) -> bool:
    """Return whether at least one effect of a candidate ended within its bounds; else it is probably an alias."""
    return not all(at_bound(e) for e in _own(t))


def doubtful(t: Trial) -> bool:
    """Return whether a candidate has a value at its bound, or one strongly correlated with an earlier effect's."""
    count = len(t.fit.world.effects)
    new = [i for i, a in enumerate(t.fit.space.axes) if a.index >= count - t.score.count]
    old = [i for i in range(len(t.fit.space.axes)) if i not in new]
    entangled = bool(np.any(np.abs(t.fit.correlation[np.ix_(new, old)]) > RULES.correlated))
    return entangled or any(at_bound(e) for e in _own(t))


def likelier(t: Trial, first: Trial) -> bool:
    """Return whether trial `t` adds one effect that is more likely a priori than the one effect that `first` adds."""
    singles = not t.score.beside and not first.score.beside
    return singles and _own(t)[0].effect in effect(_own(first)[0].effect).likelier


def _own(t: Trial) -> Sequence[EffectInstance]:
    """Return the effects that a candidate added, with fitted values."""
    return t.fit.world.effects[-t.score.count :]


def threshold(scores: Sequence[float], tested: int) -> float:
    """Return the standard normal score from which a trial passes at the false discovery rate `discoveries`.

    `scores` are those of the trials, the best of `tested` places; places that were not fitted count as tested too.
    Without trials it is infinite. Source: Benjamini and Hochberg, Journal of the Royal Statistical Society B 57(1),
    1995.
    """
    if not len(scores):
        return np.inf
    p = np.sort(stats.norm.sf(scores))
    levels = RULES.discoveries * np.arange(1, len(p) + 1) / max(tested, len(p), 1)
    passed = np.flatnonzero(p <= levels)
    return float(stats.norm.isf(levels[passed[-1] if len(passed) else 0]))


def equal(
    judge: Judge,
    loss: np.ndarray,
    best: np.ndarray,
    without: float = 1.0,
    alike: float = 0.0,
    remaining: bool = False,
) -> bool:
    """Return whether held-out data leave open which of two worlds is better: one is hardly worse, or worse by chance.

    It is hardly worse if the difference is a small share of the error that the better world leaves above noise, or of
    the error that the effect removes: no model is exact, so smaller differences mean nothing.

    Args:
        judge: of the held-out recordings.
        loss, best: losses of the world and of the better one.
        without: mean squared whitened residual without either world's effect.
        alike: share of what the better world removes by which the other may fall short (`Evidence.alike`). Above 0,
            chance includes correlated errors (`Evidence.tied`), but it counts only if the worse world removes at
            least half as much as the better one.
        remaining: allow the worse world at most about twice the better one's excess over noise, if that is small.
    """
    gain = judge.gain(loss, best)
    excess = max(judge.mean(best) - 1.0, 0.0)
    form = RULES.later * (without - 1.0)
    share = max(min(form, excess) if remaining else form, alike * (without - judge.mean(best)))
    hardly = gain.mean <= max(RULES.tie * (excess + RULES.tie_room), share)
    by_chance = gain.z < RULES.tie_sigma and not judge.apart(gain)
    if alike > 0:
        by_chance = gain.mean <= 0.5 * (without - judge.mean(best)) and (by_chance or judge.tied(gain))
    return hardly or by_chance


def same_kind(a: EffectInstance, b: EffectInstance) -> bool:
    """Return whether two effects are at the same joint and both of the family `joint` (friction, play, springs)."""
    return a.where == b.where and effect(a.effect).family == effect(b.effect).family == "joint"
