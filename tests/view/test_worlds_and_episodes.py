"""Worlds change as the sliders say, and an episode on the page is the episode of the task."""

import numpy as np
import pytest

from vispeg.core.errors import UserError
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
    Draws(lambda name, value: heard.append((name, value))).draw("nominal", 5, {})
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


def test_a_saved_world_has_the_moved_range_and_is_what_is_drawn(tmp_path):
    heard = []
    made = Draws(lambda name, value: heard.append((name, value)))
    r = next(r for r in ranges("searching") if r.where in ("peg", "hole"))
    moved = {(r.effect, r.where, r.param): (r.high, r.most)}
    saved = made.save(tmp_path / "mine.yaml", "searching", moved)
    world = load_world(saved)
    assert world.name == "mine"
    changed = {(e.effect, e.where, name): (value.low, value.high)
               for e, f in zip(world.world.ranges, load_world("searching").world.ranges, strict=True)
               for name, value in e.params.items() if value != f.params[name]}  # fmt: skip
    assert changed == moved
    made.draw("searching", 2, moved)
    made.draw(saved, 2, {})
    made.draw("searching", 2, {})
    from_page, from_file, without = told(heard, "drawn")
    assert from_page.values == from_file.values != without.values
    with pytest.raises(UserError, match="exists already"):
        made.save(tmp_path / "mine.yaml", "searching", {})


def test_a_world_replaces_no_file_on_which_it_is_based(tmp_path):
    made = Draws(lambda name, value: None)
    first = made.save(tmp_path / "first.yaml", "nominal", {})
    second = made.save(tmp_path / "second.yaml", first, {})
    for opened in (first, second):
        before = (tmp_path / "first.yaml").read_text()
        with pytest.raises(UserError, match="based on this file"):
            made.save(tmp_path / "first.yaml", opened, {}, overwrite=True)
        assert (tmp_path / "first.yaml").read_text() == before
    assert load_world(made.save(tmp_path / "second.yaml", first, {}, overwrite=True)).name == "second"
