"""Rules and formulas of the task: categories, reward, stacking, controller."""

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.world import World
from vispeg.task.config import TaskConfig
from vispeg.task.observe import Stack
from vispeg.task.outcome import CATEGORIES, Track
from vispeg.task.reward import reward
from vispeg.task.simulation import PegSimulation, turned

CONFIG = TaskConfig()


def track(depths, lateral=0.0, force=5.0, tilt=0.0, slip=0.0):
    """A track that saw these depths (m)."""
    t = Track()
    for d in depths:
        t.add(CONFIG, np.array([force]), np.array([lateral, 0.0, -d]), tilt, slip)
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
    config = TaskConfig(dwell=2)
    t = Track()
    for d in (0.021, 0.0, 0.021):
        t.add(config, np.array([1.0]), np.array([0, 0, -d]), 0.0, 0.0)
        assert t.verdict(config) is None
    t.add(config, np.array([1.0]), np.array([0, 0, -0.021]), 0.0, 0.0)
    assert t.verdict(config) == "success"


def test_reward_against_its_formula():
    """Equation (4) by hand at one point, and monotone along the way in."""
    tip, goal = np.array([[0.003, 0.004, 0.0]]), 0.02
    d, lateral = np.sqrt(0.005**2 + 0.02**2), 0.005
    r_l = np.exp(-0.5 * (lateral / 0.002) ** 2) - 1
    expected = -0.5 * d / 0.05 + 0.25 * r_l - 0.2 * (10 / 40) ** 2
    assert reward(tip, goal, np.array([10.0]), 0.05)[0] == pytest.approx(expected)
    way = np.stack([np.zeros(50), np.zeros(50), np.linspace(0.05, -0.02, 50)], axis=1)
    assert np.all(np.diff(reward(way, goal, np.zeros(50), 0.05)) > 0)


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
    sim = PegSimulation(World(), TaskConfig(force_limit=15.0, steps=1000, force_abort=1e9), 1)
    sim.reset(np.arange(1), [0])
    for k in range(40):  # 20 mm aside of the hole, then down
        aside = 0.02 - sim.tip_in_hole()[0, 0]
        sim.step(np.array([[np.clip(aside / 0.010, -1, 1), -sim.tip_in_hole()[0, 1] / 0.010, -1.0 if k > 8 else 0.0]]))
    assert sim.tracks[0].forces[-1].mean() == pytest.approx(15.0, rel=0.1)
    assert sim.wrench[0, 2] == pytest.approx(sim.tracks[0].forces[-1][-4:].mean(), rel=0.15)  # the wrist feels it too


def test_free_motion_reaches_what_was_asked():
    """An offset of the action's size, to a few per cent within a few policy steps, other axes still."""
    sim = PegSimulation(World(), TaskConfig(), 1)
    sim.reset(np.arange(1), [0])
    before = sim.tip_in_hole()[0]
    sim.step(np.array([[1.0, 0.0, 0.0]]))
    for _ in range(4):
        sim.step(np.zeros((1, 3)))
    moved = sim.tip_in_hole()[0] - before
    assert moved[0] > 0.0065 and np.abs(moved[1:]).max() < 1e-3


@pytest.mark.parametrize(
    "bad",
    [
        {"policy_period": 0.0103},
        {"dof": ("x", "q")},
        {"start_height": (0.05, 0.01)},
        {"stack": 0},
        {"clearance_mm": -1.0},
    ],
)
def test_impossible_tasks_are_refused(bad):
    """With the key at fault."""
    with pytest.raises(UserError, match=next(iter(bad)).split("_")[0]):
        TaskConfig(**bad)
