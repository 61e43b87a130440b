"""Bags written by another library's writer come back as what was put in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made import recording
from typed import convert as typed_convert

from vispeg.api.recording.convert import convert
from vispeg.core.errors import UserError
from vispeg.formats.yaml_data import parse_yaml
from vispeg.recordings.importers.bagfile import messages, open_bag
from vispeg.recordings.importers.mapping import ColumnMap, map_from
from vispeg.recordings.importers.rosbag import Topics, import_rosbag
from vispeg.recordings.load import load
from vispeg.recordings.resample import hold, linear, poses

rosbags = pytest.importorskip("rosbags")
pytestmark = pytest.mark.filterwarnings("ignore:.*torque_sensor", "ignore:.*messages that its index")
JOINTS = ("joint1", "joint2")
START = 1_700_000_000_000_000_000


def bag(path: Path, kind: str, rec, stamped: bool = True, asked=None) -> Path:
    """A bag with measured and commanded states, poses at a fifth of the rate, wrenches, and a gripper on the side.

    Names come in another order than the joints, and the order changes half-way. `asked` are commanded efforts.
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    if kind == "bag":
        path, writer = path.with_suffix(".bag"), Writer1(path.with_suffix(".bag"))
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer(path, version=9, storage_plugin=plugin)
    types = store.types

    def header(at: int):
        sec, nanosec = divmod(at if stamped else 0, 10**9)
        extra = {"seq": 0} if kind == "bag" else {}
        stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="base", **extra)

    def state(at, names, q, dq, tau):
        arrays = [np.asarray(v, float) for v in (q, dq, tau)]
        return types["sensor_msgs/msg/JointState"](header(at), list(names), *arrays)

    def vector(v):
        return types["geometry_msgs/msg/Vector3"](*map(float, v))

    def pose(at, p):
        point, turn = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]
        inner = types["geometry_msgs/msg/Pose"](point(*map(float, p[:3])), turn(*map(float, [*p[4:], p[3]])))
        return types["geometry_msgs/msg/PoseStamped"](header(at), inner)

    def wrench(at, w):
        inner = types["geometry_msgs/msg/Wrench"](vector(w[:3]), vector(w[3:]))
        return types["geometry_msgs/msg/WrenchStamped"](header(at), inner)

    with writer:
        kinds = {
            "/joint_states": "sensor_msgs/msg/JointState",
            "/command": "sensor_msgs/msg/JointState",
            "/pose": "geometry_msgs/msg/PoseStamped",
            "/wrench": "geometry_msgs/msg/WrenchStamped",
        }
        to = {topic: writer.add_connection(topic, name, typestore=store) for topic, name in kinds.items()}

        def send(topic, at, message):
            to_bytes = store.serialize_ros1 if kind == "bag" else store.serialize_cdr
            writer.write(to[topic], at, bytes(to_bytes(message, kinds[topic])))

        for k, t in enumerate(rec.time):
            at = START + int(round(t * 1e9))
            order = [1, 0] if k < len(rec.time) // 2 else [0, 1]
            names = [JOINTS[j] for j in order]
            send("/joint_states", at, state(at, names, rec.q[k, order], rec.dq[k, order], rec.tau[k, order]))
            if k % 3 == 0:
                send("/joint_states", at + 5000, state(at + 5000, ["finger"], [0.01], [], []))
            effort = [] if asked is None else asked[k]
            send("/command", at + 300_000, state(at + 300_000, JOINTS, rec.q_cmd[k], [], effort))  # 0.3 ms after
            if k % 5 == 0:
                send("/pose", at, pose(at, rec.ee[k]))
                send("/wrench", at, wrench(at, rec.ft[k]))
    return path


def turning(time):
    """Pose on a line, turning about z at 1 rad/s: straight for `linear`, an arc for `poses`."""
    zero = np.zeros_like(time)
    return np.stack([0.1 * time, zero, 0.5 + 0.2 * time, np.cos(time / 2), zero, zero, np.sin(time / 2)], 1)


