"""A policy that turns the peg: what it commands is what happens, it sees it, and the rest is held."""

import numpy as np
import pytest

from vispeg.control.laws import rotation_vector
from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.expert import Expert
from vispeg.task.peg.task import PegInHoleVec
from vispeg.task.peg.terms import TERMS
from vispeg.task.terms import Observation
from vispeg.worlds.world import World

ALL = ("x", "y", "z", "rx", "ry", "rz")


def turned_by(sim: TaskSimulation) -> np.ndarray:
    """True rotation vector (3,) rad of the flange from straight down."""
    sim.seen.see(sim.cell.x.q, sim.cell.x.dq)
    return rotation_vector(sim.seen.straight, sim.seen.turn)[0]


@pytest.mark.parametrize("axis", ["rx", "ry", "rz"])
def test_a_commanded_turn_is_made_and_seen_about_its_axis_alone(axis):
    config = PegConfig(dof=("x", "y", "z", axis), turn=0.04)
    sim = TaskSimulation(World(), config, 1)
    sim.reset(np.arange(1), [0])
    for _ in range(3):
        sim.step(np.array([[0.0, 0.0, 0.0, 1.0]]))
    way = ALL.index(axis) - 3
    turn = turned_by(sim)
    assert 0.04 < turn[way] < 0.12  # three steps of up to 0.04 rad; the spring lags
    assert np.abs(np.delete(turn, way)).max() < 0.002
    observed = Observation(TERMS, config)
    seen = sim.observation()["policy"][0][: observed.policy_size]
    assert len(seen) == 12 + 4 + 6
    assert observed.term("turn").scale * seen[observed["turn"]] == pytest.approx(turn, abs=0.003)


@pytest.mark.parametrize("axis", ["rx", "ry"])
def test_a_turn_is_about_the_pegs_tip_and_the_tip_is_what_is_seen(axis):
    """The flange goes round the tip: sideways by the tip's distance times the angle's sine."""
    sim = TaskSimulation(World(), PegConfig(dof=("x", "y", "z", axis), turn=0.04), 1)
    sim.reset(np.arange(1), [0])

    def tip():
        return sim.cell.site_position("tip")[0].copy()

    flange, before = sim.seen.flange[0].copy(), tip()
    for _ in range(3):
        sim.step(np.array([[0.0, 0.0, 0.0, 1.0]]))
        seen = 0.03 * sim.observation()["policy"][0][:3] + sim.seen.believed[0]
        assert seen == pytest.approx(tip(), abs=1e-3)
    turn = turned_by(sim)
    aside = sim.scene.tip * np.sin(np.linalg.norm(turn))
    assert aside > 0.008
    assert np.linalg.norm((sim.seen.flange[0] - flange)[:2]) == pytest.approx(aside, abs=0.2 * aside)
    assert np.linalg.norm(tip() - before) < 0.25 * aside


def test_translations_alone_see_what_they_saw():
    sizes = [Observation(TERMS, PegConfig(dof=dof)).policy_size for dof in (("x", "y", "z"), ("z",))]
    assert sizes == [15, 13]


@pytest.mark.parametrize("dof", [ALL, ("x", "y", "z", "rx", "ry"), ("z", "y", "x")])
def test_the_expert_knows_its_directions_by_name(dof):
    env = PegInHoleVec(4, world="searching", autoreset_mode="Disabled", dof=dof)
    expert, obs = Expert(env.config, 4), env.reset(seed=5)[0]
    done, found = np.zeros(4, bool), np.zeros(4, bool)
    for _ in range(env.config.steps):
        obs, _, terminated, truncated, info = env.step(expert.act(obs))
        ends = (terminated | truncated) & ~done
        found |= ends & np.array(info.get("success", np.zeros(4)), bool)
        done |= ends
    assert found.sum() >= 3
