"""An arm over ROS 2: what its messages say; and, with ROS 2 installed for it, a simulated arm behind real topics."""

import json
import os
import subprocess
import sys
import sysconfig
import threading
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.recordings.cell import WrenchSensor, canonical, reaction
from vispeg.recordings.load import load
from vispeg.render.cameras.camera import Camera
from vispeg.trials.ros2 import PIP, camera_from, composed, image_from, read_topics
from vispeg.trials.ros2_robot import _inverse, as_read
from vispeg.trials.trial import read_said, read_trial

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("joint_state: a", "joint_state: unknown key"),
        ("wrench: {tare: weight}", "wrench.tare: unknown key"),
        ("wrench: {acts_on: gripper}", "wrench.acts_on: is not one of the choices"),
        ("joint_states: my joints", "joint_states: is not a topic name of ROS 2"),
        ("namespace: 7seas", "namespace: is not a topic name"),
        ("end_effector: {quat: [1, 1, 0, 0]}", "end_effector.quat: quaternion w x y z is not of unit length"),
        ("cameras: {wrist: color}", "cameras.wrist: has the wrong type"),
        ("joints: []", "joints"),
        ("- joint_states", "expected a mapping"),
    ],
)
def test_a_bad_file_of_topics_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, capsys, text, named):
    pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    Path("t.yaml").write_text(text)
    assert main("run state-3mm --robot ros2:t.yaml --out o".split()) == 2
    said = capsys.readouterr().err.strip()
    assert "t.yaml" in said and named in said and "\n" not in said, said
    assert [p.name for p in tmp_path.iterdir()] == ["t.yaml"]


def test_without_ros_2_one_line_says_how_to_install_it(tmp_path, monkeypatch, capsys):
    pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert main("run state-3mm --robot ros2 --out o".split()) == 2
    said = capsys.readouterr().err.strip()
    assert PIP in said and "\n" not in said and not [*tmp_path.iterdir()]


def _image(encoding, array, pad=0, big=0):
    rows = np.ascontiguousarray(array).view(np.uint8).reshape(len(array), -1)
    data = np.pad(rows, ((0, 0), (0, pad)))
    size = {"height": array.shape[0], "width": array.shape[1], "step": data.shape[1]}
    return SimpleNamespace(encoding=encoding, data=data.tobytes(), is_bigendian=big, **size)


def test_images_are_read_in_each_encoding_with_padded_rows_and_either_order_of_bytes():
    rng = np.random.default_rng(0)
    colour = rng.integers(0, 256, (4, 6, 3), dtype=np.uint8)
    np.testing.assert_array_equal(image_from(_image("rgb8", colour, pad=5), "t"), colour)
    np.testing.assert_array_equal(image_from(_image("bgr8", colour[..., ::-1]), "t"), colour)
    far = np.array([[0, 1234], [65535, 1]])
    for kind, big in (("<u2", 0), (">u2", 1)):
        np.testing.assert_allclose(image_from(_image("16UC1", far.astype(kind), 2, big), "t"), far / 1000, rtol=1e-6)
    metres = np.array([[np.nan, 0.25]], "<f4")
    np.testing.assert_array_equal(image_from(_image("32FC1", metres), "t"), metres)
    with pytest.raises(UserError, match="encoding that is not read; got 'yuv422'"):
        image_from(_image("yuv422", colour), "t")
    short = _image("rgb8", colour)
    short.data = short.data[:-1]
    with pytest.raises(UserError, match="fewer bytes"):
        image_from(short, "t")


def _info(**changes):
    k, p = np.diag([50.0, 51, 1]), np.zeros((3, 4))
    k[:2, 2], p[:3, :3] = (24, 16), np.diag([40.0, 41, 1])
    p[:2, 2] = 23, 15
    whole = SimpleNamespace(width=0, height=0, x_offset=0, y_offset=0, do_rectify=False)
    info = {"width": 48, "height": 32, "k": k.ravel(), "p": p.ravel(), "d": [0.01, 0, 0, 0, 0], "binning_x": 0}
    return SimpleNamespace(**info | {"binning_y": 0, "roi": whole, "distortion_model": "plumb_bob"} | changes)


