"""Both rewards against their formulas, and what an episode of each is told."""

from pathlib import Path

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.expert import Expert
from vispeg.task.peg.rewards import REWARDS
from vispeg.task.peg.task import PegInHoleVec
from vispeg.task.peg.terms import TERMS
from vispeg.task.rewards import Moment
from vispeg.task.world_file import load_world

shaped, paper = (REWARDS.of(name).dense for name in ("shaped", "paper"))
GOAL = np.array([0.0, 0.0, -0.02])


def moment(tip, force=0.0, action=(0.0, 0.0, 0.0)):
    tip = np.atleast_2d(tip)
    return Moment(tip, GOAL, np.full(len(tip), force), np.tile(action, (len(tip), 1)), 0.05)


def test_shaped_is_its_equation_at_one_point():
    d, lateral = np.sqrt(0.005**2 + 0.02**2), 0.005
    r_l = np.exp(-0.5 * (lateral / 0.002) ** 2) - 1
    expected = -0.5 * d / 0.05 + 0.25 * r_l - 0.2 * (10 / 40) ** 2
    assert shaped(moment([0.003, 0.004, 0.0], force=10.0))[0] == pytest.approx(expected)


def test_paper_is_its_equations_at_one_point():
    """(20, 20, 50) mm cost 0.1 * 0.0574 + 0.9 * 0.09 = 0.0867; full motion of two axes costs 0.001; force nothing."""
    at = moment(GOAL - [0.02, 0.02, 0.05], force=100.0, action=(1.0, -1.0, 0.0))
    assert paper(at)[0] == pytest.approx(-(0.1 * np.sqrt(0.0033) + 0.9 * 0.09) - 0.001, abs=1e-12)


@pytest.mark.parametrize("reward", [shaped, paper])
def test_it_rises_all_along_the_way_in(reward):
    way = np.stack([np.zeros(50), np.zeros(50), np.linspace(0.05, -0.02, 50)], axis=1)
    assert np.all(np.diff(reward(moment(way))) > 0)


def returns(reward):
    """Reward of every step of an episode that the expert finishes, and whether it succeeded."""
    env = PegInHoleVec(1, "nominal", reward=reward)
    obs, _ = env.reset(seed=3)
    expert, got, over, told = Expert(env.config, 1), [], False, {}
    while not over:
        obs, reward, terminated, truncated, told = env.step(expert.act(obs))
        got.append(float(reward[0]))
        over = bool(terminated[0] or truncated[0])
    return got, bool(told["success"][0])


def test_an_episode_of_the_paper_ends_in_its_bonus_and_costs_less_than_that_on_the_way():
    (ours, first), (paper, second) = returns("shaped"), returns("paper")
    assert first and second and len(ours) == len(paper), "the reward changes no motion"
    assert 49.9 < paper[-1] <= 50 and -6.5 < sum(paper[:-1]) < 0
    assert 4 < ours[-1] <= 5


def test_a_force_limit_costs_in_ours_alone():
    for reward, at_least in (("shaped", 5.0), ("paper", 0.0)):
        env = PegInHoleVec(1, "nominal", reward=reward, force_abort=0.1)
        env.reset(seed=3)
        gain, over = 0.0, False
        while not over:
            _, gain, terminated, truncated, _ = env.step(np.array([[0.0, 0.0, -1.0]]))
            over = bool(terminated[0] or truncated[0])
        assert terminated[0] and at_least <= -gain[0] < at_least + 5


def test_a_world_may_name_it_and_only_then_has_another_hash(tmp_path):
    for name, line in (("plain", ""), ("same", "reward: shaped"), ("paper", "reward: paper")):
        (tmp_path / f"{name}.yaml").write_text(f"format: vispeg-world/1\nbase: goal\ntask: {{{line}}}\n")
    plain, same, paper = (load_world(tmp_path / f"{name}.yaml") for name in ("plain", "same", "paper"))
    assert plain.hash == same.hash != paper.hash
    assert PegInHoleVec(1, tmp_path / "paper.yaml").config.reward == "paper"
    with pytest.raises(UserError, match="reward: unknown reward.*got 'papr'.*did you mean 'paper'"):
        PegConfig(reward="papr")


def test_a_world_may_weigh_the_terms_itself(tmp_path):
    """Its reward is that sum, and it is another world; pairs, as JSON keeps them, state the same."""
    own = "{distance: -2, force: -1, success: 7}"
    (tmp_path / "own.yaml").write_text(f"format: vispeg-world/1\nbase: goal\ntask: {{reward: {own}}}\n")
    (tmp_path / "plain.yaml").write_text("format: vispeg-world/1\nbase: goal\n")
    file = load_world(tmp_path / "own.yaml")
    assert file.hash != load_world(tmp_path / "plain.yaml").hash
    env = PegInHoleVec(1, file.path)
    m = moment([[0.003, 0.0, 0.01]], force=20.0)
    expected = -2 * np.linalg.norm(m.tip - GOAL) / 0.05 - (20 / 40) ** 2
    assert env.sim.reward.dense(m)[0] == pytest.approx(expected) and env.sim.reward.success == 7
    assert PegConfig.of({"reward": [["distance", -2], ["force", -1], ["success", 7]]}) == env.config


@pytest.mark.parametrize(
    ("reward", "message"),
    [
        ({"lateral": 1}, "unknown reward term.*'lateral'.*distance"),
        ({"distance": "much"}, "task.reward: wrong reward"),
        ({}, "task.reward: wrong reward"),
        (3, "task.reward: wrong reward"),
        ({"distance": float("inf")}, "reward.distance: not finite"),
    ],
)
def test_weights_that_are_none_are_refused(reward, message):
    with pytest.raises(UserError, match=message):
        PegConfig.of({"reward": reward}, "w.yaml")


def test_the_guide_lists_the_terms_and_weights():
    """docs/task.md: every observation term with its unit and scale, every reward term with its weights."""
    guide = (Path(__file__).resolve().parents[2] / "docs" / "task.md").read_text(encoding="utf-8")
    for t in TERMS:
        assert f"| {t.unit} | {t.scale:g} | {t.to} | {t.about} |" in guide, t.name
    for term in (*(t.name for t in REWARDS.terms), "success", "abort"):
        weights = [f"{REWARDS.named[name][term]:g}" if term in REWARDS.named[name] else "" for name in REWARDS.named]
        (line,) = [line for line in guide.splitlines() if line.startswith(f"| `{term}` |") and line.count("|") == 5]
        assert [cell.strip() for cell in line.split("|")[3:5]] == weights, term
