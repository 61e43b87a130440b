"""Worlds change as the sliders say, and an episode on the page is the episode of the task."""

import numpy as np
import pytest

from vispeg.evaluation.entrants import entrant
from vispeg.evaluation.players import player
from vispeg.task.environments.vector import TaskVec
from vispeg.task.world_file import load_world
from vispeg.view.episode import Episodes
from vispeg.view.world_draw import Draws, in_words, ranges


def told(heard, name):
    return [value for at, value in heard if at == name]


@pytest.mark.parametrize("world", ["randomized", "P", "nominal"])
def test_every_slider_starts_at_the_world_s_range_and_stays_in_the_effect_s_bounds(world):
    from vispeg.core.effect import effect

    for r in ranges(world):
        param = effect(r.effect).params[r.param]
        assert param.low <= r.least <= r.low < r.high <= r.most <= param.high


def test_an_episode_is_that_of_the_task():
    heard = []
    Episodes(lambda name, value: heard.append((name, value))).play("expert", ("nominal", "searching"), 3)
    cells, moments = told(heard, "cell"), told(heard, "moment")
    assert [c[0] for c in cells] == [0, 1] and [c[2] for c in cells] == ["nominal", "searching"]
    env = TaskVec(1, "nominal")
    policy = player(entrant("expert"), env.config)
    obs, _ = env.reset(seed=[3])
    policy.reset(1)
    mine = [m for side, m in moments if side == 0]
    for moment in mine[:-1]:
        assert np.array_equal(moment.qpos, env.sim.snapshot(0).qpos)
        obs, _, terminated, _, _ = env.step(policy.act(obs))
    assert terminated[0] and mine[-1].outcome == "success" and not mine[0].outcome
    assert np.linalg.norm(mine[-1].offset[:2]) < 3 < np.linalg.norm(mine[0].offset)
    env.close()


def test_a_draw_shows_what_the_cameras_of_that_episode_see():
    heard = []
    Draws(lambda name, value: heard.append((name, value))).draw("nominal", 5)
    (drawn,) = told(heard, "drawn")
    env = TaskVec(1, "nominal", obs_mode="rgbd")
    obs, _ = env.reset(seed=[5])
    assert np.array_equal(drawn.qpos, env.sim.snapshot(0).qpos)
    assert {key for key in obs if key.startswith(("rgb", "depth"))} == set(drawn.pictures) - {"from outside"}
    assert all(picture.dtype == np.uint8 and picture.ndim == 3 for picture in drawn.pictures.values())
    env.close()


def test_what_was_drawn_is_told_in_the_words_and_units_of_the_sliders():
    assert in_words("link_mass(link1)", {"mass": 0.287}) == ("Link mass of link 1", "mass 0.287 kg")
    assert in_words("viscous_friction(all)", {"damping": 2.4})[1] == "damping 2.40 N m s/rad"
    assert in_words("object_mass(peg)", {"scale": 1.2})[1] == "scale 1.20"


def test_a_saved_world_is_read_and_kept(tmp_path):
    from vispeg.core.errors import UserError

    made = Draws(lambda name, value: None)
    text = "format: vispeg-world/1\nname: mine\nbase: [nominal]\neffects: []\n"
    assert load_world(made.save(tmp_path / "mine.yaml", text)).name == "mine"
    with pytest.raises(UserError, match="exists already"):
        made.save(tmp_path / "mine.yaml", text)
