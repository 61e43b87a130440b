"""Episodes of a local Ray cluster are those of this machine, also when a worker is killed and its part played again."""

import json
import os
import signal
from pathlib import Path

import pytest

from vispeg.cli.main import main
from vispeg.evaluation import runner
from vispeg.evaluation.arena import play
from vispeg.evaluation.jobs import Setting, make_jobs, seeds_of
from vispeg.evaluation.players import ready

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]  # Ray starts a process in seconds, or in minutes


def deadly(job):
    """Plays a job; the first worker of all is killed in the middle of it."""
    mark = Path(os.environ["VISPEG_TEST_MARK"])
    played = play(job)
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return played


def jobs(folder):
    return make_jobs(ready(["expert", "state-3mm"]), [Setting("nominal", "nominal")], seeds_of(24), folder)


def test_a_killed_worker_costs_its_part_and_changes_no_episode(tmp_path, cluster):
    here = runner.run(jobs(tmp_path), tmp_path / "here")
    there = runner.run(jobs(tmp_path), tmp_path / "there", workers=2, arena=deadly, engine="ray")
    assert (tmp_path / "mark").exists(), "no worker was killed"
    assert [e.to_json() for e in there] == [e.to_json() for e in here]


def test_commands_say_the_same_on_a_cluster(tmp_path, cluster):
    records = {}
    for engine in ("local", "ray"):
        argv = ["evaluate", "state-3mm", "--world", "randomized", "--episodes", "30", "--videos", "0", "--workers", "2"]
        assert main([*argv, "--engine", engine, "--out", str(tmp_path / engine), "--quiet", "--json"]) == 0
        records[engine] = json.loads((tmp_path / engine / "evaluate.json").read_text()) | {"provenance": None}
    assert records["local"] == records["ray"]
