"""Progress is told by frame, by policy, with a share; a log gets few lines."""

import re

import pytest

from vispeg.cli import progress
from vispeg.cli.progress import bars, duration, stages
from vispeg.datasets.shards.shard import shard_bytes
from vispeg.demonstrations.plan import plan_of
from vispeg.demonstrations.stage import shard
from vispeg.diagnosis.share import Share


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
        clock[0] += 60
        advance("rgb", 20, "75 % of the new ones succeed, now rgb in VNP")
    said = capsys.readouterr().err
    assert (
        "60 of 100 episodes (60%); 75 % of the new ones succeed, now rgb in VNP; depth 40 of 50, rgb 20 of 50" in said
    )
    assert said.endswith("about 120 s left\n") or said.endswith(f"about {duration(120)} left\n")


def test_the_share_of_a_diagnosis_only_grows_and_ends_below_all():
    told = []
    say = Share(told.append, ahead=3)
    for ahead, text in ((3, "screening"), (3, "fitting"), (3, "screening"), (3, "fitting"), (1, "rivals"), (0, "next")):
        say.ahead = ahead
        say(text)
    shares = [int(re.match(r"(\d+)%.*: ", line)[1]) for line in told]
    assert shares[0] == 0 and shares == sorted(shares) and len({*shares}) == 6 and 75 <= shares[-1] < 100


def test_stages_are_lines_in_a_log(capsys):
    with stages() as say:
        say("20%: fitting")
    with stages(quiet=True) as say:
        say("nothing")
    assert capsys.readouterr().err == "20%: fitting\n"


def test_rendering_is_told_frame_by_frame():
    told: list[int] = []
    options = {"looks": 1, "cameras": (), "size": 32, "seed": 0, "noise": 0.2, "labels": False, "backend": "auto"}
    plan, layout = plan_of("nominal", 6, **options)
    shard_bytes(shard, plan, layout, plan.shards[0], told.append)
    assert told == [1] * 6
