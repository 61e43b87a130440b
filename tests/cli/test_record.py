"""`vispeg record`: what is written is a recording whose own model explains it to the noise."""

import json
from dataclasses import replace

import numpy as np
import pytest

from vispeg.api.recording.record import record as simulate
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import MOTIONS, motion
from vispeg.identify.gains import servo
from vispeg.identify.motions.rehearse import rehearsed
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.load import load
from vispeg.recordings.noise import NOISE
from vispeg.robots.declared import declared
from vispeg.robots.model import load as robot_load
from vispeg.worlds.world import World

FRICTION = EffectInstance.of("coulomb_friction", "joint4", torque=1.2)


def chi2(rec, world=None):
    """Mean squared whitened residual: 1 for the world that made the recording."""
    evidence = Evidence([rec])
    return float(np.sum(evidence.residuals([world or World()])[0] ** 2) / evidence.count)


def test_the_hidden_world_explains_the_recording_to_the_noise(rigs):
    rec = load(rigs["friction"])
    assert chi2(rec, World().add(FRICTION)) < 1.5 and chi2(rec) > 100
    assert rec.control.mode == "position" and rec.rate_hz == 500 and len(rec.time) == 1000
    assert rec.noise == {k: NOISE[k] for k in ("q", "dq", "tau")}


@pytest.mark.parametrize(
    "hidden",
    [
        EffectInstance.of("payload", "flange", mass=2.0, z=0.1),
        EffectInstance.of("cable_spring", "joint2", stiffness=20.0, reference=-1.0),
    ],
    ids=lambda e: e.effect,
)
def test_an_arm_is_in_balance_when_its_recording_begins(hidden):
    """Whatever its effects let sag has come to rest, so that rollouts do not start in the middle of a swing."""
    world = World().add(hidden)
    assert chi2(simulate(world, "fourier", duration=3).recording, world) < 1.5


def test_torque_recording_replays_its_own_commands(vispeg, tmp_path):
    args = ["--motion", "fourier", "--duration", "4", "--control", "torque", "--out", "t"]
    assert vispeg("record", "iiwa14", *args)[0] == 0
    rec = load(tmp_path / "t")
    assert rec.tau_cmd is not None and rec.q_cmd is None and rec.control.kp is None
    assert chi2(rec) < 3


def test_same_seed_same_bytes_other_seed_other_motion(vispeg, tmp_path):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        vispeg("record", "iiwa14", "--motion", "chirp", "--duration", "1", "--seed", seed, "--out", name)
    a, b, c = ((tmp_path / n / "samples.csv").read_bytes() for n in "abc")
    assert a == b and a != c


def test_noise_is_what_was_asked_and_repeats_differ_by_it_alone(vispeg, tmp_path):
    options = ["--noise", "q=1e-3", "dq=0", "tau=0.5", "--repeat", "2", "--table", "parquet"]
    vispeg("record", "iiwa14", "--motion", "fourier", "--duration", "2", "--out", "n", *options)
    rec = load(tmp_path / "n")
    first, second = (rec.episode == 0), (rec.episode == 1)
    assert np.std(rec.q[first] - rec.q[second]) / np.sqrt(2) == pytest.approx(1e-3, rel=0.05)
    assert np.std(rec.tau[first] - rec.tau[second]) / np.sqrt(2) == pytest.approx(0.5, rel=0.05)
    assert np.array_equal(rec.dq[first], rec.dq[second]) and np.array_equal(rec.q_cmd[first], rec.q_cmd[second])
    assert set(rec.noise) == {"q", "tau"}


def test_a_proposed_motion_is_replayed_as_it_stands(vispeg, tmp_path, rigs):
    source = load(rigs["nominal"])
    columns = ["time", *(f"q_cmd.{j}" for j in source.joints), *(f"dq_cmd.{j}" for j in source.joints)]
    values = np.column_stack([source.time, source.q_cmd, source.dq_cmd])
    np.savetxt(tmp_path / "samples.csv", values, "%.9g", ",", header=",".join(columns), comments="")
    assert vispeg("record", "iiwa14", "--motion", "samples.csv", "--out", "again")[0] == 0
    again = load(tmp_path / "again")
    assert np.allclose(again.q_cmd, source.q_cmd, atol=1e-8) and np.allclose(again.dq_cmd, source.dq_cmd, atol=1e-8)
    assert vispeg("record", "iiwa14", "--motion", "samples.csv", "--rate", "250", "--out", "slow")[0] == 0
    slow = load(tmp_path / "slow")
    assert slow.rate_hz == 250 and np.allclose(slow.q_cmd, source.q_cmd[::2], atol=1e-6)


