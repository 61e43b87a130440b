"""Settings for all tests: one thread a process, pictures without a display, hypothesis examples without deadlines."""

import gc
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy: the test processes share the cores among themselves
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

from vispeg.api.machine.graphics import choose_backend
from vispeg.cli.main import GARBAGE

choose_backend()
gc.set_threshold(GARBAGE)
settings.register_profile("vispeg", deadline=None, derandomize=True)
settings.load_profile("vispeg")


@pytest.fixture
def cluster(tmp_path, request):
    """Ray with two workers that can import the sources in the test's folder."""
    ray = pytest.importorskip("ray")
    paths = os.pathsep.join([str(request.path.parent), str(Path(__file__).parents[1])])
    environment = {"env_vars": {"PYTHONPATH": paths, "VISPEG_TEST_MARK": str(tmp_path / "mark")}}
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="error", runtime_env=environment)
    yield ray
    ray.shutdown()