def made(n=101):
    rec = recording(n)
    return recording(n, ee=turning(rec.time), ft=np.outer(rec.time, np.arange(1.0, 7.0)))


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_a_bag_comes_back(tmp_path, kind, stamped):
    rec = made()
    path = bag(tmp_path / "run", kind, rec, stamped)
    topics = {"topic": "/joint_states", "command_topic": "/command", "torque_sensor": "joint"}
    (tmp_path / "map.yaml").write_text("recording: {joints: [joint1, joint2]}")
    assert typed_convert(path, "iiwa14", tmp_path / "out", map=tmp_path / "map.yaml", **topics) == 0
    back = load(tmp_path / "out")
    assert np.allclose(back.time, rec.time, atol=1e-9) and back.rate_hz == 500.0
    for name in ("q", "dq", "tau", "q_cmd"):
        assert np.array_equal(getattr(back, name), getattr(rec, name)), name
    assert np.allclose(back.ee, rec.ee, atol=1e-9) and np.allclose(back.ft, rec.ft, atol=1e-9)
    assert back.tau_cmd is None and back.dq_cmd is None


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_one_storage_file_without_its_metadata(tmp_path, kind):
    rec = made(30)
    folder = bag(tmp_path / "run", kind, rec)
    (file,) = folder.glob(f"*.{kind}")
    alone = file.rename(tmp_path / f"alone.{kind}")
    back = import_rosbag(alone, "iiwa14", JOINTS, topics=Topics(joints="/joint_states"))
    assert np.array_equal(back.q, rec.q) and back.q_cmd is None


def test_joints_under_other_names(tmp_path):
    path = bag(tmp_path / "run", "db3", made(30))
    topics = Topics(joints="/joint_states")
    mapping = ColumnMap(joints={"a": "joint2"})
    assert np.array_equal(import_rosbag(path, "iiwa14", ("a",), mapping, topics).q[:, 0], made(30).q[:, 1])
    with pytest.raises(UserError, match="'elbow'.*choices: finger, joint1, joint2"):
        import_rosbag(path, "iiwa14", ("elbow",), topics=topics)


def test_a_map_says_of_a_bag_what_it_can_say(tmp_path):
    """Columns and rates of a map are refused, and a unit that cannot be true is no fault of the map."""
    path, topics = bag(tmp_path / "run", "db3", made(30)), Topics(joints="/joint_states")
    for line, key in (("q.joint1: {column: joint1, unit: deg}", "q.joint1"), ("time: {rate_hz: 100}", "time.rate_hz")):
        mapping = map_from(parse_yaml(line, tmp_path), tmp_path / "map.yaml", JOINTS)
        with pytest.raises(UserError, match=rf"map.yaml: {key}: is not used with a bag"):
            import_rosbag(path, "iiwa14", JOINTS, mapping, topics)
    rec = made(30)
    degrees = bag(tmp_path / "degrees", "db3", replace(rec, q=2 + np.rad2deg(rec.q) % 4))
    (tmp_path / "map.yaml").write_text("recording: {joints: [joint1, joint2]}")
    with pytest.raises(UserError, match="degrees: .*the right unit in the bag"):
        convert(degrees, "iiwa14", tmp_path / "rig", mapping=tmp_path / "map.yaml", topics=topics)


