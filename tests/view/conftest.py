"""A two-joint arm with a hidden effect, whose elbow has markup for a name, and a browser that looks at its page."""

import shlex
from pathlib import Path
from urllib.parse import urlparse

import browser
import numpy as np
import pressed
import pytest
from loops import drive, recorded

import vispeg
from vispeg.cli.usage import parsed
from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.recordings.write import write
from vispeg.robots.model import load
from vispeg.worlds.world import World

ELBOW = "el<b>bow</b>"
ARM = """
<mujoco><compiler angle="radian"/>
  <worldbody><body name="base"><geom type="cylinder" size="0.06 0.05" pos="0 0 0.05"/>
    <body name="upper"><joint name="shoulder" axis="0 1 0"/>
      <inertial pos="0 0 -0.2" mass="2" diaginertia="0.02 0.02 0.02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03"/>
      <body name="lower" pos="0 0 -0.4"><joint name="el&lt;b&gt;bow&lt;/b&gt;" axis="0 1 0"/>
        <inertial pos="0 0 -0.15" mass="1" diaginertia="0.01 0.01 0.01"/>
        <geom type="box" pos="0 0 -0.15" size="0.02 0.02 0.15"/>
        <site name="flange" pos="0 0 -0.3"/></body></body></body></worldbody></mujoco>
"""


@pytest.fixture(scope="session")
def elbow() -> str:
    """The name of its second joint."""
    return ELBOW


@pytest.fixture(scope="session")
def rigs(tmp_path_factory) -> Path:
    """A folder with arm.xml and three recordings of it with 0.8 N m of dry friction in the shoulder."""
    folder = tmp_path_factory.mktemp("rigs")
    (folder / "arm.xml").write_text(ARM)
    robot = load(folder / "arm.xml")
    world = World().add(EffectInstance.of("coulomb_friction", "shoulder", torque=0.8))
    for i, name in enumerate(("rig-a", "rig-b", "rig-c")):
        t = np.arange(600) * 5e-3
        swing = 1 - np.cos(2 * np.pi * np.outer(t, [0.7 + 0.2 * i, 1.1 - 0.2 * i]))
        s = drive(robot, "position", 0.0, command=0.4 * swing, seconds=3.0, rate=200.0, kp=60.0, kd=4.0)
        write(recorded(robot, robot.source, world, s, stream(5, i)), folder / name)
    return folder


@pytest.fixture(scope="session")
def touched(tmp_path_factory) -> Path:
    """A folder with two recordings of contact in a cell whose fixture gives way by 30 um a newton."""
    folder = tmp_path_factory.mktemp("touched")
    hidden = EffectInstance.of("fixture_compliance", "fixture", z=3e-5)
    write(pressed.recorded((hidden,)), folder / "press-a")
    write(pressed.recorded((hidden,), 1, True), folder / "press-b")
    return folder


@pytest.fixture(scope="session")
def looked(tmp_path_factory) -> Path:
    """A folder with two recordings of a wrist camera that sits 6 mm off."""
    from vispeg.cli.main import main

    folder = tmp_path_factory.mktemp("looked")
    options = ["--motion", "look", "--effects", "camera_offset:wrist_wide:x=0.006", "--size", "128x96"]
    options += ["--fps", "0.4", "--rate", "100", "--quiet"]
    for seed in (1, 2):
        again = ["--seed", str(seed), "--look", f"S/{seed + 3}", "--out", str(folder / f"look-{seed}")]
        assert main(["record", "peg-cell", *options, *again]) == 0
    return folder


@pytest.fixture(scope="session")
def reports(rigs, tmp_path_factory):
    """Name -> page of a diagnosis, a comparison, a fit, a gap and a check."""
    out = tmp_path_factory.mktemp("reports")
    arm, (a, b, c) = rigs / "arm.xml", (rigs / name for name in ("rig-a", "rig-b", "rig-c"))
    vispeg.compare(arm, c, threads=1).save(out / "compared")
    vispeg.diagnose(arm, [a, b], c, threads=1).save(out / "found")
    vispeg.fit(arm, [a, b], ["coulomb_friction:shoulder"], c, iterations=3, threads=1).save(out / "fitted")
    vispeg.gap("expert", worlds=["nominal", "searching"], episodes=2, controls=()).save(out / "gap")
    pages = {"comparison": "compared/report.html", "diagnosis": "found/report.html", "fit": "fitted/report.html"}
    vispeg.check([a, b], out=out / "checked")
    pages |= {"gap": "gap/gap.html", "check": "checked/report.html"}
    return {name: out / page for name, page in pages.items()}


@pytest.fixture(scope="session")
def chromium():
    """A headless browser that draws by software."""
    library = pytest.importorskip(
        "playwright.sync_api", reason="the browser's driver is not installed: pip install playwright"
    )
    path = browser.chromium()
    if path is None:
        pytest.skip("no Chromium: apt-get install chromium")
    with library.sync_playwright() as driver:
        options = ["--no-sandbox", "--use-gl=swiftshader", "--enable-unsafe-swiftshader"]
        window = driver.chromium.launch(executable_path=path, args=options)
        yield window
        window.close()


def understood(line: str) -> None:
    """A command that a page shows is one that the command line takes."""
    program, name, *words = shlex.split(line)
    assert program == "vispeg"
    parsed(name, words)


@pytest.fixture
def page_of(chromium):
    """Opens an app in a window; no request may leave the machine, no script may fail, every command is understood."""
    requests, errors, windows = [], [], []

    def look(app, width=1000, height=560, **more):
        window = chromium.new_page(viewport={"width": width, "height": height}, **more)
        window.set_default_timeout(180_000)  # ms, on a busy machine
        window.on("request", lambda request: requests.append(request.url))
        window.on("websocket", lambda socket: requests.append(socket.url))
        window.on("pageerror", lambda error: errors.append(str(error)))
        window.goto(app.url)
        windows.append(window)
        return window

    yield look
    for window in windows:
        for line in window.locator(".copy code").all_inner_texts():
            understood(line)
        window.close()
    assert requests and not errors
    hosts = {urlparse(url.removeprefix("blob:")).hostname for url in requests if not url.startswith("data:")}
    assert hosts == {"127.0.0.1"}


@pytest.fixture
def served(tmp_path):
    """Serves the page of some sources, with results in a folder of the test; ends it afterwards."""
    from vispeg.view.app import App
    from vispeg.view.opened import opened

    made = []

    def serve(*sources):
        made.append(App(opened([str(s) for s in sources]), tmp_path / "out", threads=1))
        return made[-1]

    yield serve
    for app in made:
        app.close()
