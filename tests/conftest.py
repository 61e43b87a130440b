"""Settings for all tests: one thread a process, pictures without a display, examples that no clock decides."""

import gc
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy: the test processes share the cores among themselves
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypothesis import settings  # noqa: E402

from vispeg.api.machine.graphics import choose_backend  # noqa: E402
from vispeg.cli.main import GARBAGE  # noqa: E402

choose_backend()
gc.set_threshold(GARBAGE)
settings.register_profile("vispeg", deadline=None, derandomize=True)
settings.load_profile("vispeg")