def test_a_camera_is_as_its_info_states_it_where_the_policys_camera_sits():
    eye = Camera("wrist", 64, 64, 60, 60, 31.5, 31.5, parent="flange", pos=(0.05, 0, 0.02))
    seen = camera_from(_info(), eye, "t")
    assert (seen.width, seen.height, seen.fx, seen.fy, seen.cx, seen.cy) == (48, 32, 50, 51, 24, 16)
    assert seen.distortion == (0.01, 0, 0, 0, 0) and (seen.parent, seen.pos) == ("flange", eye.pos)
    flat = camera_from(_info(), eye, "t", rectified=True)
    assert (flat.fx, flat.fy, flat.cx, flat.cy) == (40, 41, 23, 15) and not any(flat.distortion)
    assert not any(camera_from(_info(d=[], distortion_model=""), eye, "t").distortion)
    for changes, named in (
        ({"d": [0.1] * 8, "distortion_model": "rational_polynomial"}, "a lens that is not read"),
        ({"d": [0.1] * 4, "distortion_model": "equidistant"}, "a lens that is not read"),
        ({"k": np.zeros(9)}, "not calibrated"),
    ):
        with pytest.raises(UserError, match=named):
            camera_from(_info(**changes), eye, "t")


@pytest.mark.parametrize("frame", ["flange", "base"])
@pytest.mark.parametrize("acts_on", ["tool", "flange"])
def test_what_the_simulated_arm_publishes_is_read_back(frame, acts_on):
    """In the sensor's words and back by the rules of recordings."""
    rng = np.random.default_rng(1)
    wrench, turn = rng.normal(size=6), Rotation.random(rng=2).as_matrix()
    quat = (1, 0, 0, 0) if frame == "base" else tuple(Rotation.random(rng=3).as_quat(scalar_first=True))
    tare, sensor = rng.normal(size=6), WrenchSensor(frame, acts_on, "weight", (0.01, -0.02, 0.1), quat)
    again = reaction(canonical(as_read(wrench, sensor, turn, tare)[None], sensor, turn[None]))[0]
    np.testing.assert_allclose(again + tare, wrench, atol=1e-12)


def test_a_sensor_zeroed_at_its_start_keeps_that_zero_in_every_posture():
    """It subtracts one and the same reading, whatever the hand does later."""
    wrench, turns = np.random.default_rng(1).normal(size=6), Rotation.random(2, rng=2).as_matrix()
    zeroed, raw = WrenchSensor(tared=True, pos=(0.01, 0.0, 0.1)), WrenchSensor(pos=(0.01, 0.0, 0.1))
    tare = np.concatenate([turns[0].T @ [0.0, 0.0, -8.0], [0.1, 0.4, 0.0]])
    less = [as_read(wrench, zeroed, turn, tare) - as_read(wrench, raw, turn, tare) for turn in turns]
    np.testing.assert_allclose(less[0], less[1], atol=1e-12)
    assert np.linalg.norm(less[0][:3]) == pytest.approx(8.0)


def test_a_frame_of_the_controller_is_put_on_and_taken_off_again():
    quat = Rotation.random(2, rng=4).as_quat(scalar_first=True)
    pose, offset = np.array([0.5, 0.1, 0.3, *quat[0]]), np.array([0, 0, 0.1034, *quat[1]])
    both = composed(pose, offset)
    turn, other = (Rotation.from_quat(p[3:], scalar_first=True) for p in (pose, offset))
    np.testing.assert_allclose(both[:3], pose[:3] + turn.apply(offset[:3]), atol=1e-12)
    np.testing.assert_allclose(
        (Rotation.from_quat(both[3:], scalar_first=True) * (turn * other).inv()).magnitude(), 0, atol=1e-7
    )
    np.testing.assert_allclose(composed(both, _inverse(offset)), pose, atol=1e-12)
    none = np.array([0, 0, 0, 1.0, 0, 0, 0])
    np.testing.assert_array_equal(composed(pose, none), pose)


# In an environment with ROS 2 -----------------------------------------------------------------------------------

