"""Modules of a user's own that VISPEG_PLUGINS names: every command has their effects and channels."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MINE = '''"""Cubic drag: `tau = -drag dq^3`. Source: made up for a test."""

from vispeg.channels.signal import SignalChannel
from vispeg.core.effect import Effect
from vispeg.core.params import Param


class CubicDrag(Effect):
    """Friction that grows with the cube of speed."""

    name = "cubic_drag"
    family = "joint"
    params = {"drag": Param(0.0, 0.0, 20.0, "N m s^3/rad^3", start=0.5, doc="against motion")}

    def torque(self, state, x, p):
        return -p["drag"] * x.dq**3


class Current(SignalChannel):
    """The current of each motor, A."""

    name = "own_current"

    def shows(self, kind):
        return "torque" in kind.channels()

    def predict(self, response, item, worlds):
        return response.tau_motor / 8.0
'''


def vispeg(folder: Path, plugins: str | None, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder that is on PYTHONPATH."""
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{folder}"}
    environment |= {} if plugins is None else {"VISPEG_PLUGINS": plugins}
    command = [sys.executable, "-m", "vispeg", *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=280)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    (tmp_path / "broken.py").write_text("def (\n", encoding="utf-8")
    return tmp_path


def test_commands_know_the_effects_and_channels_of_a_module_that_is_named(folder):
    assert "cube of speed" in vispeg(folder, "mine", "effects", "cubic_drag").stdout
    motion = ["--motion", "fourier", "--duration", "1", "--rate", "100", "--seed", "1", "--quiet"]
    hidden = ["--effects", "cubic_drag:joint4:drag=3", "--out", "rig"]
    made = vispeg(folder, "mine", "record", "iiwa14", *motion, *hidden)
    assert made.returncode == 0, made.stderr
    fit = ["--recording", "rig", "--effects", "cubic_drag:joint4", "--out", "fit", "--quiet"]
    fitted = vispeg(folder, "mine", "fit", "iiwa14", *fit)
    assert fitted.returncode == 0, fitted.stderr
    compare = ["compare", "fit/model.yaml", "--recording", "rig", "--out", "out"]
    shown = vispeg(folder, "mine", *compare)
    assert shown.returncode == 0
    content = f"sha256:{hashlib.sha256((folder / 'mine.py').read_bytes()).hexdigest()}"
    assert json.loads((folder / "out" / "compare.json").read_text())["provenance"]["versions"]["mine"] == content
    said = vispeg(folder, "mine", *compare, "--channels", "amperes", "--overwrite")
    choices = said.stderr.partition("choices: ")[2].partition(";")[0].split(", ")
    assert {"joints", "own_current"} < set(choices)
    without = vispeg(folder, None, *compare, "--overwrite")
    assert without.returncode == 2 and "unknown effect" in without.stderr and "VISPEG_PLUGINS" in without.stderr


@pytest.mark.parametrize(("name", "why"), [("no_such_module", "No module named"), ("broken", "invalid syntax")])
def test_a_module_that_cannot_be_imported_is_one_line(folder, name, why):
    said = vispeg(folder, f"mine,{name}", "effects")
    assert said.returncode == 2 and not said.stdout
    (line,) = said.stderr.splitlines()
    assert "VISPEG_PLUGINS: cannot be imported" in line and why in line and f"got '{name}'" in line


@pytest.mark.parametrize("method", ["shows", "predict"])
def test_a_channel_that_lacks_a_method_is_one_line(folder, method):
    (folder / "mine.py").write_text(MINE.replace(f"def {method}(", f"def {method}_("), encoding="utf-8")
    said = vispeg(folder, "mine", "effects")
    assert said.returncode == 2 and not said.stdout
    assert said.stderr == f"vispeg: error: mine: Current.{method}: not defined; expected a method\n"
