"""An arm that LeRobot knows: robots that measure no force; and, with LeRobot itself, a simulated arm of its kind."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lockstep import Lockstep
from reaching import meaning, reaching

from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.interface.lerobot import INSTALL, PYTHON
from vispeg.trials.driver import Connected
from vispeg.trials.limits import Limits
from vispeg.trials.loop import How, run_episode
from vispeg.trials.trial import PolicyPart, read_trial, write_trial

ROOT, VERSION = Path(__file__).parents[2], "0.4.4"


class Blind(Lockstep):
    """A robot without a sensor at its wrist."""

    def connect(self, interface, seed):
        return replace(super().connect(interface, seed), wrench=None)

    def read(self, cameras=()):
        return replace(super().read(cameras), wrench=None)

    def stop(self):
        super().stop()


class Down:
    def reset(self, n, rows=None): ...

    def act(self, obs):
        assert obs["measured"][0, -6:].tolist() == [0] * 6
        return np.array([[0.0, 0.0, -0.3]])


def test_a_robot_that_measures_no_force_runs_where_that_is_said(tmp_path):
    robot, who = Blind("nominal"), PolicyPart(name="down")
    how, told = How(Limits(no_force_limit=True), rest=0.0), meaning()
    trial = run_episode(Down(), told, robot, who, 1_000_004, how, clock=robot, watch=False)
    assert trial.said.outcome.peak_force_n is None and trial.recording.ft is None and len(robot.commands) > 3
    again = read_trial(write_trial(trial, tmp_path / "t"))
    assert again.said == trial.said and again.recording.ft is None and again.recording.wrench is None

    robot.commands = []
    for interface, limits, named in (
        (
            meaning(told=()),
            Limits(no_force_limit=True),
            "the policy observes force and torque, but the robot measures neither",
        ),
        (told, Limits(), "no force limit can act; expected no_force_limit"),
    ):
        with pytest.raises(UserError, match=named):
            run_episode(Down(), interface, robot, who, 1, How(limits), clock=robot, watch=False)
    with pytest.raises(UserError, match="no_force_limit: is for robots that measure no force"):
        run_episode(Down(), told, Lockstep("nominal"), who, 1, How(Limits(no_force_limit=True)), watch=False)
    with pytest.raises(UserError, match="force, no_force_limit: contradict"):
        Limits(force=10.0, no_force_limit=True)
    assert not robot.commands
    assert Connected().wrench is not None


def test_a_policy_of_lerobot_s_that_reads_joints_alone_needs_no_wrench(tmp_path, monkeypatch):
    from vispeg.api.run import opened

    monkeypatch.setenv(PYTHON, sys.executable)
    monkeypatch.setattr("vispeg.interface.lerobot.LeRobotProcess.ask", lambda self, message: {})
    for width, feels in ((7, False), (19, True)):
        features = {"observation.state": {"type": "STATE", "shape": [width]}}
        shape = {"input_features": features, "output_features": {"action": {"shape": [3]}}, "type": "act"}
        (tmp_path / "config.json").write_text(json.dumps(shape))
        (tmp_path / "model.safetensors").write_bytes(b"")
        assert opened(f"lerobot:{tmp_path}?action=tip_delta", "nominal", None)[1].feels == feels


def test_without_lerobot_one_line_says_how_to_install_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(PYTHON, raising=False)
    reaching(tmp_path / "p.onnx", meaning())
    assert main("run p.onnx --robot lerobot:so101_follower --no-force-limit --out o".split()) == 2
    said = capsys.readouterr().err.strip()
    assert f"lerobot:so101_follower needs lerobot; expected {INSTALL}" in said and PYTHON in said and "\n" not in said
    monkeypatch.setenv(PYTHON, sys.executable)  # an interpreter without it
    assert main("run p.onnx --robot lerobot:so101_follower --no-force-limit --out o".split()) == 2
    said = capsys.readouterr().err.strip()
    assert "No module named 'lerobot'" in said and "\n" not in said
    (tmp_path / "w.yaml").write_text("motors: {}")
    assert main("run p.onnx --robot lerobot:so101_follower:w.yaml --no-force-limit --out o".split()) == 2
    said = capsys.readouterr().err.strip()
    assert "w.yaml" in said and "motors: unknown key" in said and "\n" not in said
    assert sorted(p.name for p in tmp_path.iterdir()) == ["p.onnx", "w.yaml"]


# In an environment with LeRobot ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """An interpreter with LeRobot, that of LEROBOT_PYTHON or a fresh one, and the simulated arm as a plugin of it."""
    base = os.environ.get(PYTHON)
    if not base:
        sys.path.insert(0, str(ROOT / "scripts"))
        from try_lerobot import make

        base = make(tmp_path_factory.mktemp("lerobot") / "env", VERSION)
    env, ask = tmp_path_factory.mktemp("plugin") / "env", "import sysconfig; print(sysconfig.get_path('purelib'))"
    subprocess.run([base, "-m", "venv", "--without-pip", env], check=True)
    theirs = subprocess.run([base, "-c", ask], check=True, capture_output=True, text=True).stdout.strip()
    ours = Path(subprocess.run([env / "bin/python", "-c", ask], check=True, capture_output=True, text=True).stdout[:-1])
    (ours / "all.pth").write_text(f"{ROOT}\nimport site; site.addsitedir({theirs!r})\n")
    (ours / "lerobot_robot_simulated").mkdir()
    shutil.copy(ROOT / "tests/trials/lerobot_arm.py", ours / "lerobot_robot_simulated/__init__.py")
    about = ours / "lerobot_robot_simulated-0.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lerobot_robot_simulated\nVersion: 0.0\n")
    return env / "bin/python"


@pytest.fixture
def run(python, tmp_path, monkeypatch, capsys):
    """Runs a policy on the simulated arm with this wiring; returns what was said."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(PYTHON, str(python))
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path / "home"))

    def go(wiring, *options, kind="simulated", policy=None, code=0):
        reaching(tmp_path / "p.onnx", policy or meaning())
        (tmp_path / "arm.yaml").write_text(json.dumps(wiring))
        argv = ["run", "p.onnx", "--robot", f"lerobot:{kind}:arm.yaml", "--no-force-limit", "--out", "o", *options]
        assert main(argv) == code
        said = capsys.readouterr()
        return said.err.strip() if code else said.out

    return go


