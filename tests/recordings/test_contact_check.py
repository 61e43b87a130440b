"""What a recording shows of contact is told from its own forces and speeds."""

from dataclasses import replace

import numpy as np

from vispeg.core.effect import REGISTRY, Effect
from vispeg.recordings.checks.contact_check import Touched, examine, said, together
from vispeg.recordings.checks.extent import NEEDS
from vispeg.recordings.regimes import FREE, IMPACT, INSIDE, PRESS, SLIDE

RATE = 100.0


def made(*pieces, goal=True, yaw=0.0, tilt=0.0, blows=()):
    """A recording from pieces (regime, seconds, N, tip velocity m/s), after a second in free air."""
    pieces = ((FREE, 1.0, 0.0, (0.0, 0.0, 0.0)), *pieces)
    count = [round(seconds * RATE) for _, seconds, _, _ in pieces]
    regime, force = (np.repeat([p[k] for p in pieces], count) for k in (0, 2))
    velocity = np.repeat(np.array([p[3] for p in pieces], float), count, axis=0)
    n = len(regime)
    lean = np.where(regime == FREE, tilt, 0.0)
    return Touched(np.arange(n) / RATE, np.zeros(n, int), regime, force, velocity, lean, np.full(n, yaw), goal, blows)


def press(newton, seconds=1.0):
    return (PRESS, seconds, newton, (0.0, 0.0, 0.0))


def slide(x, seconds=1.0):
    return (SLIDE, seconds, 8.0, (x, 0.0, 0.0))


def air(seconds=0.5):
    return (FREE, seconds, 0.0, (0.0, 0.0, -0.02))


def hit(speed):
    return [(FREE, 0.3, 0.0, (0.0, 0.0, -speed)), (IMPACT, 0.03, 30.0, (0.0, 0.0, 0.0)), press(5.0, 0.2), air(0.2)]


def test_nothing_slid():
    found = examine(made(press(5.0), press(20.0)))
    assert found.excited["contact_friction"] == "nothing slid"
    assert found.excited["contact_stiffness"] == "" and found.excited["hole_tilt"] == ""
    assert found.excited["hole_clearance"] == "never inserted and pressed"
    assert found.excited["contact_damping"] == "nothing was hit from free air"
    assert "60 N" in found.excited["gripper_slip"]


def test_friction_takes_a_slide_there_and_back():
    assert "one direction" in examine(made(slide(0.02))).excited["contact_friction"]
    found = examine(made(slide(0.02), slide(-0.02)))
    assert found.excited["contact_friction"] == "" and found.directions == 2
    assert np.isclose(found.slide_speed, 0.02)


def test_compliance_takes_two_forces():
    assert "one force" in examine(made(press(10.0, 2.0))).excited["fixture_compliance"]
    assert examine(made(press(5.0), press(20.0))).excited["fixture_compliance"] == ""


def test_damping_takes_a_blow_that_can_be_run_again():
    """Which is what a diagnosis goes by: an impact without free air before it or a stated controller is none."""
    assert examine(made(*hit(0.02), *hit(0.05))).excited["contact_damping"] == "nothing was hit from free air"
    assert "mode osc" in examine(made(*hit(0.02), blows=None)).excited["contact_damping"]
    found = examine(made(*hit(0.02), *hit(0.05), blows=(0.02,)))
    assert found.excited["contact_damping"] == found.excited["restitution"] == "" and np.allclose(
        found.hits, [0.02, 0.05]
    )
    some = [examine(made(blows=None)), examine(made()), found]
    assert together(some)["contact_damping"] == "" and "free air" in together(some[:2])["contact_damping"]


def test_the_hole_needs_to_be_touched_and_believed_in():
    inside = (INSIDE, 1.0, 6.0, (0.0, 0.0, 0.0))
    assert examine(made(inside)).excited["hole_offset"] == ""
    assert examine(made(inside, goal=False)).excited["hole_offset"] == ""
    assert "`cell`" in examine(made(press(5.0), goal=False)).excited["hole_offset"]


