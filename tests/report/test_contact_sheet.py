"""The demonstration's contact sheet: a look for each frame, the same for a seed, without torch, in the report."""

import base64
import subprocess
import sys

import numpy as np
import pytest

from vispeg.api.demo import drawn
from vispeg.datasets.codec import decode
from vispeg.render.backends import classic
from vispeg.report.build import write_report
from vispeg.report.record import ROBOT, SHEET

WITHOUT_TORCH = """
import sys
class Missing:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in ("torch", "stable_baselines3", "safetensors"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Missing())
import numpy as np
from vispeg.report.drawings.contact_sheet import draw
np.save(sys.argv[1], draw(frames=2, seed=3, backend="raycast"))
"""


@pytest.fixture(scope="module")
def sheets(tmp_path_factory):
    """The same sheet twice, by processes of their own."""
    paths = [tmp_path_factory.mktemp("sheets") / f"{i}.npy" for i in range(2)]
    for path in paths:
        subprocess.run([sys.executable, "-c", WITHOUT_TORCH, str(path)], check=True, timeout=280)
    return [np.load(path) for path in paths]


def test_same_seed_same_sheet_without_torch(sheets):
    assert np.array_equal(*sheets) and sheets[0].dtype == np.uint8 and sheets[0].std() > 30


def test_frames_have_looks_of_their_own(sheets):
    one, two = np.split(sheets[0], 2, axis=1)
    colour = (slice(5, 101), slice(9, 105))  # the first picture of a tile: the wide camera's colours
    assert np.abs(one[colour].mean(axis=(0, 1)) - two[colour].mean(axis=(0, 1))).max() > 10


def test_report_takes_in_the_sheet_beside_it(run, diagnosis):
    out = run(diagnosis())
    assert 'id="rendered"' not in write_report(out, overwrite=True).read_text()
    (out / SHEET).write_bytes(b"any bytes")
    text = write_report(out, overwrite=True).read_text()
    assert text.count('<section id="rendered">') == 1
    assert f"data:image/png;base64,{base64.b64encode(b'any bytes').decode()}" in text


def test_diagnosis_stands_where_no_picture_can_be_drawn(monkeypatch):
    with monkeypatch.context() as blind:
        blind.setenv("MUJOCO_GL", "disabled")
        blind.setattr(classic, "_OPEN", {})
        pictures, places, problem = drawn(0, backend="classic")
    assert not pictures and not places and "no OpenGL here" in problem
    pictures, places, problem = drawn(3, frames=1)
    assert {"joint1", "joint4"} <= set(places) and not problem and set(pictures) == {ROBOT, SHEET}
    sheet = decode(pictures[SHEET])
    assert sheet.shape[2] == 3 and sheet.std() > 30 and decode(pictures[ROBOT]).std() > 10
