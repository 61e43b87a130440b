"""Effects of contact that no recording, or none of these, tells apart: the verdict is then ambiguous.

Three kinds: combinations that a fit shows to be undetermined, a soft layer, and the masses of tool and held part.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from vispeg.contact.selection.profile import place_of
from vispeg.contact.selection.searching import ContactSearching
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Verdict, made_ambiguous
from vispeg.diagnosis.schema import FoundEffect, NextMotion, Place
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.state import State
from vispeg.identify.fit import Fit
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled
from vispeg.worlds.world import World

PART_MASS, TOOL_MASS, TOOL_CENTRE = "object_mass", "tool_mass", "tool_com"  # names of effects
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


def tool_instead(search: ContactSearching, state: State) -> Together:
    """Return the part's mass that a search added, followed by the tool's mass and centre that explain as much.

    In any orientations, the readings of a wrist sensor determine mass, centre of mass and inertia of tool and part
    together, not the share of each. So a change of the tool's mass and centre of mass can always replace a change of
    the part's mass; the two differ in inertia alone, by less than the readings show. Source: Atkeson, An and Hollerbach
    1986, Estimation of inertial parameters of manipulator loads and links, Int. J. Robotics Research 5(3).

    Empty if the search did not add the part's mass, if the model has the tool's mass as well, or if the held-out
    recordings distinguish the two explanations. The first `n_fixed` effects of the state's world were given; a given
    centre of the tool is fitted too, from its value.
    """
    added = {e.effect: e for e in state.added}
    scene = search.evidence.items[0].source.scene
    where = place_of(effect(TOOL_MASS), scene)
    if PART_MASS not in added or not where or any(e.effect == TOOL_MASS for e in state.world.effects):
        return ()
    part, world = added[PART_MASS], state.world.without(PART_MASS, added[PART_MASS].where)
    search.say(f"fitting {TOOL_MASS}({where}) and {TOOL_CENTRE}({where}) in the place of {part.label}")
    if len(added) > 1:
        world = search.reduced([world], state.n_fixed)[0].world
    neither = search.judge.mean(search.judge.losses([world])[0])  # of the model without the mass of part or tool
    absent = search.evidence.absent  # the tool's parameters are fitted here even if the search found them absent
    search.evidence.absent = {(name, k) for name, k in absent if name not in (TOOL_MASS, TOOL_CENTRE)}
    mass, z = equivalent_tool(scene, part.params["scale"].value)
    centres = [e for e in world.effects if e.effect == TOOL_CENTRE] or [EffectInstance.of(TOOL_CENTRE, where, z=z)]
    fixed = sum(e not in centres for e in world.effects[: state.n_fixed])
    world = world.only(lambda e: e not in centres).add(EffectInstance.of(TOOL_MASS, where, mass=mass), *centres)
    (fit,) = search.fits([world], fixed)
    search.evidence.absent = absent
    (loss,) = search.judge.losses([fit.world])
    if not equal(search.judge, loss, state.loss, neither, search.evidence.alike, remaining=True):
        return ()
    return part, *(e for name in (TOOL_MASS, TOOL_CENTRE) for e in fit.world.effects if e.effect == name)


def equivalent_tool(scene: Scene, scale: float) -> tuple[float, float]:
    """Return changes of the tool with the same weight and leverage as multiplying the held part's mass by `scale`.

    These are an added mass (kg), and a shift of the centre of mass (m, along the flange's z), cut to its bounds.
    """
    model = compiled(scene)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    flange = data.site(scene.flange)
    tool, part = (model.body(name).id for name in ("tool", scene.held))
    height = (data.xipos - flange.xpos) @ flange.xmat.reshape(3, 3)[:, 2]
    mass = float((scale - 1.0) * model.body_mass[part])
    limits = effect(TOOL_CENTRE).params["z"]
    z = mass * (height[part] - height[tool]) / (model.body_mass[tool] + mass)
    return mass, float(np.clip(z, limits.low, limits.high))


def of_masses(verdict: Verdict, confounded: Together) -> Verdict:
    """Change `identified` to `ambiguous` if `confounded`, the result of `tool_instead`, is not empty."""
    if not confounded:
        return verdict
    part, *tool = confounded
    text = (
        f"{part.label} cannot be distinguished from {' with '.join(e.label for e in tool)}: these recordings show only "
        "the mass of part and tool together"
    )
    return made_ambiguous(verdict, text)


def with_tool(effects: list[FoundEffect], confounded: Together) -> list[FoundEffect]:
    """Return a record's `effects`, in which the part's mass lists those of the tool as indistinguishable from it.

    Effects that have an entry of their own are not listed. `confounded` is the result of `tool_instead`.
    """
    named = {e["effect"] for e in effects}
    for entry in effects:
        if confounded and (entry["effect"], entry["where"]) == (confounded[0].effect, confounded[0].where):
            named |= {e["effect"] for e in entry["indistinguishable_from"]}
            others = [e for e in confounded[1:] if e.effect not in named]
            entry["indistinguishable_from"] += [Place(effect=e.effect, where=e.where) for e in others]
    return effects


def separating(confounded: Together) -> NextMotion | None:
    """Return the motion that distinguishes part and tool; None if `confounded`, from `tool_instead`, is empty."""
    if not confounded:
        return None
    part, *tool = confounded
    why = f"distinguishes {part.label} from {' with '.join(e.label for e in tool)}; so does weighing the part by itself"
    return {"motion": "free, with and without the held part", "why": why}
