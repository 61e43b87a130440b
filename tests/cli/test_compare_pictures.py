"""`vispeg compare` of a cell: a camera's hidden error shows in figures and page, and goes with it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from vispeg.cli.main import main
from vispeg.report.drawings.camera_residuals import displacement

MODEL = """format: vispeg-model/1
robot: iiwa14
tool: meg50+peg16
cell: peg-cell
effects:
  - effect: camera_offset
    where: wrist_wide
    params: {x: {value: 0.004, unit: m}}
"""


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Reports of the nominal model and of the true one, on a recording with a hidden offset of 4 mm."""
    folder = tmp_path_factory.mktemp("pictures")
    hidden = ["--effects", "camera_offset:wrist_wide:x=0.004", "--look", "S/4", "--rate", "200"]
    rig = folder / "rig"
    main(["record", "peg-cell", "--motion", "look", "--size", "128x96", "--fps", "0.4", *hidden, "--out", str(rig)])
    (folder / "true.yaml").write_text(MODEL)
    for name, model in (("nominal", "peg-cell"), ("true", str(folder / "true.yaml"))):
        main(["compare", model, "--recording", str(rig), "--out", str(folder / name)])
    return folder


def test_figures_fall_with_the_right_model(compared):
    off = {}
    for name in ("nominal", "true"):
        record = json.loads((compared / name / "compare.json").read_text())["pictures"]
        (camera,) = record["cameras"]
        rms = [row["border_px"] for row in record["frames"]]
        assert rms == sorted(rms, reverse=True), "the worst first"
        assert record["shown"][0]["border_px"] == rms[0] and camera["frames"] == len(rms) == 6
        off[name] = camera["border_median_px"], camera["depth_median_mm"]
    assert off["true"][0] < 0.3 and off["nominal"][0] > 4 * off["true"][0]
    assert off["true"][1] < 0.1 < off["nominal"][1]


def test_the_page_shows_pictures_and_no_link_leaves_it(compared):
    page = (compared / "nominal" / "report.html").read_text()
    assert page.count("data:image/jpeg") == 18 and "What the cameras saw" in page
    assert "joint or regime" not in page and "Measured against model" not in page, "joints were not compared"
    assert 'src="http' not in page and 'href="http' not in page


def test_an_arm_alone_says_why_frames_are_left_out(compared, tmp_path, capsys):
    main(["compare", "iiwa14", "--recording", str(compared / "rig"), "--out", str(tmp_path / "arm")])
    assert "frames need the model of a cell" in capsys.readouterr().out
    assert "pictures" not in json.loads((tmp_path / "arm" / "compare.json").read_text())


def test_a_camera_that_the_recording_lacks_is_named(compared, tmp_path, capsys):
    other = tmp_path / "other.yaml"
    other.write_text(MODEL.replace("wrist_wide", "wrist_wid"))
    code = main(["compare", str(other), "--recording", str(compared / "rig"), "--out", str(tmp_path / "x")])
    error = capsys.readouterr().err
    assert code == 2 and "did you mean 'wrist_wide'" in error and not (tmp_path / "x").exists()


def test_displacements_of_cells_are_those_put_in():
    """Borders of all directions that moved as one give the motion back; those of one direction, its normal part."""
    rng = np.random.default_rng(0)
    pixel, angle = rng.uniform(0, (320, 240), (4000, 2)), rng.uniform(0, 2 * np.pi, 4000)
    normal = np.stack([np.cos(angle), np.sin(angle)], 1)
    moved = np.array([1.5, -0.8])
    cells = displacement(pixel, normal, normal @ moved, np.array([320, 240]))
    assert len(cells) == 48 and np.abs(cells[:, 2:4] - moved).max() < 0.05
    one = displacement(pixel, np.tile([1.0, 0.0], (4000, 1)), np.full(4000, 1.5), np.array([320, 240]))
    assert np.allclose(one[:, 2], 1.5, atol=0.05) and np.abs(one[:, 3]).max() < 1e-9
