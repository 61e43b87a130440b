"""BLAS has one thread while the library searches, whoever calls it; before and after, as many as the user wants."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCRIPT = """
import sys
import numpy as np
import scipy.linalg
import vispeg
from threadpoolctl import threadpool_info, threadpool_limits

def threads():
    return sorted({pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"})

def stop(text):
    print("meanwhile", *threads())
    raise RuntimeError(text)

vispeg.diagnose, vispeg.compare  # NumPy, SciPy and OpenCV have come in, each with a BLAS of its own
threadpool_limits(3, "blas")  # a user's own
np.ones((2, 2)) @ np.ones((2, 2))
print("before", *threads())
recordings = [vispeg.load_recording(folder) for folder in sys.argv[1:]]
try:
    vispeg.diagnose("iiwa14", recordings[:1], recordings[1:], say=stop)
except RuntimeError:
    print("after an error", *threads())
vispeg.compare("iiwa14", recordings[:1])
print("after", *threads())
"""


def test_blas_has_one_thread_meanwhile_and_afterwards_what_the_user_had(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    free = {key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")}
    environment = {**free, "PYTHONPATH": str(ROOT)}
    record = "vispeg.record('iiwa14', 'fourier', duration=2.0, seed=i).save(sys.argv[i])"
    make = f"import sys, vispeg\nfor i in (1, 2): {record}"
    folders = [str(tmp_path / name) for name in ("one", "two")]
    subprocess.run([sys.executable, "-c", make, *folders], env=environment, check=True, timeout=200)
    done = subprocess.run(
        [sys.executable, script, *folders], env=environment, capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[:4] == ["before 3", "meanwhile 1", "after an error 3", "after 3"]
