"""On a local Ray cluster the same bytes come as without one, also when a worker is killed and its shard made again."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from rendered import LAYOUT, PLAN, content, deadly, source

from vispeg.core.errors import UserError
from vispeg.datasets.shards.engine import on_ray
from vispeg.datasets.shards.rendering import render

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]  # Ray starts a process in seconds, or in minutes


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Ray with three workers that can import the sources in this folder."""
    ray = pytest.importorskip("ray")
    monkeypatch.setenv("VISPEG_TEST_MARK", str(tmp_path / "mark"))
    paths = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[2])])
    environment = {"env_vars": {"PYTHONPATH": paths, "VISPEG_TEST_MARK": str(tmp_path / "mark")}}
    ray.init(num_cpus=3, include_dashboard=False, log_to_driver=False, logging_level="error", runtime_env=environment)
    yield ray
    ray.shutdown()


def test_a_cluster_that_loses_a_worker_makes_the_same_bytes(tmp_path, cluster):
    render(PLAN, LAYOUT, source, tmp_path / "here", workers=0)
    ticks = []
    render(PLAN, LAYOUT, deadly, tmp_path / "there", engine=on_ray, workers=3, watch=ticks.append)
    assert (tmp_path / "mark").exists(), "no worker was killed"
    assert content(tmp_path / "there") == content(tmp_path / "here")
    assert sum(ticks) == PLAN.frames


def test_a_cluster_that_is_not_there_is_one_line(tmp_path, monkeypatch):
    pytest.importorskip("ray")
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")
    monkeypatch.setenv("RAY_gcs_rpc_server_connect_timeout_s", "1")
    with pytest.raises(UserError, match="RAY_ADDRESS.*cannot be reached"):
        render(PLAN, LAYOUT, source, tmp_path / "d", engine=on_ray, workers=1)


def test_a_cluster_of_ones_own_is_not_seen_from_outside():
    pytest.importorskip("ray")
    code = "from vispeg.core.cluster import _connect, _ray\nray = _ray()\n_connect(ray, 1)\n"
    code += "print(ray.util.get_node_ip_address())\nray.shutdown()"
    environment = {k: v for k, v in os.environ.items() if k != "RAY_ADDRESS"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout.strip() == "127.0.0.1", done.stdout + done.stderr
