"""The demonstration's contact sheet: a look for each frame, the same for a seed, without torch, in the report."""

import base64
import subprocess
import sys

import numpy as np
import pytest

from vispeg.api.demo import drawn
from vispeg.core.errors import UserError
from vispeg.datasets.codec import decode
from vispeg.report.build import write_report
from vispeg.report.drawings import contact_sheet, robot_picture
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
    def fails(**_):
        raise UserError("no OpenGL here")

    monkeypatch.setattr(contact_sheet, "draw", fails)
    monkeypatch.setattr(robot_picture, "draw", fails)
    assert drawn(0) == ({}, {}, "no OpenGL here")
    flat = np.full((4, 6, 3), 7, np.uint8)
    monkeypatch.setattr(contact_sheet, "draw", lambda **_: flat)
    monkeypatch.setattr(robot_picture, "draw", lambda: (flat, {"joint4": [0.5, 0.5]}))
    pictures, places, problem = drawn(0)
    assert places == {"joint4": [0.5, 0.5]} and not problem and set(pictures) == {ROBOT, SHEET}
    assert np.array_equal(decode(pictures[SHEET]), flat)
