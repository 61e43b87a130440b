"""`vispeg fit`: known values come back with intervals, doubts are said, and a killed fit goes on."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vispeg.api.inputs import read_inputs
from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.notes import Note
from vispeg.identify.checkpoint import Trace
from vispeg.recordings.load import load
from vispeg.recordings.write import write
from vispeg.worlds.model_file import load_model, write_model

ROOT = Path(__file__).resolve().parents[2]


def fitted(out: Path) -> dict:
    return json.loads((out / "fit.json").read_text())


def test_a_model_without_a_tool_gets_that_of_its_recordings_and_another_one_is_said(rigs, tmp_path):
    """So what is exported or recorded of a fitted model carries what it was fitted with."""
    tool = {"mass_kg": 0.5, "com_m": [0.0, 0.0, 0.05], "inertia_kgm2": [1e-3, 1e-3, 1e-3]}
    bare = [load(rigs[name]) for name in ("friction", "friction2")]
    held = [replace(rec, tool=tool) for rec in bare]
    world = read_inputs("iiwa14", held[:1], held[1:]).world
    assert load_model(write_model(tmp_path / "m.yaml", world)).tool == tool
    assert read_inputs("iiwa14", held[:1], bare[1:]).world.tool is None
    assert read_inputs(world, held[:1], held[1:]).world == world
    with pytest.warns(Note, match=f"{bare[1].name}: the recording's `tool` is not the model's"):
        assert read_inputs(world, held[:1], bare[1:]).world == world


def test_known_friction_comes_back_and_the_held_out_error_falls(vispeg, rigs, tmp_path):
    both = ["--recording", rigs["friction"], "--validate", rigs["friction2"]]
    code, out, _ = vispeg("fit", "iiwa14", *both, "--effects", "coulomb_friction:joint4", "--out", "f", "--quiet")
    assert code == 0 and "coulomb_friction(joint4)" in out
    record = fitted(tmp_path / "f")
    torque = record["effects"][0]["params"]["torque"]
    assert torque["low"] <= 1.2 <= torque["high"] and torque["high"] - torque["low"] < 0.1
    given, final = (row["heldout_error"] for row in record["ladder"])
    assert final < 0.05 * given and final < 1.5 * record["noise_floor"]["value"]
    assert record["converged"] and record["method"] == "least-squares" and not record["unidentifiable"]
    model = load_model(tmp_path / "f" / "model.yaml")
    assert model.effects[0].params["torque"].value == pytest.approx(torque["value"])
    assert model.effects[0].origin["validated_on"] == ["friction2"]
    assert not (tmp_path / "f.part").exists()
    page = (tmp_path / "f" / "report.html").read_text(encoding="utf-8")
    assert "Held-out error falls" in page and "friction2" in page and "data-traces" in page


@pytest.mark.slow
def test_a_fit_that_nothing_was_held_out_from_says_so_on_its_page(vispeg, rigs, tmp_path):
    rec = ["--recording", rigs["friction"], "--quiet", "--iterations", "1"]
    assert vispeg("fit", "iiwa14", *rec, "--effects", "coulomb_friction:joint4", "--out", "f")[0] == 0
    page = (tmp_path / "f" / "report.html").read_text(encoding="utf-8")
    assert "Error on the fitted recordings falls" in page and "only others (--validate) test a model" in page
    assert "held-out" not in page[page.index("<main>") : page.index("</main>")].lower()


@pytest.mark.slow
def test_all_is_one_value_and_each_is_seven(vispeg, rigs, tmp_path):
    rec = ["--recording", rigs["friction"], "--quiet"]
    assert vispeg("fit", "iiwa14", *rec, "--effects", "viscous_friction:all", "--out", "a", "--iterations", "2")[0] == 0
    assert (
        vispeg("fit", "iiwa14", *rec, "--effects", "viscous_friction:each", "--out", "e", "--iterations", "2")[0] == 0
    )
    assert [e["where"] for e in fitted(tmp_path / "a")["effects"]] == ["all"]
    assert [e["where"] for e in fitted(tmp_path / "e")["effects"]] == [f"joint{i}" for i in range(1, 8)]


def test_only_named_effects_move_also_where_the_user_stands(vispeg, rigs, tmp_path, monkeypatch):
    vispeg("add", "iiwa14", "joint_bias", "joint2", "--set", "torque=0.7", "--out", "m.yaml")
    args = ["--recording", rigs["friction"], "--effects", "coulomb_friction:joint4", "--iterations", "3", "--quiet"]
    (tmp_path / "f").mkdir()
    monkeypatch.chdir(tmp_path / "f")
    assert vispeg("fit", "../m.yaml", *args, "--out", ".")[0] == 0
    model = {e.label: e for e in load_model(tmp_path / "f" / "model.yaml").effects}
    assert model["joint_bias(joint2)"].params["torque"].value == 0.7
    assert [e["effect"] for e in fitted(tmp_path / "f")["effects"]] == ["coulomb_friction"]


@pytest.mark.slow
def test_what_the_recording_cannot_tell_is_said(vispeg, rigs, tmp_path):
    """Friction that is not there has no speed at which it falls; constant friction and constant loss are one."""
    args = ["--recording", rigs["nominal"], "--effects", "stribeck_friction:joint4", "--quiet", "--starts", "2"]
    code, out, _ = vispeg("fit", "iiwa14", *args, "--out", "f")
    record = fitted(tmp_path / "f")
    assert code == 0 and (record["unidentifiable"] or record["at_bound"] or record["hardly_told_apart"])
    assert "of 2 starts" in out
    params = record["effects"][0]["params"]
    assert params["coulomb"]["low"] <= 1e-3 and params["excess"]["low"] <= 1e-3


@pytest.mark.slow
def test_killed_fit_leaves_what_was_there_and_goes_on(rigs, tmp_path):
    with new_folder(tmp_path / "f", holds="fit") as old:
        (old / "before").touch()
    args = [
        *["fit", "iiwa14", "--recording", rigs["short"], "--effects", "backlash:joint2", "--iterations", "1"],
        *["--out", "f", "--overwrite", "--quiet"],
    ]
    command = [sys.executable, "-m", "vispeg", *map(str, args)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    checkpoint = tmp_path / "f.part" / "checkpoint.json"
    running = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 60

    def generations() -> list[list[float]]:
        return json.loads(checkpoint.read_text())["traces"][0]["generations"] if checkpoint.exists() else []

    while len(generations()) < 2 and time.monotonic() < deadline and running.poll() is None:
        time.sleep(0.05)
    running.send_signal(signal.SIGKILL)
    running.wait()
    known = generations()
    assert 2 <= len(known) < 10
    assert (tmp_path / "f" / "before").exists()

    whole = subprocess.run(
        [*command[:-3], "g", "--quiet"], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    resumed = subprocess.run([*command, "--resume"], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert whole.returncode == 0 and resumed.returncode == 0, (whole.stderr, resumed.stderr)
    one, two = fitted(tmp_path / "f"), fitted(tmp_path / "g")
    assert one["effects"] == two["effects"] and one["chi2"] == two["chi2"]  # as if nothing had happened
    assert not checkpoint.exists()
    assert one["method"] == "cma"  # backlash is not smooth
    assert one["effects"][0]["params"]["gap"]["value"] < 5e-3  # near none, in one round, of a range up to 0.1 rad


@pytest.mark.slow
def test_a_fit_killed_anywhere_ends_as_if_it_had_not_been(vispeg, rigs, tmp_path, monkeypatch):
    effects = ["--effects", "stribeck_friction:joint4"]  # a valley: the trust region matters
    args = ["fit", "iiwa14", "--recording", rigs["short"], *effects, "--starts", "2", "--iterations", "4", "--quiet"]
    assert vispeg(*args, "--out", "whole")[0] == 0
    told, point, killed = [], Trace.point, 5  # in the third step of one of them

    def counted(self, *answer):
        point(self, *answer)
        told.append(answer)
        if len(told) == killed:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Trace, "point", counted)
        code, _, err = vispeg(*args, "--out", "f")
    assert code == 130 and not (tmp_path / "f").exists()
    assert "to continue: vispeg fit" in err and err.endswith("--out f --resume\n")
    assert vispeg(*args, "--out", "f", "--resume")[0] == 0
    one, two = fitted(tmp_path / "f"), fitted(tmp_path / "whole")
    assert {k: v for k, v in one.items() if k != "provenance"} == {k: v for k, v in two.items() if k != "provenance"}
    assert (tmp_path / "f" / "model.yaml").read_bytes() == (tmp_path / "whole" / "model.yaml").read_bytes()


def test_resume_refuses_another_fit(refused, rigs, tmp_path):
    (tmp_path / "f.part").mkdir()
    text = '{"format": "vispeg-checkpoint/3", "key": "other", "traces": []}'
    (tmp_path / "f.part" / "checkpoint.json").write_text(text)
    args = ["fit", "iiwa14", "--recording", rigs["nominal"], "--effects", "joint_bias:joint2", "--out", "f", "--resume"]
    refused([*args, "--quiet"], "another fit", "checkpoint.json")


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ([], ["nothing to fit", "--effects"]),
        (["--effects", "friction:joint4"], ["unknown effect"]),
        (["--effects", "joint_bias:joint9"], ["no such place"]),
        (["--effects", "joint_bias:joint1", "--starts", "0"], ["--starts"]),
        (["--effects", "joint_bias:joint1", "--threads", "0"], ["threads", "at least 1"]),
        (["--protocol", "paper"], ["control.mode", "osc"]),
        (["--protocol", "paper", "--effects", "joint_bias:joint1"], ["--effects"]),
        (["--protocol", "paper", "--starts", "8"], ["--starts", "paper's protocol"]),
        (["--protocol", "paper", "--method", "least-squares"], ["--method", "paper's protocol"]),
        (["--protocol", "paper", "--channels", "pictures"], ["--channels", "paper's protocol"]),
        (["--protocol", "paper", "--seconds", "2"], ["--seconds", "paper's protocol"]),
    ],
)
def test_mistakes(refused, rigs, args, words):
    refused(["fit", "iiwa14", "--recording", rigs["nominal"], *args, "--out", "f", "--quiet"], *words)


def test_one_recording_cannot_be_fitted_and_held_out(refused, rigs):
    same = ["--recording", rigs["nominal"], "--validate", rigs["nominal"]]
    refused(["fit", "iiwa14", *same, "--effects", "joint_bias:joint1", "--out", "f"], "fitted and held out")


def test_a_copy_of_a_fitted_recording_is_no_judge(refused, rigs, tmp_path):
    shutil.copytree(rigs["nominal"], tmp_path / "copy")
    both = ["--recording", rigs["nominal"], "--validate", tmp_path / "copy"]
    refused(["fit", "iiwa14", *both, "--effects", "joint_bias:joint1", "--out", "f"], "a copy of", "copy")


def test_a_copy_is_found_out_although_an_angle_is_missing(rigs, tmp_path):
    whole = load(rigs["nominal"])
    q = whole.q.copy()
    q[3, 1] = np.nan
    first, copy = (write(replace(whole, q=q), tmp_path / name) for name in ("first", "copy"))
    with pytest.raises(UserError, match="a copy of"):
        read_inputs("iiwa14", first, copy)


@pytest.mark.slow
def test_paper_protocol_brings_the_flange_nearer(vispeg, rigs, tmp_path, refused):
    args = ["--protocol", "paper", "--recording", rigs["osc"], "--iterations", "12", "--quiet"]
    code, out, _ = vispeg("fit", "iiwa14", *args, "--out", "p")
    assert code == 0 and "gravity_tilt(base)" in out
    record = fitted(tmp_path / "p")
    row = record["recordings"][0]
    assert row["cost_after"] < 0.8 * row["cost_before"]
    assert {e["effect"] for e in record["effects"]} == {"gravity_tilt", "link_mass", "viscous_friction"}
    assert (tmp_path / "p" / "paths-osc.png").read_bytes().startswith(b"\x89PNG")
    assert len(load_model(tmp_path / "p" / "model.yaml").effects) == 15
    refused(["report", "p"], "p/fit.json", "the paper's protocol")


def test_paper_cost_is_the_sum_of_norms():
    from vispeg.identify.paper.protocol import Pieces, cost

    measured = np.zeros((2, 3, 3))
    measured[0, :, 0], measured[1, 0, 1] = 0.03, 0.04
    pieces = Pieces(None, (), measured)
    assert cost(pieces, np.zeros((2, 3, 3))) == pytest.approx(0.03 * np.sqrt(3) + 0.04)
    lost = np.zeros((2, 3, 3))
    lost[1] = np.nan
    assert np.isfinite(cost(pieces, lost)) and cost(pieces, lost) > 1.0
