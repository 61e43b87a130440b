"""Progress is told by frame, by policy, with a share; a log gets few lines; what remains is true or not said."""

import os
import pty
import subprocess
import sys

import numpy as np
import pytest

from vispeg.cli import progress
from vispeg.cli.progress import Pace, bars, duration, stages
from vispeg.datasets.shards.shard import shard_bytes
from vispeg.demonstrations.plan import plan_of
from vispeg.demonstrations.stage import shard


@pytest.fixture
def clock(monkeypatch):
    """Seconds, which the test moves on."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_log_has_a_line_a_tenth_and_none_where_it_is_quick(clock, capsys):
    for pace, least, most in ((0.2, 8, 11), (0.001, 0, 0)):
        with bars({"rendering": 1000}, "frames") as advance:
            advance("rendering", 100, resumed=True)
            for _ in range(900):
                clock[0] += pace
                advance("rendering", 1, "5.0 frames/s")
        lines = capsys.readouterr().err.splitlines()
        assert least <= len(lines) <= most
    with bars({"rendering": 1000}, "frames", quiet=True) as advance:
        clock[0] += 1000
        advance("rendering", 500)
    assert capsys.readouterr().err == ""


def test_what_is_left_is_counted_from_what_is_new_and_each_policy_has_its_share(clock, capsys):
    with bars({"depth": 50, "rgb": 50}, "episodes") as advance:
        advance("depth", 40, resumed=True)
        clock[0] += 30
        advance("depth", 5)
        capsys.readouterr()
        clock[0] += 60
        advance("rgb", 20, "75 % of the new ones succeed, now rgb in VNP")
    said = capsys.readouterr().err
    assert (
        "65 of 100 episodes (65%); 75 % of the new ones succeed, now rgb in VNP; depth 45 of 50, rgb 20 of 50" in said
    )
    assert said.endswith(f"about {duration(5 * 6 + 30 * 3)} left\n")


SCHEDULES = {  # (name, seconds each, how many), one after the other
    "even": [("a", 0.5, 100)],
    "one policy is a hundred times slower": [("quick", 0.05, 200), ("slow", 5.0, 40)],
    "three, the dearest last": [("a", 0.1, 50), ("b", 1.0, 50), ("c", 3.0, 50)],
    "mixed": [("a", 0.1, 1), ("b", 4.0, 1)] * 30,
    "a last one hangs": [("a", 0.5, 99), ("a", 90.0, 1)],
}


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_the_time_that_remains_is_true_or_not_said(clock, schedule):
    """Within a factor of 1.5, or within 3 s; a wait that was not foreseen takes the estimate back."""
    work = [(name, each) for name, each, count in SCHEDULES[schedule] for _ in range(count)]
    totals: dict[str, int] = {}
    for name, _ in work:
        totals[name] = totals.get(name, 0) + 1
    ends = np.cumsum([each for _, each in work])
    hangs, pace, said = schedule == "a last one hangs", Pace(totals), []
    for at, (name, each) in zip(ends, work, strict=True):
        for now in np.linspace(at - each, at, 10, endpoint=False):
            clock[0] = float(now)
            if (left := pace.left()) is not None:
                said.append(left)
                truth = ends[-1] - now
                wrong = max(left, truth) / max(min(left, truth), 1e-9)
                assert wrong < 1.5 or abs(left - truth) < 3.0 or hangs, (now, left, truth)
        clock[0] = float(at)
        if hangs and at == ends[-1]:
            assert pace.left() is None, "a second was said to remain, and ninety went by"
        pace.advance(name, 1)
    assert said and max(said) <= ends[-1]


def on_a_terminal(code: str) -> bytes:
    """What a program writes to a real terminal of 80 columns."""
    leader, follower = pty.openpty()
    environment = {**os.environ, "COLUMNS": "80", "LINES": "24", "TERM": "xterm"}
    done = subprocess.Popen([sys.executable, "-c", code], stderr=follower, env=environment)
    os.close(follower)
    shown = b""
    try:
        while part := os.read(leader, 4096):
            shown += part
    except OSError:  # the other end is closed
        pass
    assert done.wait() == 0
    return shown


def test_a_terminal_has_one_line_however_many_policies_play():
    """Nothing moves the cursor up over more than one line."""
    code = """
import time
from vispeg.cli.progress import bars
with bars({f"policy-{i}": 3 for i in range(8)}, "episodes") as advance:
    for i in range(24):
        advance(f"policy-{i % 8}", 1, f"75 % of the new ones succeed, now policy-{i % 8} in a-world-with-a-long-name")
        time.sleep(0.02)
"""
    shown = on_a_terminal(code)
    assert b"24/24" in shown and b"\x1b[1A" not in shown, "one line has none above it"


def test_the_time_stands_beside_a_stage_that_is_longer_than_the_line():
    code = """
import time
from vispeg.cli.progress import stages
with stages() as say:
    say("fitting " + ", ".join(f"link_mass(link{i})" for i in range(9)))
    time.sleep(0.3)
"""
    frames = on_a_terminal(code).split(b"\r")
    assert any(b"0:00:00" in frame and b"fitting" in frame for frame in frames), frames


def test_stages_are_lines_in_a_log(capsys):
    with stages() as say:
        say("fitting")
    with stages(quiet=True) as say:
        say("nothing")
    assert capsys.readouterr().err == "fitting\n"


def test_rendering_is_told_frame_by_frame():
    told: list[int] = []
    options = {"looks": 1, "cameras": (), "size": 32, "seed": 0, "noise": 0.2, "labels": False, "backend": "auto"}
    plan, layout = plan_of("nominal", 6, **options)
    shard_bytes(shard, plan, layout, plan.shards[0], told.append)
    assert told == [1] * 6