def test_osc_recording_follows_its_flange_targets(rigs):
    rec = load(rigs["osc"])
    assert rec.control.mode == "osc" and rec.control.nullspace is not None
    assert np.sqrt(np.mean((rec.ee[:, :3] - rec.ee_cmd[:, :3]) ** 2)) < 0.03


def test_declared_tool_moves_the_arm_as_the_named_one():
    mapping = declared("iiwa14", "meg50+peg40")
    full = []
    for tool in ("meg50+peg40", {k: v for k, v in mapping.items() if k != "name"}):
        robot = robot_load("iiwa14", tool=tool)
        m = motion("fourier", robot, 500.0, 1.0, stream(0, "tool"))
        control = controller(robot, "position", 500.0, centre_of(robot))
        full.append(record(World("iiwa14", tool), m, control, {}, stream(0, "none")))
    assert np.abs(full[0].q - full[1].q).max() < 1e-9
    assert full[0].tool == mapping


def test_servo_of_an_arm_without_a_table_is_stable_and_damped(tmp_path):
    """Natural frequency 25 rad/s and critical damping at the apparent inertia, where the rate allows it."""
    robot = replace(robot_load("iiwa14"), name="other")
    kp, kd = servo(robot, centre_of(robot), 500.0)
    assert np.allclose(kd / (2 * np.sqrt(kp * kp / 25.0**2)), 1.0)
    slow_kp, slow_kd = servo(robot, centre_of(robot), 50.0)
    inertia = kp / 25.0**2
    assert np.all(slow_kd <= 0.3 * inertia * 50.0 + 1e-12) and np.all(slow_kp <= kp)


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--motion", "foriur"], ["unknown motion", "fourier"]),
        (["--motion", "gone.csv"], ["no such motion file"]),
        (["--motion", "fourier", "--effects", "payload"], ["needs a place", "flange"]),
        (["--motion", "fourier", "--effects", "payload:flange:mass=-1"], ["out of bounds"]),
        (["--motion", "fourier", "--noise", "p=1"], ["unknown noise"]),
        (["--motion", "fourier", "--noise", "q=-1"], ["not a noise level"]),
        (["--motion", "fourier", "--kp", "1", "2"], ["wrong gains", "7 numbers"]),
        (["--motion", "fourier", "--repeat", "0"], ["--repeat"]),
        (["--motion", "osc", "--control", "position"], ["--control", "osc"]),
        (["--motion", "fourier", "--tool", "spoon"], ["unknown tool"]),
        (["--motion", "fourier", "--rate", "nan"], ["--rate", "not a number"]),
        (["--motion", "fourier", "--rate", "1e9"], ["too long a motion", "1000000 samples"]),
        (["--motion", "fourier", "--seed", "-1"], ["--seed", "no such seed"]),
        (["--motion", "fourier", "--seed", "x"], ["--seed", "'x'", "vispeg record --help"]),
    ],
)
def test_mistakes(refused, args, words):
    refused(["record", "iiwa14", "--duration", "1", *args, "--out", "r"], *words)


def test_an_unstable_loop_is_said_and_nothing_is_kept(refused):
    gains = ["--kp", *["1e6"] * 7, "--kd", *["1e4"] * 7]
    refused(["record", "iiwa14", "--motion", "fourier", "--duration", "1", *gains, "--out", "r"], "unstable")


def test_nothing_is_overwritten(refused, rigs):
    before = (rigs["nominal"] / "samples.csv").read_bytes()
    refused(["record", "iiwa14", "--motion", "steps", "--out", rigs["nominal"]], "exists already")
    assert (rigs["nominal"] / "samples.csv").read_bytes() == before


