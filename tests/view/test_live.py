"""A run on a robot, followed and stopped from beside it: whole runs on the socket robot, by file and by page."""

import base64
import json
import os
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from vispeg.core.errors import UserError
from vispeg.interface.builder import Picture
from vispeg.trials.live import FOLDER, STATE, Live, ask_stop, encoded, is_live, read_live
from vispeg.trials.loop import Step
from vispeg.trials.trial import FILE, OutcomePart, PolicyPart, Said, StartPart, read_said
from vispeg.view.opened import opened

ROOT = Path(__file__).parents[2]


RUN = """
import sys
from vispeg.api.run import run
from vispeg.trials.loop import How

policy, episodes, place = sys.argv[1:]
run(policy, "sim:nominal", place, episodes=int(episodes), seed=3, how=How(slow=0.05, silence=5.0))
"""


@contextmanager
def running(place, policy="state-3mm", episodes=1):
    """A run of a slowed policy in a process of its own, patient with a robot on a busy machine."""
    own = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", RUN, policy, str(episodes), str(place)]
    with subprocess.Popen(command, env=own) as there:
        try:
            yield there
        finally:
            there.kill()


def until(what, seconds=120.0):
    """What `what()` says once it is true."""
    end = time.monotonic() + seconds
    while not (said := what()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return said


def acting(place, beyond=0):
    state = read_live(place)
    return state if state is not None and state.phase == "acts" and state.step > beyond else None


def listening(pid):
    """Addresses at which a process and its children listen, as /proc says it."""
    family, sockets = [pid], set()
    for child in family:
        family += map(int, Path(f"/proc/{child}/task/{child}/children").read_text().split())
        for handle in Path(f"/proc/{child}/fd").iterdir():
            with suppress(FileNotFoundError):  # the one by which they are listed
                if (to := os.readlink(handle)).startswith("socket:["):
                    sockets.add(to[8:-1])
    out = set()
    for kind, size in (("tcp", 8), ("tcp6", 32)):
        for line in Path(f"/proc/{pid}/net/{kind}").read_text().splitlines()[1:]:
            at, state, inode = (line.split()[i] for i in (1, 3, 9))
            if state == "0A" and inode in sockets:
                out.add(at.split(":")[0][:size])
    return out


@pytest.mark.slow
def test_a_run_is_followed_and_stopped_from_beside_it(tmp_path):
    """The state advances; an id that is another's stops nothing; what is left are trials alone."""
    place = tmp_path / "trials"
    assert read_live(place) is None
    with running(place, episodes=2) as there:
        first = until(lambda: acting(place))
        later = until(lambda: acting(place, first.step + 2))
        assert (later.id, later.trial, later.policy, later.robot) == (
            first.id,
            "trial-0001",
            "state-3mm",
            "sim:nominal",
        )
        assert later.at > first.at and later.step > first.step and later.of >= 20 * 5
        assert later.pid == there.pid and later.host == socket.gethostname()
        assert list(later.shares) == ["joint limit", "joint velocity", "speed limit", "force limit", "workspace"]
        assert all(0 <= share < 1 for share in later.shares.values()) and later.wrench is not None
        assert later.pose is not None and later.target is not None
        assert np.linalg.norm(np.subtract(later.target[:3], later.pose[:3])) < 0.02
        assert listening(there.pid) <= {"0100007F"}, "127.0.0.1 alone"
        number = int(first.id.partition("-")[2])
        for wrong in (f"{'0' * 16}-1", f"{first.id[:16]}-{number + 1}", "../../x", "", f"{first.id}\n"):
            with pytest.raises(UserError, match="no such episode is in progress"):
                ask_stop(place, wrong)
        assert acting(place), "nothing of that stopped it"
        ask_stop(place, first.id)
        second = until(lambda: (state := acting(place)) and state.id != first.id and state)
        assert second.outcomes == ["stopped"] and second.episode == 2
        with pytest.raises(UserError, match="no such episode"):
            ask_stop(place, first.id)
        ask_stop(place, second.id)
        assert there.wait(60) == 0
    assert sorted(p.name for p in place.iterdir()) == ["trial-0001", "trial-0002"]
    assert [read_said(p).outcome.category for p in sorted(place.iterdir())] == ["stopped", "stopped"]
    with pytest.raises(UserError, match="no run is in progress"):
        ask_stop(place, second.id)


@pytest.mark.slow
def test_a_run_that_was_killed_is_not_in_progress_and_the_next_one_begins(tmp_path):
    place = tmp_path / "trials"
    with running(place) as there:
        until(lambda: acting(place))
        there.kill()
        there.wait()
    assert is_live(place) and read_live(place) is None and opened([str(place)]).page == "Trials"
    with running(place) as there:
        ask_stop(place, until(lambda: acting(place)).id)
        assert there.wait(60) == 0
    assert [p.name for p in place.iterdir()] == ["trial-0001"]
    found = opened([str(place)])
    assert found.page == "Trials" and found.trials == str(place) and not found.recordings


def step(number, pictures):
    pose = np.array([0.5, 0, 0.3, 0, 1, 0, 0])
    return Step(number, 50, np.zeros(3), 1.0, 0.001, 0, pose, pose, np.zeros(6), {"workspace": 0.1}, pictures)


def test_the_loop_waits_for_nothing(tmp_path):
    """Handing over two large pictures takes the loop well under two milliseconds; each is thinned out."""
    rng = np.random.default_rng(0)
    rgb, depth = rng.integers(0, 255, (480, 640, 3), dtype=np.uint8), rng.uniform(0.1, 1, (480, 640)).astype(np.float32)
    pictures, took = {"wrist": Picture(rgb), "deep": Picture(depth=depth)}, []
    with Live(tmp_path, "a", "b", 1) as live:
        live.begin("trial-0001", 1)
        for number in range(1, 31):
            before = time.perf_counter()
            live.step(step(number, pictures))
            live.stopped()
            took.append(time.perf_counter() - before)
            time.sleep(0.02)
        state = until(lambda: acting(tmp_path, 29))
    assert np.median(took) < 1e-3
    for data in state.pictures.values():
        image = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_UNCHANGED)
        assert image is not None and image.shape[:2] == (240, 320)
    assert len(state.pictures["wrist"]) < 200_000 and encoded(Picture(rgb[:32, :32]))
    assert not (tmp_path / FOLDER).exists()


