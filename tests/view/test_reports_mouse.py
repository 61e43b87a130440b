"""Reports answer the mouse and the keys: one cursor, one zoom, lines that come and go, the arm at the worst moment."""

import re

import mujoco
import numpy as np
import pytest

from vispeg.robots.model import load
from vispeg.sim.compiled import compiled

READ = """() => { const root = document.querySelector('[data-traces]');
  return { titles: [...root.querySelectorAll('.plot h4')].map(h => h.textContent),
    at: root.querySelector('[data-where]').textContent,
    times: [...root.querySelectorAll('.plot')].map(p => p.querySelector('.u-legend .u-value').textContent),
    spoken: root.querySelector('.spoken').textContent, wide: document.documentElement.scrollWidth }; }"""


@pytest.fixture
def opened(chromium, reports):
    pages = []

    def open_(name, width=1280, **more):
        page = chromium.new_page(viewport={"width": width, "height": 900}, **more)
        page.on("pageerror", lambda error: pytest.fail(str(error)))
        page.goto(reports[name].as_uri())
        page.wait_for_selector("[data-traces].live canvas", state="attached")
        pages.append(page)
        return page

    yield open_
    for page in pages:
        page.close()


def test_the_page_opens_at_the_worst_moment_with_one_cursor_in_all_charts(opened, elbow):
    page = opened("diagnosis")
    shown = page.evaluate(READ)
    worst = float(re.search(r"at ([\d.]+)\ss, where", page.locator("[data-traces]").inner_text())[1])
    assert f", {worst:.2f} s" in shown["at"]
    page.locator("[data-traces]").get_by_role("checkbox", name=elbow).check()
    shown = page.evaluate(READ)
    assert any(title.startswith(elbow) for title in shown["titles"]), "a name with markup is text"
    assert len(set(shown["times"])) == 1 and float(shown["times"][0].split()[0]) == pytest.approx(worst, abs=0.006)


def test_joints_lines_and_panels_come_and_go(opened, elbow):
    page = opened("diagnosis")
    root = page.locator("[data-traces]")
    before = page.evaluate(READ)["titles"]
    root.get_by_role("button", name="Zoom in").click()
    root.get_by_role("checkbox", name=elbow).check()
    after = page.evaluate(READ)["titles"]
    assert len(after) == len(before) + 2
    root.get_by_role("checkbox", name="motion", exact=True).uncheck()
    left = page.evaluate(READ)["titles"]
    assert len(left) == len(after) / 2 and all("residual" in title for title in left)
    root.get_by_role("group", name="Lines").get_by_label("model before").uncheck()
    labels = root.locator(".plot .u-legend .u-label").all_inner_texts()
    assert "model after" in labels and "model before" not in labels
    page.locator("[data-traces] .plots").focus()
    page.keyboard.press("Home")
    start = float(page.evaluate(READ)["times"][0].split()[0])
    assert start == 0.0, "Home goes to the start, whatever is in view"


def test_keys_move_the_cursor_zoom_and_tell_the_values(opened):
    page = opened("diagnosis")
    page.locator("[data-traces] .plots").focus()
    page.keyboard.press("Home")
    first = page.evaluate(READ)
    page.keyboard.press("Shift+ArrowRight")
    second = page.evaluate(READ)
    start, later = (float(shown["times"][0].split()[0]) for shown in (first, second))
    assert later - start == pytest.approx(3.0 / 20, rel=0.1), "a twentieth of what is in view"
    page.keyboard.press("+")
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_selector("[data-traces] .spoken:not(:empty)", state="attached")  # told when the cursor rests
    third = page.evaluate(READ)
    assert float(third["times"][0].split()[0]) - later == pytest.approx(3.0 / 40, rel=0.3), "the zoom halved the view"
    assert re.search(r"at [\d.]+ s: measured −?[\d.]+ m?rad, model", third["spoken"])


def test_the_arms_joints_are_where_mujoco_has_them(opened, rigs):
    page = opened("comparison")
    model = compiled(load(rigs / "arm.xml"))
    data = mujoco.MjData(model)
    for q in ([0.0, 0.0], [0.7, -1.9], [-2.5, 0.4]):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        there = page.evaluate("q => document.querySelector('[data-traces]').posed(q)", q)
        assert np.allclose(there, data.xpos, atol=1e-6)


def test_the_arm_is_drawn_and_turns_and_paper_has_figures_in_place_of_charts(opened):
    page = opened("comparison", width=400, color_scheme="dark")
    drawn = """() => { const c = document.querySelector('[data-stage] canvas'), g = c.getContext('webgl2');
      const p = new Uint8Array(4 * c.width * c.height);
      g.readPixels(0, 0, c.width, c.height, g.RGBA, g.UNSIGNED_BYTE, p);
      return p.filter((v, i) => i % 4 === 3 && v > 0).length / (c.width * c.height); }"""
    share = page.evaluate(drawn)
    assert 0.005 < share < 0.9
    before = page.locator("[data-stage] canvas").screenshot()
    page.locator("[data-stage] canvas").focus()
    for _ in range(6):
        page.keyboard.press("ArrowLeft")
    assert page.locator("[data-stage] canvas").screenshot() != before
    assert page.evaluate(READ)["wide"] == 400
    assert not page.locator("[data-traces] + .paper").is_visible()
    page.emulate_media(media="print")
    assert page.locator("[data-traces] + .paper").is_visible()
    assert not page.locator("[data-traces] .plots").is_visible()


def test_two_policies_on_the_same_seeds(chromium, tmp_path):
    from vispeg.evaluation.gap import gap
    from vispeg.evaluation.records import Episode
    from vispeg.report.gap.build import render

    name, played = "<b>rgb</b>", []
    for policy, lost in (("depth", {0, 1}), (name, {1, 2, 3})):
        for world in ("S", "V"):
            for seed in range(10):
                ok = seed not in lost or world == "S"
                played.append(Episode(policy, "depth", 0, world, world, seed, ok, "success" if ok else "jam", 2.5, 9.0))
    (tmp_path / "gap.html").write_text(render(gap(played, worlds=["S", "V"]), played=played))
    page = chromium.new_page(viewport={"width": 400, "height": 800}, color_scheme="dark")
    page.on("pageerror", lambda error: pytest.fail(str(error)))
    page.goto((tmp_path / "gap.html").as_uri())
    counts = page.locator("[data-counts]")
    said = "both succeed in 6, only the first in 2, only the second in 1, neither in 1"
    assert said in counts.inner_text() and name in counts.inner_text()
    page.locator("[data-squares] button").nth(0).click()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    shown = page.locator("[data-episode]").inner_text()
    assert (
        shown.startswith("Seed 3.")
        and "depth in V: success (2.5 s, at most 9 N)" in shown
        and f"{name} in V: jam" in shown
    )
    page.locator("[data-world-of='0']").select_option(label="S")
    assert "only the first in 3" in counts.inner_text() and "neither in 0" in counts.inner_text()
    rows = page.locator(".bars-list li:visible")
    assert rows.count() == 4
    page.locator("[data-toggles]").get_by_label(name).uncheck()
    assert rows.count() == 2 and page.evaluate("document.documentElement.scrollWidth") == 400
    page.close()
