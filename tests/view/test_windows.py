"""What every window is given: its system's colours, and names for those who listen."""

from pathlib import Path

import numpy as np
import pytest

from vispeg.report.sections.found import share, without
from vispeg.view import html
from vispeg.view.diagnose.standing import Field, Standing, Track

pytest.importorskip("viser", reason="the extra 'view' is not installed")

AXE = Path(__file__).parent / "vendored" / "axe.min.js"
SCHEME = "document.documentElement.dataset.mantineColorScheme"
GRAVE = """async () => (await axe.run()).violations.filter(v => ['serious', 'critical'].includes(v.impact)).map(v =>
    [v.id, v.nodes.map(n => n.html.slice(0, 200))])"""


@pytest.mark.slow
def test_each_window_has_its_system_s_colours_until_somebody_chooses(rigs, page_of, served):
    app = served(rigs / "arm.xml")
    dark, light = page_of(app, color_scheme="dark"), page_of(app, color_scheme="light")
    dark.wait_for_function(f"{SCHEME} === 'dark'")
    light.wait_for_selector("text=Drop your model and your logs")
    assert light.evaluate(SCHEME) == "light"
    dark.emulate_media(color_scheme="light")
    dark.wait_for_function(f"{SCHEME} === 'light'")
    app.colours.choice.value = "dark"
    for window in (dark, light):
        window.wait_for_function(f"{SCHEME} === 'dark'")
    app.colours.choice.value = "as the system"
    light.wait_for_function(f"{SCHEME} === 'light'")


@pytest.mark.parametrize(("scheme", "width"), [pytest.param("light", 1440, marks=pytest.mark.slow), ("dark", 400)])
def test_no_page_has_a_serious_finding_of_axe_or_lacks_a_panel(rigs, page_of, served, scheme, width):
    app = served(rigs / "arm.xml")
    page = page_of(app, width, 800, color_scheme=scheme)
    page.wait_for_selector("text=Drop your model and your logs")
    page.wait_for_function(f"{SCHEME} === '{scheme}'")
    page.add_script_tag(path=AXE)
    for one in app.pages:
        page.get_by_text(one.title, exact=True).first.click()
        page.wait_for_selector(f"text=vispeg · {one.title}")
        page.wait_for_timeout(500)
        if one.title == "Worlds":  # what cameras see comes when it is drawn
            page.wait_for_selector("img[src^='blob:']", state="attached", timeout=120_000)
            names = page.evaluate("[...document.querySelectorAll(\"img[src^='blob:']\")].map(e => e.alt)")
            assert names and all(name not in ("", "picture") for name in names)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(GRAVE) == [], one.title
        button = page.get_by_text("Maps, plots and pictures of this page")
        if one.title == "Import":  # its second panel is there from the start: in a narrow window under the first, open
            second = page.get_by_text("Columns, units and the reasons for them")
            assert button.is_visible() == (width == 400)
            if width == 400:
                button.click()
                page.wait_for_function("document.querySelector('.mantine-Tabs-root').getBoundingClientRect().top < 790")
                box = second.bounding_box()
                assert box is not None and 0 <= box["x"] and box["x"] + box["width"] <= width < box["width"] + 100
                page.get_by_text("Diagnose", exact=True).first.scroll_into_view_if_needed()
        elif one.title == "Training":  # without a run it has none
            assert not button.is_visible()


def test_a_cell_of_the_map_has_its_number_on_one_line(chromium):
    """With 362 times the noise a cell of 19 px said 36 above 2."""
    field = Field(np.linspace(-1.0, 1.0, 13), np.full((1, 12), 362.0), np.full((1, 12), 362.0), np.ones((1, 12, 2)))
    zero = np.zeros((2, 1))
    track = Track("rig-c", np.arange(2.0), zero, zero, zero, zero)
    sides = {"joints": ("elbow",), "columns": ("elbow",), "units": ("rad",), "tracks": (track, track), "ladder": ()}
    rest = {
        "shows": "Torque",
        "unit": "rad",
        "floor": 1.0,
        "effects": (),
        "initial": (),
        "judged": True,
        "enough": False,
    }
    standing = Standing(**sides, **rest, maps={"speed": field})
    page = chromium.new_page(viewport={"width": 300, "height": 300})
    page.set_content(html.style() + html.heat(standing, "speed", "", "go"))
    cells = page.locator("td button")
    assert cells.all_inner_texts() == 12 * ["362"]
    lines = """() => [...document.querySelectorAll('td button')].map((cell) => { const range = document.createRange();
        range.selectNodeContents(cell); return range.getClientRects().length; })"""
    assert page.evaluate(lines) == 12 * [1]
    assert page.evaluate("[...document.querySelectorAll('td button')].every(b => b.scrollWidth <= b.clientWidth + 1)")
    page.close()


def test_the_page_says_what_each_effect_explains_in_the_report_s_words():
    effect = {"effect": "coulomb_friction", "where": "joint4", "explains": 0.998, "without": 21.4}
    said = html.reported("found is written.", {"effects": [effect, {**effect, "explains": None, "without": None}]})
    assert said.count("Coulomb friction in joint 4") == 2 and said.count("explains") == 1
    assert f"explains {share(effect)}" in said and f"without it {without(effect)}" in said


def test_every_page_looks_at_what_it_shows(rigs, served):
    """A cell has walls: seen from where an arm is looked at, it is a wall's outside."""
    from vispeg.robots.scene import build
    from vispeg.sim.compiled import compiled
    from vispeg.view.place import ARM, CELL

    app = served(rigs / "arm.xml")
    arm, cell = app.study.traces.arm.model, compiled(build())
    pages = [page.title for page in app.pages]
    for model, view in ((cell, CELL), (arm, ARM)):
        app.study.traces.draws(model, view == CELL)
        for title in [*pages, *pages]:
            app.show(title)
            fills = next(p.fills for p in app.pages if p.title == title)
            expected = CELL if fills else view
            assert np.allclose(app.server.initial_camera.position, expected[0]), (title, view)
            assert np.allclose(app.server.initial_camera.look_at, expected[1]), (title, view)