def test_mass_takes_a_tilt_in_free_air_and_the_zero_a_second_of_it():
    assert examine(made(tilt=0.5)).excited["tool_mass"] == ""
    assert "tilted" in examine(made(tilt=0.1)).excited["tool_mass"]
    short = examine(replace(made(press(5.0)), regime=np.full(200, PRESS)))
    assert "free air" in short.excited["wrench_bias"] and short.begins_free == 0.0


def test_the_speed_of_a_hit_is_of_its_own_episode():
    """Whatever the numbers of the episodes: here the second one has the lower number."""
    both = made((FREE, 1.0, 0.0, (0.0, 0.0, -0.5)), (FREE, 0.03, 0.0, (0.0, 0.0, -0.01)), (IMPACT, 0.1, 9.0, (0, 0, 0)))
    assert examine(both).hits == (0.5,)
    assert examine(replace(both, episode=np.where(np.arange(len(both.time)) < 200, 7, 3))).hits == (0.01,)


def test_grip_is_told_from_hole_by_two_insertions_with_the_flange_turned():
    inside = (INSIDE, 1.0, 6.0, (0.0, 0.0, 0.0))
    straight, turned = examine(made(inside)), examine(made(inside, yaw=1.5))
    assert "turned by 90" in straight.excited["grip_pose"] and "turned by 90" in turned.excited["grip_pose"]
    assert together([straight, turned])["grip_pose"] == ""
    assert together([straight, straight])["grip_pose"] != ""
    assert "turned by 90" in together([straight, examine(made(press(5.0)))])["grip_pose"], "one of them was inserted"
    turned_outside = made(press(5.0), inside)
    yaw = np.where(turned_outside.regime == PRESS, 1.5, 0.0)
    assert "turned by 90" in examine(replace(turned_outside, yaw=yaw)).excited["grip_pose"]
    both = together([examine(made(slide(0.02), slide(-0.02))), examine(made(press(5.0), press(20.0)))])
    assert both["contact_friction"] == "" and both["contact_stiffness"] == "" and both["gripper_slip"]


def test_recordings_are_judged_together_and_lack_what_all_of_them_lack():
    """Presses with one force each are two forces; a slide there in one and back in the other is both directions. The
    reason is that of all recordings, not of whichever shows most.
    """
    light, firm = examine(made(press(5.0))), examine(made(press(20.0)))
    assert "one force" in light.excited["contact_stiffness"] and "one force" in firm.excited["contact_stiffness"]
    assert together([light, firm])["contact_stiffness"] == "" != together([light, light])["contact_stiffness"]
    there, back = examine(made(slide(0.02))), examine(made(slide(-0.02)))
    assert together([there, back])["contact_friction"] == ""
    assert "one direction" in together([there, light, firm])["contact_friction"], "though a press shows more effects"
    tilted = examine(made(tilt=0.5))
    assert together([light, tilted])["object_mass"].startswith("cannot be told from tool_mass")


def test_what_each_effect_needs_is_told_of_a_users_own_too():
    """An effect says what it needs; it is listed with those of the library, and its pair by the effect's own word."""
    wanted = {name: e.needs for name, e in REGISTRY.items() if e.needs}
    assert set(wanted.values()) == set(NEEDS)

    class LatchSpring(Effect):
        name, family, params, needs, told_from = "latch_spring", "contact", {}, "weighing", {"tool_com": "free"}

    try:
        found = examine(made(press(5.0), press(20.0), tilt=0.5)).excited
        assert found["latch_spring"].startswith("cannot be told from tool_com: weigh")
        assert found["object_mass"].startswith("cannot be told from tool_mass: weigh")
    finally:
        del REGISTRY["latch_spring"]


def test_seconds_and_histograms_add_up():
    found = examine(made(press(3.0), press(15.0, 2.0), slide(0.02), air()))
    assert np.isclose(found.seconds["press"], 3.0) and np.isclose(found.seconds["free"], 1.5)
    for name, bins in found.forces.items():
        assert np.isclose(sum(bins), found.seconds[name])
    assert np.allclose(found.forces["press"], [0, 1, 0, 2, 0, 0, 0])
    lines = said(found)
    assert "3.0 s pressing" in lines[0] and any("contact_damping, restitution: nothing was hit" in x for x in lines)