ODD = """
namespace: left
joints: [lbr_A1, lbr_A2, lbr_A3, lbr_A4, lbr_A5, lbr_A6, lbr_A7]
joint_states: /bench/joint_states
target_pose: crisp/target_pose
base_frame: lbr_link_0
end_effector: {pos_m: [0.0, 0.01, 0.1034], quat: [0.9238795, 0.0, 0.0, -0.3826834]}
wrench: {topic: broadcaster/wrench, acts_on: tool, frame: base, pos_m: [0.0, 0.0, 0.05]}
"""
HEARS = """
import json, sys
from vispeg.trials.ros2 import Link, read_topics

topics, poses = read_topics(sys.argv[1]), []
link = Link("listener", topics)

def hear(m):
    p, o = m.pose.position, m.pose.orientation
    poses.append([m.header.frame_id, p.x, p.y, p.z, o.w, o.x, o.y, o.z])

link.node.create_subscription(link.geometry.PoseStamped, topics.target_pose, hear, 100)
print("hears", flush=True)
sys.stdin.read()
link.close()
print(json.dumps(poses))
"""
SPEAKS = """
import sys
from vispeg.trials.ros2 import Link, Topics

link = Link("teleoperation", Topics())
link.speak(link.geometry.PoseStamped, "target_pose")
print("speaks", flush=True)
sys.stdin.read()
link.close()
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """An interpreter with ROS 2, with this one's packages behind its own."""
    env = tmp_path_factory.mktemp("ros2") / "env"
    subprocess.run([sys.executable, "-m", "venv", env], check=True)
    pip = [env / "bin/pip", "install", "--quiet", "--disable-pip-version-check", f"numpy=={np.__version__}"]
    subprocess.run([*pip, *PIP.split()[2:]], check=True)
    site = env / f"lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
    (site / "outer.pth").write_text(f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})\n")
    return env / "bin/python"


def environment():
    """Only this process's nodes hear each other."""
    own = {"PYTHONPATH": str(ROOT), "ROS_DOMAIN_ID": str(os.getpid() % 100 + 1)}
    return {key: value for key, value in os.environ.items() if not key.startswith("ROS_")} | own


