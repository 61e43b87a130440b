"""Structural confounding of masses: a wrist sensor cannot tell a heavier part from a heavier tool with another centre.

In whatever attitudes it is held, it determines mass, centre and inertia of all that it carries, and not how these are
shared. A part's mass is one number; a tool's with its centre can always make up for it, and its inertia is felt too
little to tell. Source: Atkeson, An and Hollerbach 1986, Estimation of inertial parameters of manipulator loads and
links, Int. J. Robotics Research 5(3).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np

from vispeg.contact.selection.profile import place_of
from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.findings import Verdict
from vispeg.diagnosis.schema import FoundEffect, NextMotion, Place
from vispeg.diagnosis.selection.accept import equal
from vispeg.diagnosis.selection.state import State
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled

if TYPE_CHECKING:
    from vispeg.contact.selection.search import ContactSearch

PART, MASS, CENTRE = "object_mass", "tool_mass", "tool_com"


def weighed(search: ContactSearch, state: State, n_fixed: int) -> tuple[EffectInstance, ...]:
    """Return the named effect of the part's mass and the tool's mass and centre that fit as well; empty if they do not,
    or if the tool's mass is named as well.
    """
    added = {e.effect: e for e in state.world.effects[n_fixed:]}
    scene = search.evidence.items[0].source.scene
    where = place_of(effect(MASS), scene)
    if PART not in added or not where or any(e.effect == MASS for e in state.world.effects):
        return ()
    part, world = added[PART], state.world.without(PART, added[PART].where)
    search.say(f"fitting {MASS}({where}) and {CENTRE}({where}) in the place of {part.label}")
    if len(added) > 1:
        world = search.reduced([world], n_fixed)[0].world
    without = search.judge.mean(search.judge.losses([world])[0])
    absent = search.evidence.absent
    search.evidence.absent = {(name, k) for name, k in absent if name not in (MASS, CENTRE)}
    mass, z = of_tool(scene, part.params["scale"].value)
    world = world.add(EffectInstance.of(MASS, where, mass=mass))
    if CENTRE not in added:
        world = world.add(EffectInstance.of(CENTRE, where, z=z))
    (fit,) = search.fits([world], n_fixed)
    search.evidence.absent = absent
    (loss,) = search.judge.losses([fit.world])
    if not equal(search.judge, loss, state.loss, without, search.evidence.alike, remaining=True):
        return ()
    return part, *(e for name in (MASS, CENTRE) for e in fit.world.effects if e.effect == name)


def of_tool(scene: Scene, scale: float) -> tuple[float, float]:
    """Return mass (kg) and centre shift (m, along the flange's z) of a tool that match the weight of a part with a
    scaled mass.
    """
    model = compiled(scene)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    flange = data.site(scene.flange)
    tool, part = (model.body(name).id for name in ("tool", scene.held))
    height = (data.xipos - flange.xpos) @ flange.xmat.reshape(3, 3)[:, 2]
    mass = float((scale - 1.0) * model.body_mass[part])
    limits = effect(CENTRE).params["z"]
    z = mass * (height[part] - height[tool]) / (model.body_mass[tool] + mass)
    return mass, float(np.clip(z, limits.low, limits.high))


def judged(verdict: Verdict, alike: tuple[EffectInstance, ...]) -> Verdict:
    """Change `identified` to `ambiguous` if, by `weighed`, a heavier tool would explain the named part's mass."""
    if verdict.verdict != "identified" or not alike:
        return verdict
    part, *tool = alike
    text = (
        f"{part.label} weighs as {' with '.join(e.label for e in tool)} does: these recordings know what the part and "
        "the tool weigh together"
    )
    return Verdict("ambiguous", text, partial=verdict.partial)


def beside(effects: list[FoundEffect], alike: tuple[EffectInstance, ...]) -> list[FoundEffect]:
    """Return the effects of a record, with the confounded effects that were not named added to the part's mass."""
    named = {e["effect"] for e in effects}
    for entry in effects:
        if alike and (entry["effect"], entry["where"]) == (alike[0].effect, alike[0].where):
            named |= {e["effect"] for e in entry["indistinguishable_from"]}
            others = [e for e in alike[1:] if e.effect not in named]
            entry["indistinguishable_from"] += [Place(effect=e.effect, where=e.where) for e in others]
    return effects


def asked(alike: tuple[EffectInstance, ...]) -> NextMotion | None:
    """Return the motion that distinguishes them; None if nothing is confounded."""
    if not alike:
        return None
    part, *tool = alike
    why = f"tells {part.label} from {' with '.join(e.label for e in tool)}; so does weighing the part by itself"
    return {"motion": "free, with and without the held part", "why": why}
