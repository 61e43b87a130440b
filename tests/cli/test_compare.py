"""`vispeg compare`: a right model stands at the noise floor, a wrong one is caught at the right joint."""

import json

import numpy as np
import pytest

from vispeg.recordings.load import load


def test_missing_friction_is_seen_at_its_joint(vispeg, rigs, tmp_path):
    code, out, _ = vispeg("compare", "iiwa14", "--recording", rigs["friction"], "--out", "c")
    assert code == 0 and "joint4" in out and "where it fails: joint4" in out
    assert "Model error is" in out and "eld-out" not in out
    record = json.loads((tmp_path / "c" / "compare.json").read_text())
    assert record["format"] == "vispeg-compare/1" and record["ladder"][0]["fit_error"] is None
    worst = max(record["joints"], key=lambda row: row["error"])
    assert worst["joint"] == "joint4" and worst["times_floor"] > 20
    assert record["where_it_fails"][0]["joint"] == "joint4"
    total = np.sqrt(np.mean([row["error"] ** 2 for row in record["joints"]]))
    assert record["ladder"][0]["heldout_error"] == pytest.approx(total, rel=1e-6)
    page = (tmp_path / "c" / "report.html").read_text()
    assert "comparison" in page and "joint4" in page
    rec = load(rigs["friction"])
    with np.load(tmp_path / "c" / "evidence.npz", allow_pickle=False) as arrays:
        assert np.allclose(arrays["0/measured"], rec.q, atol=1e-6)
        assert np.array_equal(arrays["map/phase/edges"], np.linspace(0, 1, 13))
        assert np.isfinite(arrays["map/phase/before"][3]).sum() >= 6
    peaks = {row["axis"]: row for row in record["residual_peaks"]}
    assert set(peaks) == {"speed", "load", "position", "phase", "time"}
    assert peaks["phase"]["joint"] == "joint4" and peaks["phase"]["times_noise"] > 1


def test_a_model_that_is_none_is_what_is_blamed(vispeg, rigs, tmp_path):
    (tmp_path / "report.html").write_text("<html></html>")
    for model in ("report.html", "."):
        code, _, err = vispeg("compare", model, "--recording", rigs["friction"], "--out", "c")
        assert code == 2 and f"got '{model}'" in err and "recording.yaml" not in err


def test_the_right_model_is_at_the_floor(vispeg, rigs, tmp_path):
    vispeg("add", "iiwa14", "coulomb_friction", "joint4", "--set", "torque=1.2", "--out", "m.yaml")
    both = ["--recording", rigs["friction"], "--recording", rigs["friction2"]]
    code, out, _ = vispeg("compare", "m.yaml", *both, "--out", "c")
    assert code == 0 and "noise floor" in out
    record = json.loads((tmp_path / "c" / "compare.json").read_text())
    assert record["chi2"] < 1.5
    assert set(record["provenance"]["inputs"]) == {str(rigs["friction"]), str(rigs["friction2"])}