@contextmanager
def process(python, *command):
    """A process that has said that it is there."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([python, *map(str, command)], env=environment(), **pipes) as there:
        try:
            assert there.stdout.readline()
            yield there
            if not there.stdin.closed:
                there.stdin.close()
            there.wait(20)
        finally:
            there.kill()


def arm(python, *options):
    return process(python, "-m", "vispeg.trials.ros2_robot", *options)


def run(python, *options, code=0):
    """What `vispeg run` said."""
    command = [python, "-m", "vispeg", "run", *map(str, options)]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=120)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stderr.strip() if code else done.stdout


slow = [pytest.mark.slow, pytest.mark.timeout(600)]  # installs ROS 2


class TestOverRos2:
    pytestmark = slow

    def test_a_policy_reaches_its_goal_and_the_trial_is_compared(self, python, tmp_path):
        """Joints come in another order and with one more."""
        out = tmp_path / "trials"
        with arm(python, "--world", "nominal", "--seed", "3") as robot:
            run(python, "state-3mm", "--robot", "ros2", "--out", out)
            robot.stdin.write("\n")
            robot.stdin.flush()
            run(python, "state-3mm", "--robot", "ros2", "--out", out, "--shadow")
            robot.stdin.close()
            said = robot.stdout.read()
        first, second, third = said.splitlines()
        assert "commanded" in first and "success" in second and "start 4" in third, "a shadow moves nothing"
        trial = read_trial(out / "trial-0001")
        assert trial.said.outcome.success and trial.said.robot == "ros2" and trial.said.timing.steps > 4
        assert load(out / "trial-0001").outcomes[0].success
        assert main(["compare", "iiwa14", "--recording", str(out / "trial-0001"), "--out", str(tmp_path / "c")]) == 0

    def test_other_names_another_frame_and_another_sensor_make_no_difference(self, python, tmp_path):
        """The poses that arrive are those of the trial, turned into the controller's frame."""
        topics, out = tmp_path / "t.yaml", tmp_path / "trials"
        topics.write_text(ODD)
        (tmp_path / "hears.py").write_text(HEARS)
        with arm(python, "--topics", topics, "--seed", "3"), process(python, tmp_path / "hears.py", topics) as ear:
            run(python, "state-3mm", "--robot", f"ros2:{topics}", "--out", out)
            ear.stdin.close()
            heard = json.loads(ear.stdout.read())
        trial = read_trial(out / "trial-0001")
        assert trial.said.outcome.success and trial.said.outcome.peak_force_n < 40
        assert {h[0] for h in heard} == {"lbr_link_0"} and len(heard) == len(trial.steps.target) + 1, "and the stop"
        offset = read_topics(topics).end_effector.pose
        for got, asked in zip(heard, trial.steps.target, strict=False):
            np.testing.assert_array_equal(got[1:], composed(asked, offset))
        still = composed(trial.recording.ee[-1], offset)
        np.testing.assert_allclose(heard[-1][1:4], still[:3], atol=2e-3)

    def test_an_arm_that_falls_silent_is_a_trial_that_says_so(self, python, tmp_path):
        command = [
            python,
            "-m",
            "vispeg",
            "run",
            "state-3mm",
            "--robot",
            "ros2",
            "--slow",
            "0.1",
            "--out",
            tmp_path / "o",
        ]
        with arm(python) as robot:
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
            going = subprocess.Popen(command, env=environment(), **pipes)
            # a run that ends without a command ends the wait for one
            threading.Thread(target=lambda: (going.wait(), robot.kill()), daemon=True).start()
            heard = robot.stdout.readline()
            robot.kill()
            told = going.communicate(timeout=60)[0]
        assert "commanded" in heard, told
        said = read_said(tmp_path / "o/trial-0001")
        assert said.outcome.category == "watchdog" and "0.25 s" in said.outcome.why and said.outcome.why in told

    @pytest.mark.parametrize(
        ("published", "driven", "named"),
        [
            ("joints: [a, b, c, d, e, f, g]", "{}", "/joint_states: does not name the arm's joints; expected joint1"),
            ("{}", "end_effector: {pos_m: [0, 0, 0.1034]}", "103.4 mm and 0.0 degrees away from"),
            ("target_pose: elsewhere", "{}", "/target_pose: nobody listens"),
            ("wrench: {topic: force}", "{}", "/wrench: nobody publishes it; expected geometry_msgs/msg/WrenchStamped"),
            (
                "current_pose: p",
                "wrench: {topic: p}",
                "/p: is silent for 5 s; expected geometry_msgs/msg/WrenchStamped",
            ),
        ],
    )
    def test_what_does_not_fit_is_one_line_and_nothing_is_written(self, python, tmp_path, published, driven, named):
        (tmp_path / "a.yaml").write_text(published)
        (tmp_path / "b.yaml").write_text(driven)
        with arm(python, "--topics", tmp_path / "a.yaml"):
            said = run(python, "state-3mm", "--robot", f"ros2:{tmp_path / 'b.yaml'}", "--out", tmp_path / "o", code=2)
        assert named in said and "\n" not in said, said
        assert not (tmp_path / "o").exists()

    def test_an_arm_that_somebody_else_commands_is_left_alone(self, python, tmp_path):
        (tmp_path / "speaks.py").write_text(SPEAKS)
        with arm(python), process(python, tmp_path / "speaks.py"):
            said = run(python, "state-3mm", "--robot", "ros2", "--out", tmp_path / "o", code=2)
        assert "/target_pose: somebody else publishes it too; expected 1; got 2" in said and "\n" not in said

    def test_pictures_come_with_their_camera(self, python, tmp_path):
        """A policy that sees depth, by pictures at 15 Hz, reaches a goal that it is not told."""
        with arm(python, "--see", "depth", "--seed", "3"):
            run(python, "depth-S-randomized", "--robot", "ros2", "--out", tmp_path / "trials")
        trial = read_trial(tmp_path / "trials/trial-0001")
        assert trial.recording.frames is not None and len(trial.recording.frames.cameras) == 2
        assert trial.said.outcome.success
