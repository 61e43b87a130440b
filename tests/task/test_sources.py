"""World files quote their sources truly: a range said to be theirs is, and what they do not name is ours."""

import math
import re

import numpy as np
import pytest

from vispeg.core.effect import effect as registered
from vispeg.task.world_file import built_in, load_world
from vispeg.worlds.distribution import Choice, Distribution, LogUniform, Uniform

# what the article states: effect -> its parameter and range
ARTICLE = {
    "command_delay": ("delay", (0.0, 0.02)),
    "object_mass": ("scale", (0.7, 1.3)),
    "contact_friction": ("scale", (0.5, 1.5)),
    "dropped_readings": ("chance", (0.001, 0.01)),
    "encoder_noise": ("sd", (0.001, 0.01)),
    "brightness": ("change", (-0.3, 0.3)),
    "saturation": ("change", (-0.15, 0.15)),
    "hue": ("turn", (-0.2, 0.2)),
    "blur": ("sigma", (0.0, 2.0)),
    "occlusion": ("area", (0.05, 0.2)),
    "rgb_noise": ("read", (0.0, 0.05)),
    "motion_blur": ("length", (0.0, 3.0)),
    "light_position": ("x", (-1.0, 1.0)),
    "light_temperature": ("kelvin", (3000.0, 6500.0)),
    "distractors": ("count", (0.0, 5.0)),
    "part_colour": ("hue", (0.0, 1.0)),
    "camera_offset": ("x", ((-0.1, 0.1), (-0.03, 0.03))),  # in two places
}
NAMED = {  # what the sources name without a number, or with one of another kind
    "article": {
        *("contact_stiffness", "contact_damping", "restitution", "solver_iterations", "viscous_friction"),
        *("encoder_quantization", "sensor_delay", "part_texture", "environment"),
    },
    "paper": {
        *("link_mass", "contact_friction", "viscous_friction", "gravity_scale", "hole_offset", "goal_imprecision"),
    },
}
RANGES = {f"{name}: {r.label}": r for name in built_in() for r in load_world(name).world.ranges}
RXYZ = ("rx", "ry", "rz")
QUOTING = {key: r for key, r in RANGES.items() if re.match(r"(paper|article)\b", r.source)}


def ends(value: float | Distribution) -> tuple[float, float]:
    match value:
        case Uniform(low, high) | LogUniform(low, high):
            return low, high
        case Choice(values):
            return min(values), max(values)
    raise AssertionError(value)


@pytest.mark.parametrize("key", sorted(QUOTING))
def test_a_range_that_quotes_a_source_is_what_the_source_says(key):
    """A number of the article's is the article's; what it only names has a width that is called ours."""
    r = QUOTING[key]
    ours = "ours" in r.source
    for source in re.findall(r"^(paper|article)(?: and (article))?:", r.source)[0]:
        if source == "article" and r.effect in ARTICLE:
            name, stated = ARTICLE[r.effect]
            assert ends(r.params[name]) in (stated, *stated) or (ours and name in r.params), r
        elif source:
            assert r.effect in NAMED[source] and ours, r


def test_what_no_source_names_is_not_said_to_be_theirs():
    """The paper states no width, and neither source names payload, the fingers' grip or the number of lamps."""
    for key, r in RANGES.items():
        if r.effect in ("payload", "gripper_slip", "light_count", "wrench_bias", "wrench_gain", "wrench_delay"):
            assert not re.match("paper|article", r.source), key


def test_s2_has_the_article_s_ranges_and_inexact_readings():
    """Where S quotes none, S2 does."""
    ranges = {r.effect: r for r in load_world("S2").world.ranges}
    for effect in ("saturation", "hue", "rgb_noise", "motion_blur", "encoder_noise", "brightness", "occlusion"):
        name, stated = ARTICLE[effect]
        assert ends(ranges[effect].params[name]) == stated, effect
    assert {"sensor_delay", "wrench_bias", "wrench_gain", "wrench_noise", "wrench_delay"} <= set(ranges)
    assert {r.label for r in load_world("S").world.ranges} <= {r.label for r in load_world("S2").world.ranges}


