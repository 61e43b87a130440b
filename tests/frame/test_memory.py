"""What is freed goes back to the system, whatever lies between."""

import subprocess
import sys

import pytest

LEFT = """
import sys
import numpy as np
from vispeg.core.memory import MIB, large_apart

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096

if sys.argv[1] == "apart":
    large_apart()
np.ones(30 * MIB // 8)  # freed at once: from now on glibc itself takes what is smaller from one heap
before, small = resident(), []
for _ in range(4):
    large = []
    for _ in range(50):
        large.append(np.ones(2 * MIB // 8))
        small.append(bytearray(5000))
    del large
print((resident() - before) / MIB)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's memory")
def test_large_arrays_between_small_ones_are_given_back():
    left = {
        how: float(subprocess.run([sys.executable, "-c", LEFT, how], check=True, capture_output=True, text=True).stdout)
        for how in ("apart", "as it is")
    }
    assert left["apart"] < 10 < left["as it is"], left
