"""A fit on a local Ray cluster is the fit on this machine, also where a worker is killed and its part done again."""

import json
import os
import signal
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from vispeg.cli.main import main
from vispeg.core.assets import assets
from vispeg.core.effect import EffectInstance
from vispeg.identify.evidence import Evidence
from vispeg.identify.spread import spread
from vispeg.recordings.load import load
from vispeg.worlds.world import World

RIGS = [str(assets() / "recordings" / name) for name in ("rig-a", "rig-b", "rig-c")]


class Sent:
    """Build an evidence; counts how often it is sent from this process."""

    times = 0

    def __call__(self):
        """Build the evidence of the first recording."""
        return Evidence([load(RIGS[0])])

    def __reduce__(self):
        """Count, and be built anew there."""
        Sent.times += 1
        return Sent, ()


def deadly(path):
    """Build an evidence; the first worker of all is killed instead."""
    mark = Path(os.environ["VISPEG_TEST_MARK"])
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return Evidence([load(path)])


@pytest.mark.slow
@pytest.mark.timeout(1200)  # Ray starts a process in seconds, or in minutes
def test_residuals_are_those_of_this_machine_and_a_killed_worker_costs_its_part(tmp_path, cluster):
    friction = [EffectInstance.of("coulomb_friction", "joint4", torque=0.1 * k) for k in range(1, 6)]
    worlds = [World("iiwa14").add(e) for e in friction]
    there = spread(partial(deadly, RIGS[0]), 2)(worlds)
    assert (tmp_path / "mark").exists(), "no worker was killed"
    for ours, theirs in zip(Evidence([load(RIGS[0])]).residuals(worlds), there, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.slow
@pytest.mark.timeout(1200)  # Ray starts a process in seconds, or in minutes
def test_recordings_are_sent_once_for_all_parts(cluster):
    """They are megabytes, and a part of the worlds is a few numbers."""
    friction = [EffectInstance.of("coulomb_friction", "joint4", torque=0.1 * k) for k in range(1, 5)]
    worlds = [World("iiwa14").add(e) for e in friction]
    assert len(spread(Sent(), 4)(worlds)) == 4
    assert Sent.times == 1


@pytest.mark.slow
@pytest.mark.timeout(1200)  # Ray starts a process in seconds, or in minutes
def test_a_fit_by_cma_es_says_the_same_on_a_cluster(tmp_path, cluster):
    records = {}
    argv = ["fit", "iiwa14", "--recording", RIGS[0], "--recording", RIGS[1], "--validate", RIGS[2], "--seconds", "4"]
    argv += ["--effects", "coulomb_friction:joint4", "payload:flange", "--method", "cma", "--iterations", "2"]
    for engine in ("local", "ray"):
        assert main([*argv, "--engine", engine, "--out", str(tmp_path / engine), "--quiet", "--json"]) == 0
        records[engine] = json.loads((tmp_path / engine / "fit.json").read_text()) | {"provenance": None}
    assert records["local"] == records["ray"]


def test_the_papers_protocol_runs_here_alone(tmp_path, capsys):
    argv = ["fit", "iiwa14", "--protocol", "paper", "--recording", RIGS[0], "--engine", "ray"]
    assert main([*argv, "--out", str(tmp_path / "x")]) == 2
    assert "--engine" in capsys.readouterr().err and not (tmp_path / "x").exists()