@pytest.mark.slow
def test_a_model_that_diverges_is_said_to_and_its_recording_left_out(vispeg, rigs, tmp_path):
    stiff = ["--kp", "3000", "3000", "1000", "1500", "300", "200", "20"]
    soft = ["--kp", "60", "60", "30", "30", "10", "5", "1", "--kd", "8", "8", "3", "3", "0.5", "0.3", "0.03"]
    options = ["--motion", "steps", "--duration", "3", "--rate", "250"]
    for name, gains in (("stiff", stiff), ("soft", soft)):
        assert vispeg("record", "iiwa14", *options, "--out", name, *gains)[0] == 0
    vispeg("add", "iiwa14", "sensor_delay", "all", "--set", "delay=0.012", "--out", "late.yaml")
    code, out, _ = vispeg("compare", "late.yaml", "--recording", "stiff", "--recording", "soft", "--out", "c")
    assert code == 0 and "nan" not in out and "The model diverged in stiff, 0." in out
    record = json.loads((tmp_path / "c" / "compare.json").read_text())
    (row,) = record["diverged"]
    assert row["recording"] == "stiff" and 0.01 < row["time_s"] < 3.0
    _, _, _ = vispeg("compare", "late.yaml", "--recording", "soft", "--out", "alone")
    alone = json.loads((tmp_path / "alone" / "compare.json").read_text())
    assert alone["diverged"] == []
    assert record["ladder"][0]["heldout_error"] == pytest.approx(alone["ladder"][0]["heldout_error"], rel=1e-9)
    assert "diverged in stiff" in (tmp_path / "c" / "report.html").read_text()
    assert vispeg("compare", "late.yaml", "--recording", "stiff", "--out", "none")[0] == 0
    assert json.loads((tmp_path / "none" / "compare.json").read_text())["ladder"][0]["heldout_error"] is None


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("robot: iiwa99", ["m.yaml: robot: unknown robot", "'iiwa99'", "did you mean 'iiwa14'"]),
        ("robot: gone.urdf", ["m.yaml: robot:", "no such robot file"]),
        ("robot: iiwa14\ntool: hammer", ["m.yaml: tool:", "unknown tool", "meg50"]),
        ("effects: [{effect: payload, where: joint4}]", ["m.yaml: effects[0].where:", "'joint4'", "flange"]),
        (
            "effects: [{effect: hole_offset, where: hole}]",
            ["m.yaml: effects[0].where:", "hole_offset has no place here"],
        ),
        ("effects: [{effect: frictions}]", ["m.yaml: effects[0].effect:", "`vispeg effects` lists all"]),
    ],
)
@pytest.mark.parametrize("command", [["compare"], ["add", "payload", "flange"]])
def test_a_mistake_in_a_model_file_is_said_of_file_and_key(refused, tmp_path, body, words, command):
    (tmp_path / "m.yaml").write_text(f"format: vispeg-model/1\n{body}\n")
    refused([command[0], "m.yaml", *command[1:], "--out", "o.yaml"], *words)


def test_mistakes(refused, rigs, tmp_path):
    refused(["compare", "iiwa14", "--out", "c"], "no recording")
    refused(["compare", "iiwa14", "--recording", "gone", "--out", "c"], "does not exist")
    refused(["compare", "iiwa14", *["--recording", rigs["nominal"]] * 2, "--out", "c"], "--recording", "given twice")
    refused(["compare", "iiwa14", "--recording", rigs["nominal"], rigs["nominal"], "--out", "c"], "given twice")
    refused(["compare", "iiwa14", rigs["nominal"], "--recording", rigs["short"], "--out", "c"], "Unrecognized")
    refused(["compare", "gone.yaml", "--recording", rigs["nominal"], "--out", "c"], "gone.yaml: no such file")
    for recordings in (), ("--recording", rigs["short"]):
        refused(["compare", rigs["nominal"], *recordings, "--out", "c"], "is a recording, not a robot", "--recording")
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "model.yaml").write_text("format: vispeg-model/1\n")
    refused(["compare", "found", "--recording", rigs["short"], "--out", "c"], "found/model.yaml")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").write_text("mine")
    refused(["compare", "iiwa14", "--recording", rigs["nominal"], "--out", "full"], "not empty")


@pytest.mark.slow
def test_of_a_long_recording_the_chosen_windows_are_said(vispeg, tmp_path):
    motion = ("--motion", "fourier", "--duration", "40", "--effects", "coulomb_friction:joint4:torque=1.2")
    assert vispeg("record", "iiwa14", *motion, "--out", "long")[0] == 0
    code, out, _ = vispeg("compare", "iiwa14", "--recording", "long", "--out", "c", "--seconds", "12")
    assert code == 0 and "of 40 s are used" in " ".join(out.split())
    record = json.loads((tmp_path / "c" / "compare.json").read_text())
    (row,) = record["windows"]
    assert row["recording"] == "long" and 5 < row["used_s"] < 12.1 and row["reversals"] > 3
    page = (tmp_path / "c" / "report.html").read_text().replace("\xa0", " ")  # on the page a number keeps its unit
    assert row["said"] in page
    with np.load(tmp_path / "c" / "evidence.npz", allow_pickle=False) as arrays:
        names = [str(arrays[f"{r}/name"]) for r in range(len(row["windows"]))]
    assert names == [f"long, from {w['start']:.4g} s" for w in row["windows"]]
    code, _, err = vispeg("compare", "iiwa14", "--recording", "long", "--out", "d", "--seconds", "-1")
    assert code == 2 and "--seconds" in err
