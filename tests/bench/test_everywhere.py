"""A benchmark says the same in one process, in threads and on a cluster."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from everywhere import each

BENCH = Path(__file__).parents[2] / "scripts" / "bench" / "hidden_effects"
CASE = "coulomb_friction/joint4/small"


def squared(n: int) -> int:
    return n * n


@pytest.mark.parametrize("workers", [1, 3])
def test_every_case_comes_once_with_what_is_made_of_it(workers):
    assert sorted(each(squared, range(7), workers)) == [(n, n * n) for n in range(7)]


@pytest.mark.slow
@pytest.mark.timeout(1200)  # Ray starts a process in seconds, or in minutes
def test_a_diagnosis_on_a_cluster_has_the_record_of_one_here(tmp_path):
    pytest.importorskip("ray")
    records = {}
    for engine in ("local", "ray"):
        file = tmp_path / f"{engine}.jsonl"
        argv = ["--make", str(tmp_path), "--run", "--only", CASE, "--dev", "41001", "--engine", engine]
        subprocess.run([sys.executable, str(BENCH), *argv, "--workers", "1", "--results", str(file)], check=True)
        records[engine] = json.loads(file.read_text()) | {"seconds": None}
    assert records["local"] == records["ray"] and records["local"]["verdict"] == "identified"
