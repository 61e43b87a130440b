"""What a diagnosis of contact says of itself: what would show, what is left, and the physics that it rests on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from straight import Straight, search

from vispeg.api.recording.cell import cell_motion
from vispeg.contact.remainder import Rest, of_phases
from vispeg.contact.selection.repeats import allowing, repeated, repeats, uncertainty
from vispeg.contact.selection.shows_from import Tried, least_sizes, shown_from, surely
from vispeg.contact.selection.spare import may_be_absent
from vispeg.core.effect import REGISTRY, EffectInstance
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Verdict
from vispeg.sim.touch import touch
from vispeg.task.belief import believed
from vispeg.task.rig.record import record_cell
from vispeg.worlds.model_file import load_model
from vispeg.worlds.world import World


def tried(name: str, value: float, share: float) -> Tried:
    return name, EffectInstance.of("hole_offset", "fixture", **{name: value}), share


def test_an_effect_shows_from_where_its_trace_reaches_what_is_needed():
    """A trace grows as its distance from none: a fourth of the squared trace at half of it; not nearer than unseen."""
    straight = shown_from([tried("x", 4e-4, 4.0), tried("x", -4e-4, 1.0)])
    assert straight["hole_offset", "fixture"]["x"] == pytest.approx(2e-4)
    late = shown_from([tried("x", 3e-4, 0.1), tried("x", 4e-4, 4.0)])
    assert late["hole_offset", "fixture"]["x"] == pytest.approx(3e-4), "what does not touch leaves no trace"
    more = shown_from([tried("x", 3e-4, 0.25)])
    assert more["hole_offset", "fixture"]["x"] == pytest.approx(6e-4), "beyond the sizes that were tried"
    far = shown_from([tried("x", 3e-4, 1e-9)])
    assert far["hole_offset", "fixture"]["x"] == np.inf, "beyond its range"
    never = shown_from([tried("z", 4e-4, 0.0)])
    assert never["hole_offset", "fixture"]["z"] == np.inf


def test_an_effect_as_large_as_said_shows_nine_times_in_ten():
    """Many fits of one whose trace is d: each lowers the squared residual by d^2 + 2 d e, the errors e as accepted."""
    evidence, drop = Straight(np.zeros(6), {}), 40.0
    trace = np.sqrt(surely(evidence, drop))
    errors = np.sqrt(evidence.correlated) * np.random.default_rng(0).standard_normal(100_000)
    assert np.mean(trace**2 + 2 * trace * errors > drop) == pytest.approx(RULES.power, abs=3e-3)


def test_a_pose_shows_from_no_nearer_to_none_than_an_arm_repeats_it():
    """What an arm repeats a place to is added to where a hole's offset shows, in quadrature; not to a friction."""
    slopes = {("hole_offset", "x"): np.full(60, 5e4 / 60**0.5), ("contact_friction", "scale"): np.full(60, 1.3)}
    searching, out = search(Straight(np.zeros(60), slopes)), list[bool]()
    least, need = least_sizes(searching, World()), surely(searching.evidence, searching.need())
    assert least["hole_offset", "fixture"]["x"] > 1.01 * np.sqrt(need) / 5e4
    assert least["contact_friction", "peg"]["scale"] == pytest.approx(np.sqrt(need / 60) / 1.3)
    rng, size, told = np.random.default_rng(0), least["hole_offset", "fixture"]["x"], 0.5e-4
    for x in size + np.hypot(told, repeats()["m"]) * rng.standard_normal(400):
        out.append(not may_be_absent(offset(x, x - 1.96 * told, x + 1.96 * told)))
    assert np.mean(out) > RULES.power - 0.03, "as said: an offset of this size is hardly ever taken out again"


class Elsewhere(Straight):
    """An effect that shows only where a screening of one piece in three does not look."""

    def residuals_in_part(self, worlds):
        return [np.zeros_like(r) for r in self.residuals(worlds)]


@pytest.mark.parametrize(
    ("name", "where", "parameter", "slope"),
    [("gripper_slip", "peg", "grip", 20.0), ("fixture_compliance", "fixture", "z", 2e5)],
)
def test_what_shows_is_measured_on_all_of_both_recordings(name, where, parameter, slope):
    """Not on the pieces that are screened: there, errors of path and sensor explain another share of a change."""
    slopes, out = {(name, parameter): np.full(60, slope)}, []
    pairs = [
        (a(np.zeros(60), slopes), b(np.zeros(60), slopes)) for a in (Straight, Elsewhere) for b in (Straight, Elsewhere)
    ]
    for fitted, held_out in pairs:
        out.append(least_sizes(search(fitted, held_out), World())[name, where][parameter])
    need = surely(pairs[0][0], search(pairs[0][0]).need())
    assert out == pytest.approx([np.sqrt(need / 60) / slope] * 4)


def offset(x: float, low: float, high: float) -> EffectInstance:
    """A hole's offset with an interval, m."""
    placed = EffectInstance.of("hole_offset", "fixture", x=x)
    return replace(placed, params={**placed.params, "x": Value(x, low, high)})


def test_only_fitted_poses_have_intervals_that_allow_for_the_arm():
    """In quadrature; within the parameter's range, and what is given, or is no pose, stays as it is."""
    given, fitted = offset(1e-3, 0.9e-3, 1.1e-3), offset(2e-3, 1.7e-3, 2.3e-3)
    friction = EffectInstance.of("contact_friction", "peg", scale=1.7)
    friction = replace(friction, params={"scale": Value(1.7, 1.6, 1.8)})
    first, second, third = repeated(World(effects=(given, fitted, friction)), 1).effects
    assert first == given and third == friction
    half = np.hypot(3e-4, 1.96 * repeats()["m"])
    assert (second.params["x"].low, second.params["x"].high) == pytest.approx((2e-3 - half, 2e-3 + half))
    assert second.params["y"] == fitted.params["y"], "was not fitted"
    end = REGISTRY["hole_offset"].params["x"].high
    assert allowing(offset(end, end - 1e-5, end)).params["x"].high == end
    assert uncertainty("hole_offset", "x") == repeats()["m"] and uncertainty("contact_friction", "scale") == 0.0


def test_a_phase_beyond_its_bar_leaves_a_verdict_unexplained():
    named = Verdict("identified", "named")
    within, beyond = Rest("press", False, 1.2, 2.0, 80), Rest("hole", True, 3.0, 2.0, 80)  # mean squares: 1.73^2
    assert of_phases(named, [within]) is named
    unexplained = of_phases(named, [within, beyond])
    assert unexplained.verdict == "unexplained" and "in hole an error of 1.73 ×" in unexplained.reason


def test_what_slides_drags_by_its_friction():
    """Coulomb's law in the recorded cell, mean drag over mean normal force of one stroke, to 3 %."""
    world = load_model("peg-cell")
    whole = cell_motion(world, "slide", rate_hz=500.0, seed=1)
    part = replace(whole, time=whole.time[:2650], ee_cmd=whole.ee_cmd[:2650])
    rec = record_cell(world, part, {}, np.random.default_rng(0))
    scene = believed(world.cell).scene
    contact = touch(rec, scene).contact[(rec.time > 4.2) & (rec.time < 5.2)].mean(axis=0)
    assert contact[2] > 4.0
    assert np.hypot(*contact[:2]) / contact[2] == pytest.approx(scene.config.friction, rel=0.03)
