"""A heavier part and a heavier tool that balances elsewhere weigh alike, and a diagnosis says so."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from vispeg.contact.next_motion import separating
from vispeg.contact.run import evidence_of
from vispeg.contact.selection.confounded import imitated, of_imitated, with_imitators
from vispeg.contact.selection.search import ContactSearch
from vispeg.core.effect import REGISTRY, EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.diagnosis.findings import Verdict
from vispeg.diagnosis.selection.judge import Judge
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.noise import NOISE
from vispeg.robots.tools import CELL
from vispeg.sim.compiled import compiled
from vispeg.task.belief import believed
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.motions import Place
from vispeg.task.rig.path import commands
from vispeg.task.rig.record import record_cell
from vispeg.worlds.world import World

MODEL = World("iiwa14", CELL, cell=CellBelief("nominal"))
FOUND = believed(MODEL.cell)
PART = EffectInstance.of("object_mass", "peg", scale=1.8)


def equivalent_tool(scale):
    """Mass (kg) and shift of the centre (m) of the tool that weighs as a part of so many times its mass."""
    mass, centre = effect("object_mass").imitated_by(FOUND.scene, compiled(FOUND.scene), {"scale": scale})
    return mass.params["mass"].value, centre.params["z"].value


def test_a_tool_of_that_mass_and_centre_weighs_as_the_part():
    """Force and torque at the flange, `sum m g` and `sum r x m g`, are the same in every attitude."""
    model = compiled(FOUND.scene)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    site = data.site(FOUND.scene.flange)
    tool, part = (model.body(name).id for name in ("tool", "peg"))
    place = (data.xipos - site.xpos) @ site.xmat.reshape(3, 3)
    mass, z = equivalent_tool(1.8)
    moment = model.body_mass[tool] * place[tool] + 1.8 * model.body_mass[part] * place[part]
    other = (model.body_mass[tool] + mass) * (place[tool] + [0, 0, z]) + model.body_mass[part] * place[part]
    assert mass == pytest.approx(0.8 * model.body_mass[part])
    np.testing.assert_allclose(other, moment, atol=1e-9)


def tilted(seed, hidden):
    """2.7 s in free air, the tool tilted by 0.45 rad about both axes."""
    path = Place(FOUND.scene, stream(seed, "weighed")).begin(0.1)
    for turn in ((0.45, 0, 0), (0, 0.45, 0)):
        path.to(0.6, turn=turn).to(0.2)
    time, frames = path.frames(500.0)
    made = CellMotion("free", time, commands(frames, FOUND.scene, FOUND.config.stiffness))
    return record_cell(MODEL.add(*hidden), made, NOISE, stream(seed, "weighed"))


def named(hidden, given=()):
    """A search that was given some of what is hidden and has named the rest, and its state."""
    evidence, held = (evidence_of([tilted(seed, (*given, *hidden))]) for seed in (1, 2))
    search = ContactSearch(evidence, Judge(held))
    evidence.absent = {("tool_com", "z"), ("tool_com", "y"), ("grip_pose", "x")}
    (fit,) = search.fits([World().add(*given, *hidden)], len(given))
    state = search.start(World().add(*given), len(given))
    state.take(fit, search.judge.losses([fit.world])[0])
    return search, state


@pytest.mark.parametrize("beside_it", [(), (EffectInstance.of("tool_com", "gripper", x=5e-3),)])
def test_the_tools_mass_and_centre_do_as_well_in_the_parts_place(beside_it):
    """Also beside a centre of which one axis alone was named; the fits that follow free what they did before."""
    search, state = named((PART, *beside_it))
    absent = set(search.evidence.absent)
    (alike,) = imitated(search, state)
    assert {e.effect for e in alike} == {"object_mass", "tool_mass", "tool_com"} and search.evidence.absent == absent
    mass, z = equivalent_tool(1.8)
    by_name = {e.effect: e.params for e in alike}
    assert by_name["tool_mass"]["mass"].value == pytest.approx(mass, rel=0.2)
    assert by_name["tool_com"]["z"].value == pytest.approx(z, abs=3e-3)


def test_a_centre_of_the_tool_that_was_given_stays_in_the_tool_that_does_as_well():
    """The tool's centre moves along its axis from where the model had it, 10 mm aside."""
    search, state = named((PART,), (EffectInstance.of("tool_com", "gripper", x=0.01),))
    ((_, mass, centre),) = imitated(search, state)
    wanted, z = equivalent_tool(1.8)
    assert mass.params["mass"].value == pytest.approx(wanted, rel=0.2)
    assert centre.params["z"].value == pytest.approx(z, abs=3e-3)
    assert centre.params["x"].value == pytest.approx(0.01, abs=3e-3)


def test_a_tool_mass_that_was_found_has_no_second_explanation():
    """The tool's mass is named by itself: no one number of the part does that."""
    search, state = named((EffectInstance.of("tool_mass", "gripper", mass=0.2),))
    assert imitated(search, state) == []


def test_a_record_names_confounded_masses_and_the_motion_that_separates_them():
    tool = EffectInstance.of("tool_mass", "gripper", mass=0.1), EffectInstance.of("tool_com", "gripper", z=0.01)
    alike = (PART, *tool)
    verdict = of_imitated(Verdict("identified", ""), [alike])
    assert verdict.verdict == "ambiguous" and all(e.label in verdict.reason for e in alike)
    assert of_imitated(Verdict("unexplained", "why"), [alike]).verdict == "unexplained"
    assert of_imitated(Verdict("identified", ""), []).verdict == "identified"
    entry = {
        "effect": "object_mass",
        "where": "peg",
        "indistinguishable_from": [{"effect": "tool_mass", "where": "gripper"}],
    }
    (row,) = with_imitators([entry], [alike])
    assert [e["effect"] for e in row["indistinguishable_from"]] == ["tool_mass", "tool_com"]
    motion = separating(World().add(PART), [], [], [alike], {"free", "press"})
    assert motion["motion"] == "free, with and without the held part"
    named = {"effect": "tool_com", "where": "gripper", "indistinguishable_from": []}
    row, _ = with_imitators([{**entry, "indistinguishable_from": []}, named], [alike])
    assert [e["effect"] for e in row["indistinguishable_from"]] == ["tool_mass"], "a named effect is no other one"


def test_what_imitates_an_effect_is_in_the_registry_and_does_nothing_where_the_effect_does_nothing():
    model = compiled(FOUND.scene)
    for kind in REGISTRY.values():
        others = kind.imitated_by(FOUND.scene, model, {k: p.null for k, p in kind.params.items()})
        for e in others:
            null = {k: effect(e.effect).params[k].null for k in effect(e.effect).magnitudes}
            assert {k: e.params[k].value for k in null} == pytest.approx(null, abs=1e-12)
