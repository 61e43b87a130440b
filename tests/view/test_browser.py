"""The page in a real browser, with the mouse alone."""

from urllib.parse import urlparse

import pytest

pytest.importorskip("viser", reason="the extra 'view' is not installed")

from vispeg.view.app import App
from vispeg.view.opened import opened

SLOW = 60_000  # ms that a step may take on a busy machine


@pytest.fixture
def page_of(chromium):
    """Opens an app in a window; no request may leave the machine, and no script may fail."""
    requests, errors, windows = [], [], []

    def look(app, width=1440, height=1400):
        window = chromium.new_page(viewport={"width": width, "height": height})
        window.set_default_timeout(SLOW)
        window.on("request", lambda request: requests.append(request.url))
        window.on("websocket", lambda socket: requests.append(socket.url))
        window.on("pageerror", lambda error: errors.append(str(error)))
        window.goto(app.url)
        windows.append(window)
        return window

    yield look
    for window in windows:
        window.close()
    assert requests and not errors
    hosts = {urlparse(url.removeprefix("blob:")).hostname for url in requests if not url.startswith("data:")}
    assert hosts == {"127.0.0.1"}


@pytest.fixture(scope="module")
def app(rigs, tmp_path_factory):
    made = App(opened([str(rigs), str(rigs / "arm.xml")]), tmp_path_factory.mktemp("out"), port=8300, threads=1)
    yield made
    made.close()


def test_a_stranger_reaches_a_named_effect_and_a_fallen_error(app, page_of, elbow):
    page = page_of(app)
    page.wait_for_selector("[data-ladder]")
    first = page.locator("[data-ladder] .big").inner_text()
    page.get_by_role("button", name="shoulder, ").first.click()  # a cell of the map
    page.wait_for_function("[...document.querySelectorAll('input')].some(e => /^shoulder 1 [0-9.]+$/.test(e.value))")
    page.get_by_role("button", name="Coulomb friction at shoulder ·").click()
    page.wait_for_selector("text=+ Coulomb friction at shoulder")
    assert page.locator("[data-ladder] .big").inner_text() != first
    assert "passes" in page.get_by_role("log").inner_text()
    assert "--effects coulomb_friction:shoulder" in page.content()
    assert page.locator("b", has_text="bow").count() == 0 and elbow in page.locator("th").all_inner_texts()

    other = page_of(app, 400, 800)  # a second window finds it all again
    other.wait_for_selector("text=+ Coulomb friction at shoulder")

    page.get_by_role("button", name="Take the last step back").click()
    page.wait_for_selector("text=+ Coulomb friction at shoulder", state="detached")
    assert page.locator("[data-ladder] .big").inner_text() == first


def test_another_site_cannot_talk_to_the_page(app):
    client = pytest.importorskip("websockets.sync.client")
    import viser
    import websockets

    where, protocol = app.url.replace("http", "ws"), f"viser-v{viser.__version__}"
    with pytest.raises(websockets.InvalidStatus, match="403"):
        client.connect(where, origin="https://elsewhere.example", subprotocols=[protocol])
    client.connect(where, origin=app.url, subprotocols=[protocol]).close()
    assert app.server.get_host() == "127.0.0.1"
