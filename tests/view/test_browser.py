"""The page in a real browser, with the mouse alone."""

import re

import pytest

pytest.importorskip("viser", reason="the extra 'view' is not installed")

from vispeg.view.app import App
from vispeg.view.opened import opened


@pytest.fixture(scope="module")
def app(rigs, tmp_path_factory):
    made = App(opened([str(rigs), str(rigs / "arm.xml")]), tmp_path_factory.mktemp("out"), threads=1)
    yield made
    made.close()


def test_a_stranger_reaches_a_named_effect_and_a_fallen_error(app, page_of, elbow):
    page = page_of(app)
    page.wait_for_selector("[data-ladder]")
    first = page.locator("[data-ladder] .big").inner_text()
    page.get_by_role("button", name="shoulder, ").first.click()  # a cell of the map
    page.wait_for_function("[...document.querySelectorAll('input')].some(e => /^shoulder, 1 [0-9.]+$/.test(e.value))")
    page.get_by_role("button", name="Coulomb friction at shoulder ·").click()
    page.wait_for_selector("text=+ Coulomb friction at shoulder")
    assert page.locator("[data-ladder] .big").inner_text() != first
    assert "passes" in page.get_by_role("log").inner_text()
    assert "--effects coulomb_friction:shoulder" in page.content()
    assert page.locator("b", has_text="bow").count() == 0 and elbow in page.locator("th").all_inner_texts()

    with page.expect_download() as taken:
        page.get_by_role("button", name="Take the model").click()
    assert "coulomb_friction" in taken.value.path().read_text()

    other = page_of(app, 400, 800)  # a second window finds it all again
    other.wait_for_selector("text=+ Coulomb friction at shoulder")

    page.get_by_role("button", name="Take the last step back").click()
    page.wait_for_selector("text=+ Coulomb friction at shoulder", state="detached")
    assert page.locator("[data-ladder] .big").inner_text() == first


def number(page) -> float:
    """The error that the page shows, in its unit without prefix."""
    value, unit = page.locator("[data-ladder] .big").inner_text().split()[:2]
    return float(value) * {"m": 1e-3, "µ": 1e-6}.get(unit[0] if len(unit) > 1 else "", 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("recordings", "effect", "size", "falls"),
    [
        ("touched", "Fixture compliance at fixture", r"z [234]\d\.\d µm/N", 1.8),
        ("looked", "Camera pose error at wrist_wide", r"x [56]\.\d+ mm", 10.0),
    ],
)
def test_contact_and_cameras_are_diagnosed_by_a_click(
    recordings, effect, size, falls, request, page_of, tmp_path_factory
):
    """The error falls, the hidden value is there, and the step can be taken back."""
    folder = request.getfixturevalue(recordings)
    app = App(opened([str(folder), "peg-cell"]), tmp_path_factory.mktemp("out"), threads=1)
    try:
        page = page_of(app)
        page.get_by_role("button", name=f"{effect} ·").click()
        page.wait_for_selector(f"text=+ {effect}")
        ladder = page.locator("[data-ladder]")
        assert re.search(size, ladder.inner_text().replace("−", "-")), ladder.inner_text()
        after = number(page)
        page.get_by_role("button", name="Take the last step back").click()
        page.wait_for_selector(f"text=+ {effect}", state="detached")
        assert number(page) > falls * after
        if recordings == "looked":  # the picture comes by itself, and the slider leads from one to the other
            page.wait_for_selector("img[src^='data:image'], img[src^='blob:']")
            page.get_by_text("Measured to rendered", exact=True)
        else:
            page.get_by_role("button", name="force z, press").click()
            page.wait_for_selector("text=force z: error, N")
    finally:
        app.close()


def test_without_its_token_the_page_is_not_opened(app):
    from urllib.error import HTTPError
    from urllib.request import urlopen

    assert app.server.get_host() == "127.0.0.1" and "?token=" in app.url
    with pytest.raises(HTTPError, match="403"):
        urlopen(app.url.partition("?")[0])


def test_a_log_is_dropped_and_becomes_a_recording(rigs, page_of, tmp_path):
    import numpy as np

    from vispeg.recordings.load import load

    rec = load(rigs / "rig-a")
    table = np.column_stack([1e3 * rec.time, np.degrees(rec.q)])
    named = "t_ms,shoulder_pos_deg,el<b>bow</b>_pos_deg"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=named, comments="", fmt="%.9g")
    app = App(opened([str(rigs / "arm.xml")]), tmp_path / "out", threads=1)
    try:
        page = page_of(app)
        with page.expect_file_chooser() as chooser:
            page.get_by_role("button", name="Drop a model").click()  # a log is taken there too
        chooser.value.set_files(tmp_path / "log.csv")
        page.wait_for_selector("[data-look]")
        assert "600 samples of 2 joints at 200 Hz" in page.locator("[data-look]").inner_text()
        assert "el<b>bow</b>" in page.inner_text("body")  # of the column's name
        page.get_by_role("button", name="Confirm and write").click()
        page.wait_for_selector("text=Compare model and recordings")  # the page of diagnoses offers it
        page.wait_for_function("document.body.innerText.includes('log')")
    finally:
        app.close()
    assert np.allclose(load(tmp_path / "out" / "recordings" / "log").q, rec.q, atol=1e-7)


@pytest.mark.slow
def test_a_world_s_range_is_moved_and_a_policy_plays_in_two_worlds(page_of, tmp_path):
    from vispeg.task.world_file import load_world

    app = App(opened(["searching"]), tmp_path / "out", threads=1)
    try:
        page = page_of(app)
        page.wait_for_selector("[data-drawn]")
        world = next(p for p in app.pages if p.title == "Worlds")
        r, slider = world.sliders[0]
        page.get_by_text("Ranges", exact=True)
        slider.value = (r.low, (r.low + r.high) / 2)
        page.get_by_role("button", name="Write the world file").click()
        page.wait_for_selector("text=is written")
        saved = {(e.effect, e.where): e for e in load_world(tmp_path / "out" / "worlds" / "mine.yaml").world.ranges}
        assert saved[r.effect, r.where].params[r.param].high == pytest.approx((r.low + r.high) / 2, rel=1e-6)

        page.get_by_text("Policies", exact=True).click()
        policies = next(p for p in app.pages if p.title == "Policies")
        policies.beside.value = "nominal"
        page.get_by_role("button", name="Play the episode").click()
        page.wait_for_selector("[data-episode] h2 >> nth=1")
        page.get_by_role("button", name="One step on").click()
        page.wait_for_selector("text=0.16 s, force")
        assert page.locator("[data-episode] h2").all_inner_texts() == ["searching", "nominal"]
        assert "vispeg evaluate expert" in page.content()
    finally:
        app.close()
