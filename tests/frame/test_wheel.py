"""The wheel carries all that is needed, and runs away from the checkout."""

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LISTS = "import vispeg.effects; from vispeg.core.effect import REGISTRY; print(sorted(REGISTRY))"
# what `vispeg render --world S` plans: the built-in worlds, with the sensors and the images that they name
WORLDS = """
from vispeg.effects.common.images import images
from vispeg.demonstrations.plan import plan_of
print([p.name for p in images((".hdr", ".png", ".jpg"))])
print([plan_of(name, 10)[0].world_hash for name in ("S", "V", "N", "P", "VNP", "dev")])
"""


# a policy by name, read from the installation's own files
POLICY = """
from vispeg.learn.shipped import names, policy_folder
print(names(), policy_folder("depth-S"), sep="\\n")
"""
LIMIT_MB = 20  # of the wheel, of which policies are most


def call(*command: object, **options) -> str:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=280, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    call(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", folder, ROOT)
    return next(folder.glob("vispeg-*.whl"))


def shipped(folder: str) -> set[str]:
    files = (p for p in (ROOT / folder).rglob("*") if p.is_file() and "__pycache__" not in p.parts)
    return {p.relative_to(ROOT / folder).as_posix() for p in files}


def test_wheel_holds_the_package_and_what_it_needs_at_run_time(wheel):
    names = {n for n in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in n}
    code = {f"vispeg/{name}" for name in shipped("vispeg")}
    data = {f"vispeg/_assets/{n}" for n in shipped("assets")}
    data |= {f"vispeg/_textures/{n}" for n in shipped("textures")}
    assert "vispeg/py.typed" in code and "vispeg/_assets/README.md" in data
    assert names == code | data
    assert wheel.stat().st_size < 1e6 * LIMIT_MB


def test_wheel_runs_away_from_the_checkout(wheel, tmp_path):
    site, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    elsewhere.mkdir()
    call(sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", site, wheel)
    options = {"cwd": elsewhere, "env": {**os.environ, "PYTHONPATH": str(site)}}
    assert "usage: vispeg" in call(sys.executable, "-m", "vispeg", "--help", **options)
    assert "usage: vispeg render" in call(sys.executable, "-m", "vispeg", "render", "--help", **options)
    assert call(sys.executable, "-c", WORLDS, **options) == call(sys.executable, "-c", WORLDS, cwd=ROOT)
    assert Path(call(sys.executable, "-c", "import vispeg; print(vispeg.__file__)", **options)).is_relative_to(site)
    where = "from vispeg.core.assets import assets; print(assets(), end='')"
    assert Path(call(sys.executable, "-c", where, **options)) == site / "vispeg" / "_assets"
    shipped_there, folder = call(sys.executable, "-c", POLICY, **options).splitlines()
    assert shipped_there == call(sys.executable, "-c", POLICY, cwd=ROOT).splitlines()[0] != "[]"
    assert Path(folder) == site / "vispeg" / "_assets" / "policies" / "depth-S"
    here = call(sys.executable, "-c", LISTS, cwd=ROOT)
    assert call(sys.executable, "-c", LISTS, **options) == here != "[]\n"


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_wheel_brings_its_dependencies(wheel, tmp_path):
    venv.create(tmp_path / "env", with_pip=True)
    python = tmp_path / "env" / "bin" / "python"
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    options = {"cwd": tmp_path, "env": environment}
    install = [python, "-m", "pip", "install", "-q", "-c", ROOT / "constraints.txt", wheel]
    subprocess.run(list(map(str, install)), check=True, **options)
    assert "Ready." in call(tmp_path / "env" / "bin" / "vispeg", "doctor", **options)
    for name in call(python, "-c", "from vispeg.cli.overview import installed; print(*installed())", **options).split():
        call(python, "-m", "vispeg", name, "--help", **options)
