"""Effects of contact that no recording, or none of these, tells apart: the verdict is then ambiguous.

Three kinds: combinations that a fit shows to be undetermined, a soft layer, and an effect that others imitate together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.contact.selection.searching import ContactSearching
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Verdict, made_ambiguous
from vispeg.diagnosis.schema import FoundEffect, Place
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.state import State
from vispeg.identify.fit import Fit
from vispeg.sim.compiled import compiled
from vispeg.worlds.world import World

Together = tuple[EffectInstance, ...]
FLAT = 1e-12  # smallest norm of a column, against division by 0


def entangled(fit: Fit | None, n_fixed: int) -> list[Together]:
    """Return the sets of added effects that a fit determines only in combination, the least determined first.

    The information matrix, scaled to a diagonal of ones, shows them: along an eigenvector whose eigenvalue is near 0
    the parameters may move together while the residual stays. For two parameters, this eigenvalue is one minus the
    absolute value of their correlation. A set consists of the effects of the parameters that have more than half of
    their variance along one. Source: Belsley, Kuh and Welsch 1980, Regression Diagnostics, chapter 3.
    """
    if fit is None or not len(fit.u):
        return []
    columns = fit.jacobian / np.maximum(np.linalg.norm(fit.jacobian, axis=0), FLAT)
    value, vector = np.linalg.eigh(columns.T @ columns)
    variance = vector**2 / np.maximum(value, FLAT)
    share = variance / variance.sum(axis=1, keepdims=True)  # of each parameter, by eigenvector
    out: list[Together] = []
    for part in share.T[value < 1 - RULES.correlated]:
        indices = sorted({fit.space.axes[i].index for i in np.flatnonzero(part > 0.5)})
        together = tuple(fit.world.effects[i] for i in indices)
        if len(indices) > 1 and indices[0] >= n_fixed and together not in out:
            out.append(together)
    return out


def of_combinations(verdict: Verdict, sets: Sequence[Together]) -> Verdict:
    """Change `identified` to `ambiguous` if some effects are determined only in combination."""
    named = "; ".join(" and ".join(e.label for e in together) for together in sets)
    return made_ambiguous(verdict, f"these recordings determine only a combination of {named}" if sets else "")


def beside(effects: list[FoundEffect], sets: Sequence[Together]) -> list[FoundEffect]:
    """Add to each effect of a record those with which only a combination is determined; return the effects."""
    for together in sets:
        for a in together:
            entry = next(e for e in effects if (e["effect"], e["where"]) == (a.effect, a.where))
            others: list[Place] = [{"effect": b.effect, "where": b.where} for b in together if b is not a]
            entry["indistinguishable_from"] += [o for o in others if o not in entry["indistinguishable_from"]]
    return effects


def of_layer(verdict: Verdict, world: World, n_fixed: int) -> Verdict:
    """Change `identified` to `ambiguous` if a softer contact and a higher part were added, as a layer would look.

    A soft layer on the fixture, such as a gasket or tape, is not in the library, but if walls are hardly touched, no
    recording distinguishes it from these two effects.

    Args:
        verdict: the verdict of the search.
        world: the corrected model.
        n_fixed: number of effects given by the user.
    """
    added = world.effects[n_fixed:]
    soft = next((e for e in added if e.effect == "contact_stiffness" and e.params["scale"].value < 1.0), None)
    high = next((e for e in added if _higher(e)), None)
    if soft is None or high is None:
        return verdict
    text = (
        f"{soft.label} with {high.label} is also what a soft layer on the fixture (a gasket, tape) looks like, "
        "which is no effect of the library: look whether one lies there"
    )
    return made_ambiguous(verdict, text)


def _higher(placed: EffectInstance) -> bool:
    """Return whether an effect is a pose of which the whole interval makes parts touch sooner than nominal."""
    z = placed.params.get("z") if effect(placed.effect).posed else None
    return z is not None and (z.value if z.low is None else z.low) > 0.0


def imitated(search: ContactSearching, state: State) -> list[Together]:
    """Return each added effect that others imitate together (`Effect.imitated_by`), followed by these as fitted.

    An effect is left out if the model has the first of the others, or if the held-out recordings distinguish it from
    them. Others that the model has are fitted too, from their values.
    """
    scene, out = search.evidence.items[0].source.scene, []
    for placed in state.added:
        values = {k: v.value for k, v in placed.params.items()}
        others = effect(placed.effect).imitated_by(scene, compiled(scene), values)
        if others and not any(e.effect == others[0].effect for e in state.world.effects):
            found = _as_others(search, state, placed, others)
            out += [(placed, *found)] if found else []
    return out


def _as_others(search: ContactSearching, state: State, placed: EffectInstance, others: Together) -> Together:
    """Return the other effects, fitted in the place of `placed`, if they explain the held-out recordings as well."""
    search.say(f"fitting {' and '.join(e.label for e in others)} in the place of {placed.label}")
    world, names = state.world.without(placed.effect, placed.where), [e.effect for e in others]
    if len(state.added) > 1:
        world = search.reduced([world], state.n_fixed)[0].world
    neither = search.judge.mean(search.judge.losses([world])[0])  # of the model without either explanation
    absent = search.evidence.absent  # the others' parameters are fitted here even if the search found them absent
    search.evidence.absent = {(name, k) for name, k in absent if name not in names}
    start = [next((e for e in world.effects if e.effect == other.effect), other) for other in others]
    fixed = sum(e not in start for e in world.effects[: state.n_fixed])
    world = world.only(lambda e: e not in start).add(*start)
    (fit,) = search.fits([world], fixed)
    search.evidence.absent = absent
    (loss,) = search.judge.losses([fit.world])
    if not equal(search.judge, loss, state.loss, neither, search.evidence.alike, remaining=True):
        return ()
    return tuple(e for name in names for e in fit.world.effects if e.effect == name)


def of_imitated(verdict: Verdict, sets: Sequence[Together]) -> Verdict:
    """Change `identified` to `ambiguous` if others imitate an effect; `sets` is the result of `imitated`."""
    texts = [f"{one.label} from {' with '.join(e.label for e in others)}" for one, *others in sets]
    reason = f"no motion in these recordings distinguishes {'; '.join(texts)}: together they make the same wrench"
    return made_ambiguous(verdict, reason if sets else "")


def with_imitators(effects: list[FoundEffect], sets: Sequence[Together]) -> list[FoundEffect]:
    """Add to each imitated effect of a record the others as indistinguishable from it; return the effects.

    Effects that have an entry of their own are not listed. `sets` is the result of `imitated`.
    """
    named = {e["effect"] for e in effects}
    for one, *others in sets:
        entry = next(e for e in effects if (e["effect"], e["where"]) == (one.effect, one.where))
        known = named | {e["effect"] for e in entry["indistinguishable_from"]}
        new = [e for e in others if e.effect not in known]
        entry["indistinguishable_from"] += [Place(effect=e.effect, where=e.where) for e in new]
    return effects
