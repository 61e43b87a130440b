"""Rules and formulas of the task: categories, stacking, controller."""

import numpy as np
import pytest

from vispeg.control.laws import turned
from vispeg.core.errors import UserError
from vispeg.interface.observer import Stack
from vispeg.render.cameras.standard import GOAL, standard_cameras
from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.eyes import task_cameras
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.outcome import CATEGORIES, PegTrack
from vispeg.worlds.world import World

CONFIG = PegConfig()


def track(depths, lateral=0.0, force=5.0, tilt=0.0, slip=0.0, config=CONFIG):
    """A track that saw these depths (m)."""
    t = PegTrack()
    for d in depths:
        t.add(config, np.array([force]), np.array([lateral, 0.0, -d]), tilt=tilt, slip=slip)
    return t


@pytest.mark.parametrize(
    ("seen", "category"),
    [
        (track([0.021]), "success"),
        (track([0.001], force=500.0), "force limit"),
        (track([0.001], slip=0.01), "slip"),
    ],
)
def test_what_ends_an_episode(seen, category):
    """At once, by a fixed order: force before slip before success."""
    assert seen.verdict(CONFIG) == category and category in CATEGORIES


@pytest.mark.parametrize(
    ("seen", "category"),
    [
        (track([-0.03] * 5, force=0.0), "approach"),
        (track([-0.001] * 5), "search"),
        (track([0.01] * 5), "jam"),
        (track([0.01] * 5, tilt=0.4), "wedge"),
        (track([0.004, 0.006, 0.008, 0.010, 0.010]), "timeout"),
    ],
)
def test_what_time_out_means(seen, category):
    """By what was touched, entered, and still moving."""
    assert seen.verdict(CONFIG) is None and seen.at_time(CONFIG) == category


def test_deep_beside_the_hole_is_no_success():
    """Height alone is neither success nor having entered."""
    beside = track([0.024] * 5, lateral=0.03, tilt=0.4)
    assert beside.verdict(CONFIG) is None and beside.at_time(CONFIG) == "search"


def test_dwell_counts_steps_in_a_row():
    """Leaving starts it anew."""
    config = PegConfig(dwell=2)
    t = PegTrack()
    for d in (0.021, 0.0, 0.021):
        t.add(config, np.array([1.0]), np.array([0, 0, -d]))
        assert t.verdict(config) is None
    t.add(config, np.array([1.0]), np.array([0, 0, -0.021]))
    assert t.verdict(config) == "success"


def test_success_may_ask_for_a_smaller_lateral_error():
    """Half the peg's diameter if nothing is said; a peg that is deep but aside is not stuck, it ran out of time."""
    assert track([0.021], lateral=0.0079).verdict(CONFIG) == "success"
    assert track([0.021], lateral=0.0081).verdict(CONFIG) is None
    strict = PegConfig(success_lateral=0.001)
    assert track([0.021], lateral=0.0009, config=strict).verdict(strict) == "success"
    aside = track([0.021] * 5, lateral=0.0011, config=strict)
    assert aside.verdict(strict) is None and aside.at_time(strict) == "timeout"


def test_success_may_ask_for_a_smaller_force():
    """Up to `force_abort` if nothing is said; steps that press harder do not count, however long."""
    assert track([0.021], force=199.0).verdict(CONFIG) == "success"
    gentle = PegConfig(success_force=20.0, dwell=2)
    assert track([0.021] * 2, force=19.0, config=gentle).verdict(gentle) == "success"
    hard = track([0.021] * 5, force=21.0, config=gentle)
    assert hard.verdict(gentle) is None and hard.at_time(gentle) == "timeout"
    hard.add(gentle, np.array([19.0, 21.0]), np.array([0, 0, -0.021]))
    assert hard.dwell == 0, "the greatest force of a step counts"


def test_stack_keeps_the_newest_first():
    """And a row that begins anew repeats its first observation."""
    s = Stack(3, 2, 1)
    s.fill(np.arange(2), np.array([[1.0], [10.0]]))
    s.push(np.array([[2.0], [20.0]]))
    assert s.flat().tolist() == [[2, 1, 1], [20, 10, 10]]
    s.fill(np.array([1]), np.array([[0.0], [5.0]]))
    assert s.flat().tolist() == [[2, 1, 1], [5, 5, 5]]


def test_turned_is_a_rotation():
    """A quarter turn about z, and nothing for nothing."""
    quat = np.array([[1.0, 0, 0, 0]])
    assert turned(quat, np.array([[0, 0, np.pi / 2]]))[0] == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    assert turned(quat, np.zeros((1, 3)))[0] == pytest.approx([1, 0, 0, 0])


def test_the_controller_is_a_spring_that_yields():
    """Pressed into the block, the contact force settles at the controller's limit."""
    sim = TaskSimulation(World(), PegConfig(force_limit=15.0, steps=1000, force_abort=1e9), 1)
    sim.reset(np.arange(1), [0])
    for k in range(40):  # 20 mm aside of the hole, then down
        aside = 0.02 - sim.tip_in_goal()[0, 0]
        sim.step(np.array([[np.clip(aside / 0.010, -1, 1), -sim.tip_in_goal()[0, 1] / 0.010, -1.0 if k > 8 else 0.0]]))
    assert sim.tracks[0].forces[-1].mean() == pytest.approx(15.0, rel=0.1)
    assert sim.seen.wrench[0, 2] == pytest.approx(
        sim.tracks[0].forces[-1][-4:].mean(), rel=0.15
    )  # the wrist feels it too


