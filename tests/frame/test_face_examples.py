"""A small example of each name of the public face: it does its work, shows itself, saves itself."""

import json

import numpy as np
import pytest

import vispeg
from vispeg.core.assets import assets
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError

RIGS = assets() / "recordings"


@pytest.fixture(scope="module")
def recordings():
    return [vispeg.load_recording(RIGS / name, seconds=3) for name in ("rig-a", "rig-c")]


def test_a_comparison_of_recordings_in_memory(recordings, tmp_path):
    result = vispeg.compare(vispeg.World("iiwa14"), recordings[1])
    again = vispeg.compare("iiwa14", RIGS / "rig-c", seconds=3)
    assert result.error == again.error > 100 * result.noise_floor
    assert json.loads((result.save(tmp_path / "c") / "compare.json").read_text()) == result.record
    html = result._repr_html_()
    assert "mrad RMS" in html and html.count("<tr>") == 8 and "mrad RMS" in str(result)
    with pytest.raises(UserError, match="exists already"):
        result.save(tmp_path / "c")
    with pytest.raises(UserError, match="copy of|fitted and held out"):
        vispeg.fit("iiwa14", recordings[0], ["payload:flange"], recordings[0])


@pytest.mark.slow
def test_a_fit_lowers_the_error_and_its_model_can_be_loaded(recordings, tmp_path):
    start = EffectInstance.of("payload", "flange", mass=0.4, z=0.05)
    result = vispeg.fit("iiwa14", recordings[0], [start, "coulomb_friction:joint4"], recordings[1], iterations=3)
    before, after = (row["heldout_error"] for row in result.record["ladder"])
    assert after < 0.2 * before
    assert [e.label for e in result.effects] == ["payload(flange)", "coulomb_friction(joint4)"]
    result.save(tmp_path / "f")
    again = vispeg.compare(tmp_path / "f" / "model.yaml", recordings[1])
    assert again.error == pytest.approx(after, rel=1e-3)
    assert "payload(flange)" in result._repr_html_()


def test_names_in_a_notebook_stay_text(recordings):
    from dataclasses import replace

    named = replace(recordings[1], joints=("<b>x</b>", *recordings[1].joints[1:]))
    with pytest.raises(UserError):
        vispeg.compare("iiwa14", named)
    result = vispeg.compare("iiwa14", recordings[1])
    rows = [{**row, "joint": "<b>x</b>"} for row in result.record["joints"]]
    assert "<b>x</b>" not in replace(result, record={**result.record, "joints": rows})._repr_html_()


def test_environments_of_a_named_world():
    env = vispeg.make("nominal")
    one, _ = env.reset(seed=7)
    rows = vispeg.make_vec(2, vispeg.load_world("nominal").world, nthread=1)
    both, _ = rows.reset(seed=7)
    assert both["policy"].shape == (2, *one["policy"].shape) and np.array_equal(both["policy"][0], one["policy"])
    with pytest.raises(UserError, match="did you mean 'clearance_mm'"):
        vispeg.make("nominal", clearance=3)
    env.close()
    rows.close()


def test_an_evaluation_and_a_gap_in_memory_and_saved(tmp_path):
    result = vispeg.evaluate("expert", "nominal", episodes=4)
    assert [e.success for e in result.episodes] == [True] * 4 and not list(tmp_path.iterdir())
    assert "expert" in result._repr_html_()
    names = {p.name for p in result.save(tmp_path / "e").iterdir()}
    assert {"evaluate.json", "evaluate.html", "episodes.jsonl"} <= names
    lost = vispeg.gap(records=[tmp_path / "e" / "episodes.jsonl"], worlds=["nominal"])
    assert lost.record["reference"] == "nominal" and lost.episodes == result.episodes
    assert (lost.save(tmp_path / "g") / "gap.html").is_file()


def test_a_policy_by_name_acts():
    pytest.importorskip("torch")
    policy, rows = vispeg.load_policy("state-3mm"), vispeg.make_vec(1, "S")
    policy.reset(1)
    action = policy.act(rows.reset(seed=0)[0])
    assert action.shape == (1, 3) and np.abs(action).max() <= 1
    with pytest.raises(UserError, match="did you mean 'state-3mm'"):
        vispeg.load_policy("state-3m")
    rows.close()


def test_a_dataset_is_rendered_and_opened(tmp_path):
    made = vispeg.render_dataset(tmp_path / "d", "nominal", frames=4, size=16, workers=0)
    assert len(made.open()) == made.frames == 4 and made.resumed == 0 and made.cameras
    assert "4 frames" in made._repr_html_()


def test_a_camera_is_calibrated(tmp_path):
    import cv2
    from board_views import BOARD, LENS, picture, place

    from vispeg.core.seeds import stream

    rng = stream(1, "face")
    (tmp_path / "images").mkdir()
    for number in range(5):
        cv2.imwrite(str(tmp_path / "images" / f"{number}.png"), picture(BOARD, place(rng)))
    result = vispeg.calibrate(tmp_path / "images", "9x6", 0.0236, distortion="none", name="wrist")
    assert abs(result.camera.fx - LENS.focal[0]) < 3 and result.camera.name == "wrist"
    assert "reprojection" in result._repr_html_()
    assert (result.save(tmp_path / "w") / "camera.yaml").is_file()