AXES = {f"joint{i + 1}": {"motor": f"axis_{i + 1}"} for i in range(7)}


class TestOverLeRobot:
    pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]  # installs LeRobot where no environment is named

    def test_a_policy_reaches_its_goal_and_the_trial_is_compared(self, run, tmp_path):
        """Some motors turn the other way; the gripper stays as it is."""
        signs = [1, -1, 1, -1, 1, 1, -1]
        joints = {name: {**motor, "sign": s} for (name, motor), s in zip(AXES.items(), signs, strict=True)}
        log = tmp_path / "log.json"
        run({"config": {"signs": signs, "log": str(log)}, "joints": joints})
        trial, told = read_trial(tmp_path / "o/trial-0001"), json.loads(log.read_text())
        assert trial.said.outcome.success and told["outcome"]["success"], trial.said
        assert told["sent"] > 100 and told["grippers"] == [30.0]
        assert trial.recording.ft is None and trial.said.robot == "lerobot:simulated:arm.yaml"
        rest = trial.recording.time < trial.steps.time[0]
        assert np.abs(trial.recording.dq[rest]).max() < 0.05, "steps of the encoder are no motion"
        found = tmp_path / "c"
        assert main(["compare", "iiwa14", "--recording", str(tmp_path / "o/trial-0001"), "--out", str(found)]) == 0

    def test_a_shadow_sends_nothing(self, run, tmp_path):
        log = tmp_path / "log.json"
        run({"config": {"log": str(log)}, "joints": AXES}, "--shadow")
        assert json.loads(log.read_text())["sent"] == 0 and read_trial(tmp_path / "o/trial-0001").said.how.shadow

    def test_pictures_come_from_its_cameras(self, run, tmp_path):
        policy = meaning("rgb", image_size=32, cameras=("wrist_wide",))
        config = {"see": "rgb", "image_size": 32}
        run({"config": config, "joints": AXES, "cameras": {"wrist_wide": {"key": "wrist_wide"}}}, policy=policy)
        frames = read_trial(tmp_path / "o/trial-0001").recording.frames
        assert frames is not None and [*frames.cameras] == ["wrist_wide"] and np.ptp(frames.frames[0].rgb) > 50

    def test_a_bus_that_falls_silent_is_a_trial_that_says_so(self, run, tmp_path):
        run({"config": {"silent_after": 2.5}, "joints": AXES}, "--slow", "0.1")
        outcome = read_trial(tmp_path / "o/trial-0001").said.outcome
        assert outcome.category == "watchdog" and "There is no status packet!" in outcome.why

    @pytest.mark.parametrize(
        ("wiring", "kind", "named"),
        [
            ({}, "so999", "LeRobot has no robot 'so999'; it has"),
            ({}, "simulated", "has no such motor for joint1; expected one of axis_1, axis_2"),
            ({"config": {"colour": 1}}, "simulated", "`colour` are not valid"),
            ({"config": {"calibrated": False}}, "simulated", "lerobot-calibrate --robot.type=simulated"),
            ({"config": {"world": "nowhere"}}, "simulated", "nowhere"),
            ({"joints": {"elbow": {}}}, "simulated", "joints.elbow: no joint of the arm"),
        ],
    )
    def test_what_does_not_fit_is_one_line_and_nothing_is_written(self, run, tmp_path, wiring, kind, named):
        said = run(wiring, kind=kind, code=2)
        assert named in said and "\n" not in said and not (tmp_path / "o").exists(), said

    def test_depth_and_cameras_that_are_not_there_are_refused(self, run):
        said = run({"joints": AXES}, policy=meaning("depth", image_size=32), code=2)
        assert "LeRobot's robots deliver only colour pictures" in said
        said = run({"joints": AXES}, policy=meaning("rgb", image_size=32), code=2)
        assert "the robot has no such camera for wrist_wide; expected one of none" in said
