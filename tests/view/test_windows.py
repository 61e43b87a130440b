"""What every window is given: its system's colours, and names for those who listen."""

from pathlib import Path

import pytest

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
