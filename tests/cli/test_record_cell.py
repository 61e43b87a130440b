"""`vispeg record` and `vispeg motions` of a cell."""

import json

import numpy as np
import pandas as pd
import pytest

from vispeg.api.inputs import read_model
from vispeg.api.recording.cell import cell_motion
from vispeg.api.recording.record import record as simulate
from vispeg.core import effect as effects
from vispeg.core.errors import UserError
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.load import load
from vispeg.task.belief import believed
from vispeg.task.peg.config import PegConfig


def test_a_motion_written_as_a_table_is_the_motion_by_name(vispeg, tmp_path):
    assert vispeg("motions", "tap", "--out", "tap.csv", "--rate", "200")[0] == 0
    options = ["--effects", "contact_friction:peg:scale=1.7", "--noise", "ft=0", "ft_torque=0", "q=0", "--rate", "200"]
    for motion, out in (("tap", "a"), ("tap.csv", "b")):
        code, said, _ = vispeg("record", "peg-cell", "--motion", motion, *options, "--out", out)
        assert code == 0 and "contact_friction(peg)" in said
    a, b = load(tmp_path / "a"), load(tmp_path / "b")
    assert np.abs(a.ee_cmd - b.ee_cmd).max() < 1e-8 and np.abs(a.q - b.q).max() < 1e-3
    assert a.control.mode == "osc" and a.control.force_limit == PegConfig().force_limit
    assert a.wrench == WrenchSensor() and "ft" not in a.noise and "q" not in a.noise
    assert believed(a.cell).config == PegConfig(), "what is hidden is not believed"
    assert believed(a.cell).world.effects == ()


def test_a_look_written_as_a_table_is_photographed_like_the_look_by_name(vispeg, tmp_path):
    assert vispeg("motions", "look-tilt", "--out", "tilt.csv", "--rate", "100")[0] == 0
    options = ["--rate", "100", "--cameras", "wrist_wide", "--fps", "0.1", "--size", "32x24"]
    for motion, out in (("look-tilt", "a"), ("tilt.csv", "b")):
        assert vispeg("record", "peg-cell", "--motion", motion, *options, "--out", out)[0] == 0
    a, b = load(tmp_path / "a"), load(tmp_path / "b")
    assert a.frames and b.frames and len(a.frames) == len(b.frames) == 2
    assert np.abs(a.q_cmd - b.q_cmd).max() < 1e-8 and a.cell == b.cell
    assert all(np.array_equal(x.rgb, y.rgb) for x, y in zip(a.frames, b.frames, strict=True))
    code, _, error = vispeg("record", "peg-cell", "--motion", "tilt.csv", *options, "--duration", "9", "--out", "c")
    assert code == 2 and "--duration" in error


def test_a_look_reads_the_torque_asked_for_and_refuses_a_limit_of_force():
    """Friction in the drive is between the motor's torque and that behind the gear."""
    rubbing = ["coulomb_friction:joint6:torque=1"]
    options = {"rate_hz": 100.0, "duration": 11.0, "fps": 0.1, "size": "32x24", "noise": {"tau": 0.0, "dq": 0.0}}
    made = {}
    for sensor in ("joint", "motor", "none"):
        rec = simulate("peg-cell", "look-tilt", torque_sensor=sensor, effects=rubbing, **options).recording
        assert rec.torque_sensor == sensor
        made[sensor] = rec
    assert made["none"].tau is None
    joint = made["joint"].joints.index("joint6")
    moving = np.abs(made["joint"].dq[:, joint]) > 0.1
    lost = (made["motor"].tau - made["joint"].tau)[moving, joint] * np.sign(made["joint"].dq[moving, joint])
    assert moving.sum() > 50 and np.median(lost) == pytest.approx(1.0, abs=0.05)
    with pytest.raises(UserError, match="force.limit"):
        simulate("peg-cell", "look-tilt", force_limit=20.0, **options)


def test_whole_insertions_state_their_outcome(vispeg, tmp_path):
    code, said, _ = vispeg(
        *("record", "nominal", "--motion", "expert", "--rate", "200", "--table", "parquet", "--out", "e"),
        *("--force-limit", "12"),
    )
    assert code == 0 and "success" in said
    rec = load(tmp_path / "e")
    assert rec.outcomes[0].success and rec.cell is not None and rec.cell.world == "nominal"
    assert rec.control.force_limit == 12.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--motion", "foo"], "touch-datum"),
        (["--motion", "tap", "--kp", "3"], "--kp"),
        (["--motion", "tap", "--torque-sensor", "motor"], "--torque-sensor"),
        (["--motion", "tap", "--effects", "contact_friction:joint3"], "joint3"),
        (["--motion", "tap", "--rate", "0"], "ten samples"),
        (["--motion", "tap", "--rate", "1e9"], "1000000 samples"),
        (["--motion", "still.csv", "--rate", "-5"], "still.csv: time: a motion needs ten samples"),
        (["--motion", "expert", "--rate", "0"], "ten samples"),
        (["--motion", "slide", "--force-limit", "-3"], "--force-limit: must be above 0"),
        (["--motion", "nowhere.csv"], "no such motion file"),
        (["--motion", "look", "--cameras", "wrist_wide", "--size", "320"], "as 320x240; got '320'"),
        (["--motion", "bad.csv"], "bad.csv"),
        (["--motion", "far.csv"], "reach"),
        (["--motion", "tap", "--noise", "fz=1"], "ft_torque"),
    ],
)
def test_mistakes_end_in_one_line(vispeg, tmp_path, options, message):
    head = "time,ee_cmd.x,ee_cmd.y,ee_cmd.z,ee_cmd.qw,ee_cmd.qx,ee_cmd.qy,ee_cmd.qz\n"
    (tmp_path / "bad.csv").write_text(head + "0,0.6,0,0.3,0,0.5,0,0\n" * 20)
    (tmp_path / "still.csv").write_text(head + "".join(f"{k / 100},0.6,0,0.3,0,1,0,0\n" for k in range(20)))
    (tmp_path / "far.csv").write_text(head + "".join(f"{k / 100},9,0,0.3,0,1,0,0\n" for k in range(20)))
    code, _, error = vispeg("record", "peg-cell", *options, "--out", "x")
    assert code == 2 and message in error and len(error.strip().splitlines()) == 1
    assert not (tmp_path / "x").exists()


