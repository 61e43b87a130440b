"""Machine code is kept where a folder can be written, and made anew where none can."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCE = """
import numpy as np
from vispeg.kernels.compiled import VECTOR, compiled, to

@compiled(VECTOR, to(VECTOR))
def double(x, out):
    for i in range(len(out)):
        out[i] = 2 * x[i]

out = np.empty(3)
double(np.broadcast_to(1.5, 3), out)
print(out.tolist(), sum(double.stats.cache_hits.values()))
"""


def run(source: Path, home: str, **more: str) -> str:
    """What the script prints in an environment whose home folder is `home`."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA", "XDG"))}
    environment = {**kept, "PYTHONPATH": str(ROOT), "HOME": home, **more}
    done = subprocess.run([sys.executable, source], env=environment, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    return done.stdout


def index(folder: Path) -> list[Path]:
    """The files in which numba keeps what it compiled."""
    return [*folder.rglob("*.nbi")]


def test_code_is_kept_beside_the_source_and_found_again(tmp_path):
    source = tmp_path / "double.py"
    source.write_text(SOURCE)
    assert run(source, str(tmp_path)) == "[3.0, 3.0, 3.0] 0\n"
    assert len(index(tmp_path / "__pycache__")) == 1
    assert run(source, str(tmp_path)) == "[3.0, 3.0, 3.0] 1\n"


def test_a_folder_of_the_user_comes_first(tmp_path):
    source, cache = tmp_path / "double.py", tmp_path / "cache"
    source.write_text(SOURCE)
    run(source, str(tmp_path), NUMBA_CACHE_DIR=str(cache))
    assert len(index(cache)) == len(index(tmp_path)) == 1


def test_without_a_folder_each_process_compiles(tmp_path):
    """Files where folders should be: neither beside the source nor at home can anything be written, by root either."""
    source = tmp_path / "double.py"
    source.write_text(SOURCE)
    (tmp_path / "__pycache__").write_text("")
    for _ in range(2):
        assert run(source, os.devnull, NUMBA_CACHE_DIR=os.devnull) == "[3.0, 3.0, 3.0] 0\n"
    assert not index(tmp_path)