def test_free_motion_reaches_what_was_asked():
    """An offset of the action's size, to a few per cent within a few policy steps, other axes still."""
    sim = TaskSimulation(World(), PegConfig(), 1)
    sim.reset(np.arange(1), [0])
    before = sim.tip_in_goal()[0]
    sim.step(np.array([[1.0, 0.0, 0.0]]))
    for _ in range(4):
        sim.step(np.zeros((1, 3)))
    moved = sim.tip_in_goal()[0] - before
    assert moved[0] > 0.0065 and np.abs(moved[1:]).max() < 1e-3


NAN = float("nan")


@pytest.mark.parametrize(
    "bad",
    [
        {"policy_period": 0.0103},
        {"policy_period": NAN},
        {"control_period": 0},
        {"control_period": -0.005},
        {"dof": ("x", "q")},
        {"start_height": (0.05, 0.01)},
        {"start_height": (NAN, 0.01)},
        {"start_radius": NAN},
        {"start_radius": -1},
        {"stack": 0},
        {"dwell": 0},
        {"dwell": 100},
        {"stiffness": (-300.0, 400.0)},
        {"stiffness": (300.0, 0.0)},
        {"force_limit": float("inf")},
        {"solref": (0, 1)},
        {"solref": (-5, 1)},
        {"clearance_mm": -1.0},
        {"fixture": (2.0, 0.0, 0.05)},
        {"fixture": (0.6, NAN, 0.05)},
        {"block": 0.005},
        {"block": 1.0},
        {"success_lateral": 0.009},
        {"success_lateral": -0.001},
        {"success_force": 201.0},
        {"success_force": -1.0},
    ],
)
def test_impossible_tasks_are_refused(bad):
    """With the key at fault, what would do and what came; the same from a file's mapping."""
    key = next(iter(bad))
    for make in (lambda: PegConfig(**bad), lambda: PegConfig.of(bad, "w.yaml")):
        with pytest.raises(UserError, match=rf"\b{key}: .*got ") as error:
            make()
        assert "expected" in str(error.value) or "choices" in str(error.value)


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("stack", 2.5, "a whole number"),
        ("steps", True, "a whole number"),
        ("clearance_mm", "3", "a number"),
        ("shape", 1, "a text"),
        ("start_height", [0.02], "a list of 2 numbers"),
        ("start_height", 0.02, "a list of 2 numbers"),
        ("stiffness", [300], "a list of 2 numbers"),
        ("stiffness", [300, "400"], "a list of 2 numbers"),
        ("solref", [1], "a list of 2 numbers"),
        ("fixture", [0.6, 0], "a list of 3 numbers"),
        ("hole_origin", ["a", 0, 0], "a list of numbers"),
        ("dof", "xyz", "a list of texts"),
        ("cameras", [1], "a list of texts"),
    ],
)
def test_wrong_types_are_refused(key, value, expected):
    """With file, key, what would do and what came."""
    with pytest.raises(UserError) as error:
        PegConfig.of({key: value}, "w.yaml")
    assert str(error.value) == f"w.yaml: task.{key}: wrong type; expected {expected}; got {value!r}"


def test_whole_numbers_do_where_any_number_does():
    """And lists of any length where a length is not said."""
    given = {"clearance_mm": 3, "fixture": [0.6, 0, 0.05], "dof": ["x"], "hole_origin": [], "stiffness": [300, 400]}
    config = PegConfig.of(given)
    assert config.fixture == PegConfig().fixture and config.dof == ("x",) and config.hole_origin == ()


def test_the_fixture_stands_where_the_task_says():
    """The hole, where a blind policy looks for it, the start above it, what is drawn, and the camera beside it."""
    place = (0.55, 0.05, 0.08)
    sim = TaskSimulation(World(), PegConfig.of({"fixture": list(place), "cameras": ["external"]}), 2, "proprio")
    sim.reset(np.arange(2), [0, 1])
    np.testing.assert_allclose(sim.cell.site_position("goal"), [place] * 2, atol=1e-9)
    np.testing.assert_allclose(sim.seen.believed, [place] * 2)
    np.testing.assert_allclose(sim.bodies(0)["fixture"][:3], place)
    (camera,) = task_cameras(sim.scene, sim.config, {})
    np.testing.assert_allclose(np.subtract(camera.pos, standard_cameras()[2].pos), np.subtract(place, GOAL), atol=1e-12)
    assert np.all(np.abs(sim.tip_in_goal()[:, :2]) < 0.021) and np.all(sim.tip_in_goal()[:, 2] > 0.019)


def test_a_start_beyond_the_joint_limits_is_refused():
    """Inverse kinematics alone would find it."""
    sim = TaskSimulation(World(), PegConfig(fixture=(0.42, 0.42, 0.05)), 1)
    with pytest.raises(UserError, match="out of the arm's reach"):
        sim.reset(np.arange(1), [0])
