"""The house rules of imports hold, cover every room, and would notice a breach."""

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
LINT = "from importlinter.cli import lint_imports_command as main; main()"


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", LINT], cwd=folder, capture_output=True, text=True, timeout=120)


def rooms() -> set[str]:
    return {f"vispeg.{p.parent.name}" for p in (ROOT / "vispeg").glob("*/__init__.py")}


def test_imports_keep_to_their_floors():
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_room_has_a_floor_and_torch_is_kept_out_of_all_but_one():
    floors, torch = CONTRACTS[0], CONTRACTS[1]
    assert {room.strip() for floor in floors["layers"] for room in floor.split("|")} == rooms()
    assert set(torch["source_modules"]) == rooms() - {"vispeg.learn"}


@pytest.mark.parametrize(
    ("file", "breach", "contract"),
    [
        ("core/_breach.py", "import vispeg.cli.main", "floors below"),
        ("effects/_breach.py", "def f():\n    from vispeg.robots import arm", "do not import each other"),
        ("sim/_breach.py", "import torch", "torch lives"),
        ("core/_breach.py", "import mujoco", "needs NumPy"),
    ],
)
def test_a_breach_is_noticed(tmp_path, file, breach, contract):
    shutil.copytree(ROOT / "vispeg", tmp_path / "vispeg", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "vispeg" / file).write_text(breach + "\n")
    done = lint(tmp_path)
    assert done.returncode != 0 and "BROKEN" in done.stdout
    broken = " ".join(done.stdout.split("Broken contracts")[0].split())
    assert contract in broken.split("BROKEN")[0].split("KEPT")[-1]