def test_motions_lists_and_refuses(vispeg):
    code, out, _ = vispeg("motions", "--family", "contact")
    assert "TURNED" not in out and "count" not in out, "names of the code say nothing to a user"
    assert code == 0 and all(name in out for name in ("press", "insert-turned", "touch-datum", "expert"))
    assert "fourier" not in out
    for options, message in (
        (["foo", "--out", "a.csv"], "unknown motion"),
        (["tap"], "--out"),
        (["--out", "a"], "which"),
    ):
        code, _, error = vispeg("motions", *options)
        assert code == 2 and message in error


def test_check_says_what_contact_a_recording_excites(vispeg, tmp_path):
    for motion in ("press", "free"):
        vispeg("record", "peg-cell", "--motion", motion, "--rate", "200", "--table", "parquet", "--out", motion)
    code, out, _ = vispeg("check", "press", "free")
    assert code == 0 and "contact_friction: nothing slid" in out and "together:" in out
    code, out, _ = vispeg("check", "press", "free", "--json")
    press, free = (report["contact"] for report in json.loads(out)["recordings"])
    assert press["seconds"]["press"] > 5 and press["excited"]["contact_stiffness"] == ""
    assert free["excited"]["tool_mass"] == "" and free["seconds"]["free"] > 9 and free["peak_force"] < 2
    assert press["begins_free"] > 1 and set(press["excited"]) <= set(effects.REGISTRY)
    samples = pd.read_parquet(tmp_path / "press" / "samples.parquet")
    wrench = [name for name in samples if name.startswith("ft.")]
    for wrong in (-1.0, 1e3):  # the force on the other side, millinewtons: both commands say the same
        turned = samples.assign(**{name: wrong * samples[name] for name in wrench})
        turned.to_parquet(tmp_path / "press" / "samples.parquet")
        said = [vispeg(*c) for c in (["check", "press"], ["compare", "peg-cell", "--recording", "press", "--out", "x"])]
        assert [code for code, _, _ in said] == [2, 2] and said[0][2] == said[1][2]
        assert "not what the tool weighs" in said[0][2] and not (tmp_path / "x").exists()


def test_a_cell_of_one_s_own_is_found_again_beside_its_recordings(vispeg, tmp_path):
    task = "task: {fixture: [0.55, 0.05, 0.06], diameter: 0.02, clearance_mm: 1.0}\n"
    (tmp_path / "rig.yaml").write_text("format: vispeg-world/1\nname: rig\n" + task)
    options = ["--motion", "insert", "--rate", "200", "--table", "parquet"]
    assert vispeg("record", "rig.yaml", *options, "--out", "runs/one")[0] == 0
    assert "cell: ../../rig.yaml" in (tmp_path / "runs" / "one" / "recording.yaml").read_text()
    rec = load(tmp_path / "runs" / "one")
    assert believed(rec.cell).config.clearance_mm == 1.0 and rec.outcomes[0].success
    assert vispeg("compare", "rig.yaml", "--recording", "runs/one", "--out", "compared")[0] == 0


@pytest.mark.parametrize(("motion", "stiff"), [("slide", True), ("hard-press", False)])
def test_a_motion_written_is_recorded_as_the_motion_by_name(vispeg, tmp_path, motion, stiff):
    """Its file states the controller that it needs, and whoever replays the file goes by it."""
    file = tmp_path / "motion.csv"
    code, out, _ = vispeg("motions", motion, "--rate", "250", "--seed", "3", "--out", "motion.csv", "--json")
    said, world = json.loads(out), read_model("peg-cell")
    assert code == 0
    by_name, read = (cell_motion(world, m, rate_hz=250.0, seed=3) for m in (motion, str(file)))
    own = believed(world.cell).config
    gains, limit = by_name.stiffness or own.stiffness, by_name.force_limit or own.force_limit
    assert (gains != own.stiffness) is stiff and (limit > own.force_limit) is not stiff
    assert said["kp"] == pytest.approx(gains) and said["force_limit"] == pytest.approx(limit)
    assert read.stiffness == pytest.approx(gains) and read.force_limit == pytest.approx(limit)
    np.testing.assert_allclose(read.ee_cmd, by_name.ee_cmd, atol=1e-7)
    lines = file.read_text().splitlines()
    column, last = lines[0].split(",").index("kp.rotation"), lines[-1].split(",")
    file.write_text("\n".join([*lines[:-1], ",".join([*last[:column], "1", *last[column + 1 :]])]))
    with pytest.raises(UserError, match="the same on all rows"):
        cell_motion(world, str(file), rate_hz=250.0, seed=3)