def test_the_article_s_pictures_are_a_world_of_their_own():
    """Its camera, in the two widths that it states, its colours, blur and noise."""
    for name, metres, degrees in (("article", 0.1, 10.0), ("article-narrow", 0.03, 5.0)):
        ranges = {r.effect: r for r in load_world(name).world.ranges}
        for key, most in (("x", metres), ("y", metres), ("z", metres), *((k, math.radians(degrees)) for k in RXYZ)):
            assert ends(ranges["camera_offset"].params[key]) == pytest.approx((-most, most), rel=1e-5), (name, key)
        for effect in (
            "hue",
            "saturation",
            "blur",
            "rgb_noise",
            "motion_blur",
            "brightness",
            "occlusion",
            "distractors",
        ):
            parameter, stated = ARTICLE[effect]
            assert ends(ranges[effect].params[parameter]) == stated, (name, effect)


def test_the_hidden_plant_is_what_it_says_of_itself():
    """Effects that training lacks, those beyond its ranges, and those inside, against `randomized`."""
    from vispeg.worlds.places import acts_on

    trained, new, beyond, inside = load_world("randomized").world.ranges, [], [], []
    goal = {r.effect for r in load_world("searching").world.ranges}
    for r in load_world("P").world.ranges:
        if registered(r.effect).family in ("camera", "appearance") or r.effect in goal:
            continue
        known = [t for t in trained if t.effect == r.effect and (t.where == r.where or acts_on(t.where, ()))]
        if not known:
            new.append(r.label)
            continue
        sizes = {
            k: known[0].params[k] for k in registered(r.effect).magnitudes if k in r.params and k in known[0].params
        }
        out = any(not d.at(0.0) <= r.params[k] <= d.at(1.0) for k, d in sizes.items())
        (beyond if out else inside).append(r.label)
    assert (len(new), len(beyond)) == (7, 5)
    assert inside == ["command_delay(all)", "gripper_slip(peg)"]


def test_how_often_damping_acts_beside_restitution_is_as_stated():
    """One episode of seven in `randomized`, by the field that both write."""
    from vispeg.effects.common.parts import shapes
    from vispeg.robots.scene import build
    from vispeg.sim.placement import activate
    from vispeg.sim.state import Fields, RowFields

    scene, both = build(), ("contact_damping", "restitution")
    model, world, n = scene.compile(), load_world("randomized").world, 1500
    world = world.only(lambda r: r.effect in both)
    drawn = [world.sample(seed, scene) for seed in range(n)]

    def damped(worlds):
        fields = RowFields(model, n)
        for a in activate(scene, worlds):
            a.effect.write(Fields(fields, scene), a.p)
        return fields.values["geom_solref"][:, shapes(model, "peg")[0]]

    alone = damped([w.only(lambda e: e.effect == "restitution") for w in drawn])
    share = np.mean(~np.isclose(damped(drawn), alone, rtol=1e-9).all(axis=1))
    assert abs(share - 1 / 7) < 0.03


@pytest.mark.parametrize("name", ["d405", "d435", "structured_light"])
def test_how_many_draws_of_jitter_move_no_pixel_is_as_stated(name):
    """A shift is rounded: those whose largest, the last of the table's quantiles, stays below half a pixel."""
    from vispeg.effects.common.field import _quantiles
    from vispeg.worlds.sensor import sensor

    (jitter,) = (r for r in sensor(name) if r.effect == "lateral_jitter")
    drawn, stated = jitter.params["sd"], re.search(r"(\d+) % of the draws are too small", jitter.source)
    assert stated and drawn.at(0.0) == 0.0
    assert 0.5 / _quantiles().max() / drawn.at(1.0) == pytest.approx(int(stated[1]) / 100, abs=0.005)