def test_a_topic_is_chosen_only_where_there_is_one(tmp_path):
    path = bag(tmp_path / "run", "db3", made(30))
    with pytest.raises(UserError, match="several topics.*topic.*/command, /joint_states"):
        import_rosbag(path, "iiwa14", JOINTS)
    assert import_rosbag(path, "iiwa14", JOINTS, topics=Topics(command="/command")).q_cmd is not None
    with pytest.raises(UserError, match="did you mean '/joint_states'"):
        import_rosbag(path, "iiwa14", JOINTS, topics=Topics(joints="/joint_state"))
    with pytest.raises(UserError, match="another type"):
        import_rosbag(path, "iiwa14", JOINTS, topics=Topics(joints="/pose"))


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_damaged_bags(tmp_path, kind):
    path = bag(tmp_path / "run", kind, made(20))
    file = path if kind == "bag" else next(path.glob(f"*.{kind}"))
    whole = file.read_bytes()
    rng = np.random.default_rng(8)
    for cut in (0, 10, len(whole) // 2):
        file.write_bytes(whole[:cut])
        with pytest.raises(UserError):
            import_rosbag(path, "iiwa14", JOINTS, topics=Topics(joints="/joint_states"))
    for _ in range(30):
        data = bytearray(whole)
        for place in rng.integers(0, len(whole), 40):
            data[place] = rng.integers(256)
        file.write_bytes(bytes(data))
        try:
            import_rosbag(path, "iiwa14", JOINTS, topics=Topics(joints="/joint_states"))
        except UserError as error:
            assert "\n" not in str(error)
    with pytest.raises(UserError, match="not exist"):
        import_rosbag(tmp_path / "gone.bag", "iiwa14", JOINTS)


def test_what_the_caller_raises_is_not_told_as_a_damaged_bag(tmp_path):
    path = bag(tmp_path / "run", "db3", made(20))
    with pytest.raises(ZeroDivisionError), open_bag(path) as reader:
        for _ in messages(reader, "/joint_states", "sensor_msgs/msg/JointState", path):
            raise ZeroDivisionError


def test_interpolation_leaves_gaps_and_ends_alone():
    time = np.array([0.0, 0.1, 0.2, 0.6, 0.7, 0.8])
    clock = np.array([-0.01, 0.05, 0.2, 0.4, 0.6, 0.8, 0.81])
    got = linear(clock, time, 3 * time[:, None])[:, 0]
    assert np.allclose(got, [np.nan, 0.15, 0.6, np.nan, 1.8, 2.4, np.nan], equal_nan=True)


def test_orientations_follow_the_arc_whatever_the_sign():
    time = np.arange(0, 3, 0.5)
    sent = turning(time)
    sent[::2, 3:] *= -1  # the same rotations
    clock = np.linspace(0, 2.5, 41)
    got, want = poses(clock, time, sent), turning(clock)
    assert np.allclose(np.abs(np.sum(got[:, 3:] * want[:, 3:], axis=1)), 1, atol=1e-12)
    assert np.allclose(got[:, :3], want[:, :3])


def test_slow_commands_hold_and_quick_ones_go_to_their_reading():
    clock = np.arange(6) / 100
    slow = hold(clock, np.array([0.0, 0.03]), np.array([[1.0], [2.0]]))[:, 0]
    assert slow.tolist() == [1, 1, 1, 2, 2, 2]
    late = hold(clock, clock + 0.002, np.arange(6.0)[:, None])[:, 0]
    assert late.tolist() == [0, 1, 2, 3, 4, 5]
    assert np.isnan(hold(clock, np.array([0.025, 0.09]), np.ones((2, 1)))[:3]).all()


def test_efforts_that_are_currents_become_torques_by_torque_constants(tmp_path):
    """As the drivers of Universal Robots publish them."""
    body = '<body name="{0}" pos="0 0 .3"><joint name="{0}" axis="0 1 0" range="-3 3"/><geom size=".05" mass="1"/>'
    links = body.format("joint1") + body.format("joint2") + "</body></body>"
    (tmp_path / "arm.xml").write_text(f"<mujoco><worldbody>{links}</worldbody></mujoco>")
    rec = recording(200)
    file, topics = bag(tmp_path / "run", "mcap", rec, asked=1.5 * rec.tau), Topics("/joint_states", "/command")
    arm = str(tmp_path / "arm.xml")
    back = convert(file, arm, tmp_path / "rig", topics=topics, torque_constants=["10", "10"], insist=True)
    np.testing.assert_allclose(back.tau, 10 * rec.tau, atol=1e-12)
    np.testing.assert_allclose(back.tau_cmd, 15 * rec.tau, atol=1e-12)
    motors = ColumnMap(motors={"joint1": {"joint1": 0.125}})
    with pytest.raises(UserError, match="are not used with motors of a map"):
        convert(file, arm, tmp_path / "other", mapping=motors, topics=topics, torque_constants=["10", "10"])
    assert back.torque_sensor == "motor"
    with pytest.raises(UserError, match="no constant of this joint; got 'joint1'"):
        convert(file, arm, tmp_path / "other", topics=topics, torque_constants=["joint2=8"], insist=True)
    assert not (tmp_path / "other").exists()