@pytest.mark.parametrize("name", MOTIONS)
def test_no_joint_passes_its_speed_limit(name):
    """The arm resonates: at 80 % of the limits told, chirps reach three times a limit."""
    robot = robot_load("iiwa14")
    control = controller(robot, "position", 500.0, centre_of(robot))
    asked = motion(name, robot, 500.0, 5.0, stream(1, "record", name))
    told, share = rehearsed(World(), asked, control)
    first, last = (record(World(), m, control, {}, stream(0)).dq for m in (asked, told))
    assert last is not None and (np.abs(last) < robot.velocity_limit).all()
    if (np.abs(first) < 0.98 * robot.velocity_limit).all():
        assert told is asked and (share == 1).all()
    np.testing.assert_allclose(told.q_cmd - asked.q_cmd[0], share * (asked.q_cmd - asked.q_cmd[0]), atol=1e-12)
    np.testing.assert_allclose(np.gradient(told.q_cmd, told.time, axis=0)[1:-1], told.dq_cmd[1:-1], atol=0.1)


def test_a_motion_that_is_made_smaller_is_said_and_one_of_a_file_is_checked(vispeg, tmp_path):
    code, out, _ = vispeg("record", "iiwa14", "--motion", "chirp", "--duration", "2", "--seed", "1", "--out", "chirp")
    assert code == 0 and "no joint passes its speed limit" in out and "joint3" in out
    rec, limit = load(tmp_path / "chirp"), robot_load("iiwa14").velocity_limit
    assert (np.abs(rec.dq).max(axis=0) < limit).all()
    robot = robot_load("iiwa14")
    asked = motion("chirp", robot, 500.0, 2.0, stream(1, "record", "chirp"))
    table = np.column_stack([asked.time, asked.q_cmd, asked.dq_cmd])
    names = ["time", *(f"{s}.{j}" for s in ("q_cmd", "dq_cmd") for j in robot.joints)]
    np.savetxt(tmp_path / "fast.csv", table, delimiter=",", header=",".join(names), comments="")
    assert vispeg("record", "iiwa14", "--motion", "fast.csv", "--out", "fast")[0] == 0
    assert (np.abs(load(tmp_path / "fast").dq).max(axis=0) > limit).any()  # a file is replayed as it stands
    code, out, err = vispeg("check", "fast")
    assert "joint3" in out + err and "limit" in out + err
    code, out, err = vispeg("check", "chirp")
    assert "velocity limit" not in out + err


@pytest.mark.parametrize(
    ("model", "motion", "flags", "options"),
    [
        ("iiwa14", "chirp", ["--duration", "1", "--repeat", "2"], {"duration": 1.0, "repeat": 2}),
        ("iiwa14", "osc", ["--duration", "2", "--noise", "q=0"], {"duration": 2.0, "noise": {"q": 0.0}}),
        ("peg-cell", "tap", ["--rate", "200"], {"rate_hz": 200.0}),
        (
            "peg-cell",
            "look",
            ["--rate", "200", "--fps", "0.1", "--size", "64x48", "--renderer", "raycast", "--look", "S/3"],
            {"rate_hz": 200.0, "fps": 0.1, "size": (64, 48), "backend": "raycast", "look": "S/3"},
        ),
    ],
)
def test_the_command_and_its_function_give_the_same(vispeg, tmp_path, model, motion, flags, options):
    flags = ["--motion", motion, *flags, "--seed", "5", "--out", "command", "--json"]
    code, out, _ = vispeg("record", model, *flags)
    made = simulate(model, motion, seed=5, name="command", **options)
    made.save(tmp_path / "function")
    assert code == 0 and json.loads(out) == {"recording": "command", **json.loads(json.dumps(made.record))}
    tops = tmp_path / "command", tmp_path / "function"
    names = [{file.relative_to(top) for file in top.rglob("*")} for top in tops]
    assert names[0] == names[1] and len(names[0]) >= 2
    for name in names[0]:
        one, other = (top / name for top in tops)
        assert one.is_dir() or one.read_bytes() == other.read_bytes(), name
    assert made.recording.motion in str(made) and "<" in made._repr_html_()


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"cameras": ("wrist_wide",)}, "something to see"),
        ({"look": "S/1"}, "not for an arm alone"),
        ({"force_limit": 20.0}, "not for an arm alone"),
    ],
)
def test_an_option_of_cells_is_refused_for_an_arm_alone(option, words):
    with pytest.raises(UserError, match=words):
        simulate("iiwa14", "triangle", **option)
