"""Structural confounding of masses: a wrist sensor cannot distinguish a heavier held part from a heavier tool.

In any orientations, its readings determine mass, centre of mass and inertia of tool and part together, not the share of
each. So a change of the tool's mass and centre of mass can always replace a change of the part's mass; the two differ
in inertia alone, by less than the readings show. Source: Atkeson, An and Hollerbach 1986, Estimation of inertial
parameters of manipulator loads and links, Int. J. Robotics Research 5(3).
"""

from __future__ import annotations

import mujoco
import numpy as np

from vispeg.contact.selection.profile import place_of
from vispeg.contact.selection.searching import ContactSearching
from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.findings import Verdict
from vispeg.diagnosis.schema import FoundEffect, NextMotion, Place
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.state import State
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled

PART_MASS, TOOL_MASS, TOOL_CENTRE = "object_mass", "tool_mass", "tool_com"  # names of effects


def tool_instead(search: ContactSearching, state: State, n_fixed: int) -> tuple[EffectInstance, ...]:
    """Return the part's mass that a search added, followed by the tool's mass and centre that explain as much.

    Empty if the search did not add the part's mass, if the model has the tool's mass as well, or if the held-out
    recordings distinguish the two explanations. The first `n_fixed` effects of the state's world were given; a given
    centre of the tool is fitted too, from its value.
    """
    added = {e.effect: e for e in state.world.effects[n_fixed:]}
    scene = search.evidence.items[0].source.scene
    where = place_of(effect(TOOL_MASS), scene)
    if PART_MASS not in added or not where or any(e.effect == TOOL_MASS for e in state.world.effects):
        return ()
    part, world = added[PART_MASS], state.world.without(PART_MASS, added[PART_MASS].where)
    search.say(f"fitting {TOOL_MASS}({where}) and {TOOL_CENTRE}({where}) in the place of {part.label}")
    if len(added) > 1:
        world = search.reduced([world], n_fixed)[0].world
    neither = search.judge.mean(search.judge.losses([world])[0])  # of the model without the mass of part or tool
    absent = search.evidence.absent  # the tool's parameters are fitted here even if the search found them absent
    search.evidence.absent = {(name, k) for name, k in absent if name not in (TOOL_MASS, TOOL_CENTRE)}
    mass, z = equivalent_tool(scene, part.params["scale"].value)
    centres = [e for e in world.effects if e.effect == TOOL_CENTRE] or [EffectInstance.of(TOOL_CENTRE, where, z=z)]
    fixed = sum(e not in centres for e in world.effects[:n_fixed])
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


def judged(verdict: Verdict, confounded: tuple[EffectInstance, ...]) -> Verdict:
    """Change `identified` to `ambiguous` if `confounded`, the result of `tool_instead`, is not empty."""
    if verdict.verdict != "identified" or not confounded:
        return verdict
    part, *tool = confounded
    text = (
        f"{part.label} cannot be distinguished from {' with '.join(e.label for e in tool)}: these recordings show only "
        "the mass of part and tool together"
    )
    return Verdict("ambiguous", text, partial=verdict.partial)


def with_tool(effects: list[FoundEffect], confounded: tuple[EffectInstance, ...]) -> list[FoundEffect]:
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


def separating(confounded: tuple[EffectInstance, ...]) -> NextMotion | None:
    """Return the motion that distinguishes part and tool; None if `confounded`, from `tool_instead`, is empty."""
    if not confounded:
        return None
    part, *tool = confounded
    why = f"distinguishes {part.label} from {' with '.join(e.label for e in tool)}; so does weighing the part by itself"
    return {"motion": "free, with and without the held part", "why": why}
