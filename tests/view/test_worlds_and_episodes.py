"""Worlds change as the sliders say, and an episode on the page is the episode of the task."""

import re
import shlex
import time

import numpy as np
import pytest

import vispeg
from vispeg.core.errors import UserError
from vispeg.datasets.read import Dataset
from vispeg.evaluation.entrants import entrant
from vispeg.evaluation.films.moments import Moment
from vispeg.evaluation.players import player
from vispeg.task.environments.vector import TaskVec
from vispeg.task.world_file import load_world
from vispeg.view import html
from vispeg.view.episode import Episodes
from vispeg.view.world_draw import Draws, changed_text, in_words, ranges


@pytest.fixture
def place(tmp_path):
    """What the pages of a server share that nobody looks at."""
    viser = pytest.importorskip("viser", reason="the extra 'view' is not installed")
    from vispeg.view.gate import free_port
    from vispeg.view.place import Place

    server = viser.ViserServer(host="127.0.0.1", port=free_port(None), verbose=False)
    yield Place(server, tmp_path / "out", 1)
    server.stop()


def until(true, seconds=240):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def said(element):
    """The words of each command that a page shows."""
    lines = re.findall("<code>(.*?)</code>", element.content, re.DOTALL)
    return [shlex.split(line) for line in lines]


def told(heard, name):
    return [value for at, value in heard if at == name]


def test_a_moved_range_of_all_places_leaves_those_of_single_places(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "format: vispeg-world/1\nbase: nominal\neffects:\n"
        "- {effect: exposure, where: all, params: {stops: {uniform: [-0.5, 0.5]}}}\n"
        "- {effect: exposure, where: external, params: {stops: {uniform: [1.0, 2.0]}}}\n"
        "- {effect: blur, where: external, params: {sigma: {uniform: [0.5, 1.0]}}}\n"
    )
    saved = tmp_path / "saved.yaml"
    saved.write_text(changed_text(str(file), "saved", {("exposure", "all", "stops"): (-0.2, 0.2)}))
    now = {(r.effect, r.where): (r.low, r.high) for r in ranges(str(saved))}
    kept = {("exposure", "external"): (1.0, 2.0), ("blur", "external"): (0.5, 1.0)}
    assert now == kept | {("exposure", "all"): (-0.2, 0.2)}


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


@pytest.mark.slow
def test_an_episode_is_that_of_its_command_and_ends_the_one_that_still_plays(place):
    from vispeg.view.policy_page import PolicyPage

    page = PolicyPage(place)
    try:
        page.world.value = "searching"
        page.begin()
        until(lambda: page.sides[0].steps)
        page.world.value, page.beside.value, page.seed.value = "nominal", "searching", 3
        page.begin()
        until(lambda: not page.job.busy)
        assert not page.job.trouble.visible, page.job.trouble.content
        assert [side.world for side in page.sides] == ["nominal", "searching"]
        commands = said(page.commands)
        outs = {words[words.index("--out") + 1] for words in commands}
        assert len(outs) == 2
        for side, words in zip(page.sides, commands, strict=True):
            assert words[:3] == ["vispeg", "evaluate", "expert"]
            given = dict(zip(words[3::2], words[4::2], strict=True))
            made = vispeg.evaluate("expert", given["--world"], episodes=1, seed=int(given["--seed"]))
            (episode,) = made.episodes
            assert [m.time for m in side.steps] == pytest.approx(0.16 * np.arange(len(side.steps)))
            assert (side.steps[-1].time, side.steps[-1].outcome) == (pytest.approx(episode.time), episode.category)
            assert np.linalg.norm(side.steps[-1].offset[:2]) == pytest.approx(1e3 * episode.lateral_error, abs=1e-3)
    finally:
        page.close()


def test_no_force_is_drawn_after_an_episode_is_over():
    pytest.importorskip("viser", reason="the extra 'view' is not installed")
    from vispeg.view.policy_page import forces

    none = np.zeros(3)
    long, short = (
        [Moment(0.16 * k, none, {}, {}, np.array([3.0, 4.0, 0.0]), none, None) for k in range(n)] for n in (5, 3)
    )
    time, one, other = forces([short, long])
    np.testing.assert_allclose(time, 0.16 * np.arange(5))
    np.testing.assert_array_equal(one, [5, 5, 5, np.nan, np.nan])
    np.testing.assert_array_equal(other, [5] * 5)


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


def test_the_page_draws_the_first_episode_of_its_command(place, tmp_path):
    from vispeg.view.world_page import WorldPage

    page = WorldPage(place, "searching")
    try:
        page.seed.value = 3
        page.open()
        until(lambda: page.drawn.content and not page.job.busy)
        ((_, command, *words),) = said(page.commands)
        given = dict(zip(words[::2], words[1::2], strict=True))
        assert command == "render"
        vispeg.render_dataset(tmp_path / "d", given["--world"], frames=1, seed=int(given["--seed"]), workers=0)
        (episode,) = Dataset(tmp_path / "d").episodes
        values = [in_words(label, some) for label, some in episode["vispeg/world"].items()]
        both = [re.findall("<p>.*?</p>", content) for content in (page.drawn.content, html.drawn(values))]
        assert values and sorted(both[0]) == sorted(both[1])
    finally:
        page.close()


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


def test_the_command_names_the_world_file_only_where_it_is_what_is_shown(place):
    from vispeg.view.world_page import WorldPage

    page = WorldPage(place, "searching")
    try:
        page.open()
        until(lambda: page.sliders and not page.job.busy)
        assert said(page.commands)[0][:4] == ["vispeg", "render", "--world", "searching"]
        r, slider = page.sliders[0]
        for high in ((r.low + r.high) / 2, (r.low + 2 * r.high) / 3):
            slider.value = (r.low, high)
            until(lambda: not said(page.commands))
            assert "write the world file first" in page.commands.content
            page._save()
            until(lambda: said(page.commands))
            (words,) = said(page.commands)
            entries = {(e.effect, e.where): e.params for e in load_world(words[3]).world.ranges}
            assert entries[r.effect, r.where][r.param].high == pytest.approx(high)
        page.name.value = "other"
        assert not said(page.commands)
    finally:
        page.close()


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