@pytest.mark.parametrize("text", ["{", "{}", '{"id": "<b>"}', "[1]"])
def test_a_file_that_is_no_state_is_one_line(tmp_path, text):
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / STATE).write_text(text)
    with pytest.raises(UserError) as said:
        read_live(tmp_path)
    assert STATE in str(said.value) and "\n" not in str(said.value)


@pytest.mark.parametrize("width", [pytest.param(1200, marks=pytest.mark.slow), 420])
def test_the_page_follows_a_run_and_its_button_stops_it(tmp_path, page_of, served, width):
    pytest.importorskip("viser")
    place = tmp_path / "<b>trials"
    with running(place, "depth-S-randomized") as there:
        until(lambda: acting(place))
        app = served(place)
        assert app.server.get_host() == "127.0.0.1" and listening(os.getpid()) <= {"0100007F"}
        page = page_of(app, width, 900)
        page.wait_for_selector("[data-live]")
        assert "trial-0001, 1 of 1" in page.locator("[data-live]").inner_text()
        before = page.locator("[data-live] .big").inner_text()
        page.wait_for_function(f"document.querySelector('[data-live] .big').innerText !== {before!r}")
        pictures = page.locator("[data-live] img")
        assert pictures.count() == 2
        assert pictures.first.evaluate("image => image.complete && image.naturalWidth > 0")
        shares = page.locator("[data-live]").inner_text()
        assert "workspace" in shares and "force limit" in shares and "deadlines missed" in shares
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        if shot := os.environ.get("SHOT"):
            page.screenshot(path=f"{shot}-{width}.png")
        page.get_by_role("button", name="Stop the arm").click()
        assert there.wait(60) == 0
        page.wait_for_selector("[data-live]", state="detached")
        page.wait_for_selector("[data-trials]")
        assert "stopped" in page.locator("[data-trials]").inner_text()
        assert not page.get_by_role("button", name="Stop the arm").is_visible()
        if shot:
            page.screenshot(path=f"{shot}-{width}-over.png")
    assert read_said(place / "trial-0001").outcome.category == "stopped"
    app.pages[-1].halt()  # nothing to stop any more


def trial(place, name, category="success"):
    """A trial of which the page reads the first file alone."""
    (place / name).mkdir(parents=True)
    outcome = OutcomePart(success=category == "success", category=category, by="person", time_s=1.0)
    said = Said(policy=PolicyPart(name="a"), start=StartPart(q_rad=[0.0]), outcome=outcome)
    text = yaml.safe_dump({"format": "vispeg-trial/1", **said.model_dump(exclude_none=True)})
    (place / name / FILE).write_text(text)


@pytest.fixture
def followed(tmp_path, served):
    """A folder with two trials, and the page that follows it."""
    pytest.importorskip("viser")
    place = tmp_path / "trials"
    trial(place, "trial-0001")
    trial(place, "trial-0002", "jam")
    return place, served(place).pages[-1]


def test_a_damaged_trial_neither_hides_the_stop_button_nor_the_other_trials(followed):
    place, page = followed
    (place / "trial-0003").mkdir()
    (place / "trial-0003" / FILE).write_text("policy: {")
    with Live(place, "a", "b", 1) as live:
        live.begin("trial-0004", 1)
        until(lambda: page.stop.visible, 10)
        until(lambda: f"trial-0003/{FILE}" in page.table.content, 10)
        assert "trial-0001" in page.table.content and "1</span>" in page.table.content
        with page.lock:  # as while many trials are read
            presses = threading.Thread(target=page.halt)
            presses.start()
            until(live.stopped, 10)
        presses.join()
    assert not page.refused.visible
    until(lambda: not page.stop.visible, 10)
    trial(place, "trial-0004", "stopped")
    until(lambda: "trial-0004" in page.table.content, 10)


@pytest.mark.parametrize("changes", [{"tip_m": None}, {"pose": [0.5, 0.1]}])
def test_numbers_that_cannot_be_shown_neither_hide_the_stop_button_nor_end_the_following(followed, changes):
    place, page = followed
    with Live(place, "a", "b", 1) as live:
        live.begin("trial-0004", 1)
        until(lambda: page.stop.visible, 10)
        live.step(step(1, {}))
        until(lambda: acting(place), 10)
        file = place / FOLDER / STATE
        data = json.loads(file.read_text())
        file.write_text(json.dumps({**data, "id": f"{data['id'][:16]}-2", "step": 7, **changes}))
        until(lambda: page.state is not None and page.state.step == 7, 10)
        assert page.stop.visible
        live.step(step(9, {}))
        until(lambda: "step 9" in page.now.content, 10)


def test_what_was_wrong_with_the_state_goes_when_it_is_right_again(followed):
    place, page = followed
    with Live(place, "a", "b", 1) as live:
        live.begin("trial-0004", 1)
        until(lambda: page.stop.visible, 10)
        file = place / FOLDER / STATE
        good = file.read_text()
        file.write_text("{")
        until(lambda: page.trouble.visible, 10)
        assert STATE in page.trouble.content and page.stop.visible
        file.write_text(good)
        until(lambda: not page.trouble.visible, 10)
