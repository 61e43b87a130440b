"""Pictures of bags and videos that other libraries wrote come back at their times, as they were."""

from __future__ import annotations

import json
from fractions import Fraction
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from made import recording

from vispeg.api.recording.convert import convert
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.importers.bagimages import camera_name
from vispeg.recordings.importers.camera_info import described
from vispeg.recordings.importers.lerobot_video import decoded, import_video
from vispeg.recordings.importers.mapping import ColumnMap
from vispeg.recordings.importers.pictures import Album
from vispeg.recordings.importers.rosbag import Topics, import_rosbag
from vispeg.recordings.load import load
from vispeg.recordings.write import write
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import save_cameras
from vispeg.robots.model import load as robot
from vispeg.vision.eye import posed

START = 1_700_000_000_000_000_000
H, W = 12, 16
RNG = np.random.default_rng(3)
RGB = RNG.integers(0, 256, (4, H, W, 3), dtype=np.uint8)
STEPS = RNG.integers(0, 4000, (4, H, W), dtype=np.uint16)
JOINTS = ("joint1", "joint2")


def bag(path, kind, damaged="", lens=(0.1, -0.02, 1e-3, 2e-3, 0.0), focal=20.0, more=()):
    """Joint states, and each way of sending a picture, four of each at 0.1 to 0.4 s; rows are padded by 5 bytes.

    The topics `more` hold colour, too.
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    if kind == "bag":
        path, writer = path.with_suffix(".bag"), Writer1(path.with_suffix(".bag"))
    else:
        writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    types = store.types

    def header(at, frame="eye"):
        sec, nanosec = divmod(at, 10**9)
        extra = {"seq": 0} if kind == "bag" else {}
        return types["std_msgs/msg/Header"](
            stamp=types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec), frame_id=frame, **extra
        )

    def image(at, encoding, rows, big=0, frame="eye"):
        flat = np.ascontiguousarray(rows).view(np.uint8).reshape(H, -1)
        data = np.pad(flat, ((0, 0), (0, 5))).ravel()
        data = data[:-40] if damaged == encoding else data
        return types["sensor_msgs/msg/Image"](header(at, frame), H, W, encoding, big, flat.shape[1] + 5, data)

    def packed(at, form, data):
        return types["sensor_msgs/msg/CompressedImage"](header(at), form, np.frombuffer(data, np.uint8))

    def info(at):
        K = np.array([focal, 0, 7.5, 0, 21.0, 5.5, 0, 0, 1])
        roi = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        P = np.array([0.9 * focal, 0, 7.0, 0, 0, 19.0, 5.0, 0, 0, 0, 1, 0])
        rest = np.eye(3).ravel(), P, 0, 0, roi
        return types["sensor_msgs/msg/CameraInfo"](header(at), H, W, "plumb_bob", np.array(lens), K, *rest)

    with writer:
        links = {}

        def send(topic, at, message):
            if topic not in links:
                links[topic] = writer.add_connection(topic, message.__msgtype__, typestore=store)
            to_bytes = store.serialize_ros1 if kind == "bag" else store.serialize_cdr
            writer.write(links[topic], at, to_bytes(message, message.__msgtype__))

        for k in range(60):
            at = START + k * 10_000_000
            state = [np.array([0.01 * k, -0.01 * k]), np.zeros(2), np.zeros(2)]
            send("/joint_states", at, types["sensor_msgs/msg/JointState"](header(at), list(JOINTS), *state))
        for k in range(4):
            at = START + (k + 1) * 100_000_000
            send("/wrist/color/image_raw", at, image(at, "rgb8", RGB[k]))
            send("/side/image_raw", at, image(at, "bgr8", RGB[k][..., ::-1]))
            send("/wrist/depth/image_rect_raw", at, image(at, "16UC1", STEPS[k]))
            send(
                "/side/depth/image",
                at,
                image(at, "32FC1", np.where(STEPS[k] > 0, STEPS[k] * 1e-3, np.nan).astype("f4")),
            )
            send("/d435/color/image_raw", at, image(at, "rgb8", RGB[k], frame="d435_optical"))
            for topic in more:
                send(topic, at, image(at, "rgb8", RGB[k]))
            late, optical = at + 3_000_000, {"frame": "d435_optical"}
            send("/d435/aligned_depth_to_color/image_raw", late, image(late, "16UC1", STEPS[k], **optical))
            send("/png/compressed", at, packed(at, "png", cv2.imencode(".png", RGB[k][..., ::-1])[1].tobytes()))
            deep = b"\0" * 12 + cv2.imencode(".png", STEPS[k])[1].tobytes()
            send("/deep/image/compressedDepth", at, packed(at, "16UC1; compressedDepth png", deep))
            names = ("/wrist/color", "/side", "/wrist/depth", "/side/depth", "/png", "/deep", "/d435/color")
            for name in (*names, *(topic.rpartition("/")[0] for topic in more)):
                send(f"{name}/camera_info", at, info(at))
    return path


def test_depth_of_another_unit_is_refused_as_another_size_is(tmp_path):
    album, depth = Album(tmp_path), np.full((H, W), 0.5)
    album.add("eye", 0.0, depth, unit=1e-3)
    album.add("eye", 0.0, RGB[0])
    album.add("eye", 0.1, depth, unit=1e-3)
    with pytest.raises(
        UserError, match="depth pictures of 'eye' change their unit.*0.001 m per step.*0.0001 m"
    ) as said:
        album.add("eye", 0.2, depth, unit=1e-4)
    assert "\n" not in str(said.value)
    with pytest.raises(UserError, match="change their size"):
        album.add("eye", 0.2, depth[:6], unit=1e-3)


@pytest.mark.parametrize("other", ["/side/image_rect", "/si/de/image_raw"])
def test_two_topics_do_not_become_one_camera(other, tmp_path):
    """Raw and rectified pictures have different intrinsics; two namespaces are two cameras."""
    pytest.importorskip("rosbags")
    one = {"/side/image_rect": "/side/image_raw", "/si/de/image_raw": "/si_de/image_raw"}[other]
    source, scratch = bag(tmp_path / "run", "mcap", more={one, other} - {"/side/image_raw"}), tmp_path / "scratch"
    scratch.mkdir()
    for images in (("all",), (one, other), (f"eye={one}", f"eye={other}")):
        with pytest.raises(UserError, match="two topics of pictures would be one camera.*expected NAME=TOPIC"):
            import_rosbag(source, "iiwa14", JOINTS, ColumnMap(), Topics(images=images), scratch)
    apart = Topics(images=(one, f"other={other}"))
    frames = import_rosbag(source, "iiwa14", JOINTS, ColumnMap(), apart, scratch).frames
    assert sorted(frames.names) == sorted([camera_name(one), "other"])
    assert all(len(frames.of(name)) == 4 for name in frames.names)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_pictures_of_a_bag(kind, tmp_path):
    pytest.importorskip("rosbags")
    source, scratch = bag(tmp_path / "run", kind), tmp_path / "scratch"
    scratch.mkdir()
    rec = import_rosbag(source, "iiwa14", JOINTS, ColumnMap(), Topics(images=("all",)), scratch)
    frames = load(write(rec, tmp_path / "rig")).frames
    assert sorted(frames.names) == ["d435_color", "deep", "png", "side", "side_depth", "wrist_color", "wrist_depth"]
    for name in ("wrist_color", "side", "png"):
        mine = frames.of(name)
        assert np.allclose(mine.times, [0.1, 0.2, 0.3, 0.4], atol=1e-9)
        assert all(np.array_equal(frame.rgb, truth) for frame, truth in zip(mine, RGB, strict=True)), name
    for name in ("wrist_depth", "side_depth", "deep"):
        mine = frames.of(name)
        assert all(np.allclose(f.depth, t * 1e-3, atol=6e-5) for f, t in zip(mine, STEPS, strict=True)), name
    device = frames.of("d435_color")
    assert len(device) == 4 and np.allclose(device.times, [0.1, 0.2, 0.3, 0.4], atol=1e-9), "a frame has both streams"
    assert all(np.array_equal(f.rgb, rgb) for f, rgb in zip(device, RGB, strict=True))
    assert all(np.allclose(f.depth, t * 1e-3, atol=6e-5) for f, t in zip(device, STEPS, strict=True))
    named = Topics(images=("lid=/side/image_raw", "lid=/side/depth/image", "/png/compressed"))
    assert sorted(import_rosbag(source, "iiwa14", JOINTS, ColumnMap(), named, scratch).frames.names) == ["lid", "png"]
    camera = frames.cameras["wrist_color"]
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (20.0, 21.0, 7.5, 5.5) and camera.pose is None
    assert camera.distortion == (0.1, -0.02, 1e-3, 2e-3, 0.0)
    camera = frames.cameras["wrist_depth"]  # of `image_rect_raw`: the distortion has been removed from the pictures
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (18.0, 19.0, 7.0, 5.0) and not any(camera.distortion)


ARM = """<mujoco><worldbody><body name="one"><joint name="joint1" axis="0 0 1" range="-3 3"/>
<geom size="0.05" mass="1"/><body name="two" pos="0.3 0 0"><joint name="joint2" axis="0 1 0" range="-3 3"/>
<geom size="0.05" mass="1"/></body></body></worldbody><compiler angle="radian"/></mujoco>"""


def test_the_kind_of_a_depth_camera_is_in_the_recording(tmp_path):
    """Of all that have depth, or of one; with it the noise that a diagnosis takes for ordinary is that camera's own."""
    pytest.importorskip("rosbags")
    source = bag(tmp_path / "run", "mcap")
    arm, topics = tmp_path / "arm.xml", Topics(images=("all",))
    arm.write_text(ARM)
    convert(source, str(arm), tmp_path / "all", depth_camera="d405", topics=topics)
    frames = load(tmp_path / "all").frames
    deep = {"d435_color", "deep", "side_depth", "wrist_depth"}
    assert {name for name, camera in frames.cameras.items() if camera.sensor == "d405"} == deep == set(frames.deep)
    convert(
        source, str(arm), tmp_path / "two", depth_camera=("deep=d435", "side_depth=structured_light"), topics=topics
    )
    back = load(tmp_path / "two").frames
    said = {name: camera.sensor for name, camera in back.cameras.items() if camera.sensor}
    assert said == {"deep": "d435", "side_depth": "structured_light"}
    assert {frame.camera.sensor for frame in back.of("deep")} == {"d435"}
    for stated, images, said in (
        ("d455", topics, "did you mean"),
        (("deep=d405", "deep=d435"), topics, "twice"),
        (("deep=d405", "d435"), topics, "twice"),
        ("png=d435", topics, "no such camera with depth"),
        ("d435", Topics(images=("/png/compressed",)), "no camera has depth"),
        ("d435", None, "taken over with images"),
    ):
        with pytest.raises(UserError, match=said):
            convert(source, str(arm), tmp_path / "not", topics=images, depth_camera=stated)
    assert not (tmp_path / "not").exists()


def test_what_is_wrong_with_a_bags_pictures_is_said(tmp_path):
    pytest.importorskip("rosbags")
    source = bag(tmp_path / "run", "mcap", damaged="rgb8")
    for images, said in (
        (("/wrist/color/image_raw",), "a picture is cut short"),
        (("/wrist/colour/image_raw",), "did you mean '/wrist/color/image_raw'"),
    ):
        with pytest.raises(UserError, match=said):
            import_rosbag(source, "iiwa14", JOINTS, ColumnMap(), Topics(images=images), tmp_path)


def test_a_camera_that_cannot_be_read_says_why(tmp_path):
    """A lens is refused for its coefficients, not for the name of its model, which is the expected one."""
    pytest.importorskip("rosbags")
    topics = Topics(images=("/wrist/color/image_raw",))
    for number, (stated, said) in enumerate(
        (
            (
                {"lens": (0.1, 0.0, 0.0, 0.0, 0.0, 0.2)},
                r"wrist_color.*no coefficient but.*plumb_bob, \[0.1, .*0.2\]",
            ),
            ({"focal": 0.0}, "not calibrated; expected focal lengths above 0 in K of its CameraInfo"),
        )
    ):
        source = bag(tmp_path / f"run{number}", "mcap", **stated)
        with pytest.raises(UserError, match=said):
            import_rosbag(source, "iiwa14", JOINTS, ColumnMap(), topics, tmp_path)


@pytest.mark.parametrize("flat", [False, True])
def test_a_part_of_a_sensor_in_blocks_of_pixels_keeps_its_directions(flat):
    """A picture whose pixels hold their own column and row, cut and averaged in blocks, says where its pixels look."""
    sensor = {"width": 40, "height": 30, "binning_x": 2, "binning_y": 3, "distortion_model": "plumb_bob"}
    k, p = (
        np.array([[50, 0, 18.7], [0, 51, 15.2], [0, 0, 1]]),
        np.array([[45, 0, 17, -3.0], [0, 46, 14, 0], [0, 0, 1, 0]]),
    )
    part = SimpleNamespace(x_offset=4, y_offset=6, width=30, height=21, do_rectify=False)
    lens = described("wrist", SimpleNamespace(**sensor, roi=part, k=k.ravel(), p=p.ravel(), d=[0.1, 0.01, 0, 0]), flat)
    places = np.stack(np.meshgrid(np.arange(40.0), np.arange(30.0)), -1)[6:27, 4:34]
    blocks = places.reshape(7, 3, 15, 2, 2).mean(axis=(1, 3))
    assert (lens.height, lens.width) == blocks.shape[:2]
    here = np.stack(np.meshgrid(np.arange(lens.width), np.arange(lens.height)), -1)
    stated = p if flat else k
    assert np.allclose(
        (here - (lens.cx, lens.cy)) / (lens.fx, lens.fy), (blocks - stated[:2, 2]) / stated[[0, 1], [0, 1]]
    )
    assert lens.distortion == ((0,) * 5 if flat else (0.1, 0.01, 0, 0, 0))
    part.do_rectify = True
    if flat:
        with pytest.raises(UserError, match="region of interest"):
            described("wrist", SimpleNamespace(**sensor, roi=part, k=k.ravel(), p=p.ravel(), d=[]), flat)


@pytest.mark.parametrize("wrong", [{"focal": 0.0}, {"lens": (0.1, 0, 0, 0, 0, 0.2)}])
def test_a_stated_camera_comes_before_that_of_the_bag_which_may_be_unusable(wrong, tmp_path):
    pytest.importorskip("rosbags")
    source = bag(tmp_path / "run", "mcap", **wrong)
    mine = RecordedCamera("wrist_color", W, H, 20.0, 20.0, 7.5, 5.5)
    topics = Topics(images=("/wrist/color/image_raw",))
    frames = import_rosbag(source, "iiwa14", JOINTS, ColumnMap(), topics, tmp_path, {"wrist_color": mine}).frames
    assert len(frames) == 4 and frames.cameras["wrist_color"].K.tolist() == mine.K.tolist()


def test_cameras_are_named_after_their_namespace():
    assert camera_name("/wrist/color/image_raw/compressed") == "wrist_color"
    assert camera_name("/camera/aligned_depth_to_color/image_raw") == "camera_aligned_depth_to_color"
    assert camera_name("/image") == "image"


def data_set(root, version, rate=20.0, episodes=(30, 20), first=0):
    """A LeRobot folder whose k-th frame is of the grey level 20 + 4 k within its episode (10 more in the second).

    Its table has the episodes from the number `first` on.
    """
    av = pytest.importorskip("av")
    import pyarrow as pa
    import pyarrow.parquet as pq

    three = version == 3
    key = "observation.images.wrist"
    pattern = (
        "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
        if three
        else "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
    )
    levels = [[20 + 4 * k + 10 * e for k in range(n)] for e, n in enumerate(episodes)]
    numbers = [(0, 0, 0, sum(levels, []))] if three else [(0, 0, e, shades) for e, shades in enumerate(levels)]
    words = ("chunk_index", "file_index", "episode_index")
    films = {pattern.format(video_key=key, episode_chunk=0, **dict(zip(words, n, strict=False))): n[3] for n in numbers}
    for name, shades in films.items():
        file = root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(file), "w") as out:
            stream = out.add_stream("mpeg4", rate=int(rate))
            stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 64, 48, "yuv420p", 2_000_000
            for shade in shades:
                picture = np.full((48, 64, 3), shade, np.uint8)
                out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            out.mux(stream.encode(None))
    (root / "meta").mkdir()
    feature = {"observation.state": {"dtype": "float32", "names": list(JOINTS)}, key: {"dtype": "video"}}
    info = {"codebase_version": f"v{version}", "fps": rate, "video_path": pattern, "chunks_size": 1000}
    (root / "meta" / "info.json").write_text(json.dumps(info | {"features": feature}))
    if three:
        (root / "meta" / "episodes").mkdir()
        ends = np.cumsum([0, *episodes]) / rate
        rows = {"episode_index": [0, 1], f"videos/{key}/chunk_index": [0, 0], f"videos/{key}/file_index": [0, 0]}
        rows[f"videos/{key}/from_timestamp"] = ends[:-1].tolist()
        pq.write_table(pa.table(rows), root / "meta" / "episodes" / "file-000.parquet")
    time = np.concatenate([np.arange(n) / rate for n in episodes])
    number = np.repeat([0, 1], episodes)
    angle = 0.3 * np.sin(2 * time)
    rest = {f"q.{joint}": angle for joint in JOINTS}
    table = root / "data.parquet"
    pq.write_table(pa.table({"timestamp": time, "episode_index": first + number, **rest}), table)
    return table, levels


MAP = "time: timestamp\nepisode: episode_index\nrecording: {joints: [joint1, joint2]}\n"


@pytest.mark.parametrize("version", [2, 3])
def test_videos_of_a_data_set(version, tmp_path):
    table, levels = data_set(tmp_path / "set", version)
    eye = Camera("wrist", 64, 48, 60.0, 60.0, 31.5, 23.5, parent="flange", pos=(0.0, -0.1, 0.04))
    save_cameras(tmp_path / "wrist.yaml", eye)
    out = tmp_path / "rig"
    arguments = ["--robot", "iiwa14", "--images", "wrist", "--cameras", str(tmp_path / "wrist.yaml"), "--insist"]
    (tmp_path / "map.yaml").write_text(MAP)
    code = main(["convert", str(table), *arguments, "--map", str(tmp_path / "map.yaml"), "--out", str(out)])
    assert code == 0
    frames = load(out).frames
    assert frames.cameras["wrist"].mount == "flange" and len(frames) == 50
    for frame, level in zip(frames, sum(levels, []), strict=True):
        assert abs(float(np.median(frame.rgb)) - level) < 2.5, (frame.episode, frame.time)


@pytest.mark.parametrize(
    ("missing", "rate", "shown"),
    [((3,), 10, (0, 1, 2, 4, 5, 6, 7, 8, 9)), ((), 20, (0, 2, 4, 6, 8)), ((), 5, (0, 1, 2, 3, 4, 5, 6, 7, 8, 9))],
)
def test_times_take_the_nearest_frame_of_a_video_and_a_missing_one_costs_its_own_time_only(
    missing, rate, shown, tmp_path
):
    """A film of 10 frames a second, frame k of grey 12 k; `shown`: the rows of a table at `rate` with a picture."""
    av = pytest.importorskip("av")
    with av.open(str(tmp_path / "film.mp4"), "w") as out:
        stream = out.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 64, 48, "yuv420p", 2_000_000
        for k in range(20):
            if k not in missing:
                frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 12 * k, np.uint8), format="rgb24")
                frame.pts, frame.time_base = k, Fraction(1, 10)
                out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    found = list(decoded(tmp_path / "film.mp4", np.arange(10) / rate, 0.0))
    assert [time for time, _ in found] == pytest.approx([k / rate for k in shown])
    assert [float(np.median(picture)) / 12 for _, picture in found] == pytest.approx(
        [10 * k / rate for k in shown], abs=0.3
    )


LAB = """<mujoco><worldbody><body><joint name="joint1" axis="0 0 1"/><geom size=".1" mass="1"/>
  <body pos="0 0 .3"><joint name="joint2" axis="0 1 0"/><geom size=".1" mass="1"/><site name="flange" pos="0 0 .1"/>
    <camera name="wrist" pos="0 .1 .1" xyaxes="1 0 0 0 -1 0" {}/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("stated", "mount"), [('resolution="64 48"', "flange"), ("", None)])
def test_a_camera_file_without_a_pose_leaves_that_of_the_robot_s_file(stated, mount, tmp_path):
    """ROS's camera_info holds the lens; `mount` None: the recording states no pose, that of the MJCF holds."""
    table, _ = data_set(tmp_path / "set", 2)
    (tmp_path / "lab.xml").write_text(LAB.format(stated))
    (tmp_path / "map.yaml").write_text(MAP)
    lens = save_cameras(tmp_path / "lens.yaml", Camera("wrist", 64, 48, 61.0, 60.0, 31.5, 23.5), style="ros")
    options = {"mapping": tmp_path / "map.yaml", "topics": Topics(images=("wrist",)), "insist": True}
    rec = convert(table, str(tmp_path / "lab.xml"), tmp_path / "rig", cameras=lens, **options)
    eye = rec.frames.cameras["wrist"]
    assert (eye.fx, eye.mount) == (61.0, mount)
    eye = posed(load(tmp_path / "rig").frames, robot(rec.robot)).cameras["wrist"]
    assert (eye.fx, eye.mount) == (61.0, "flange")
    np.testing.assert_allclose(eye.pose[:3], np.eye(4)[:3] + np.outer((0, 0.1, 0), (0, 0, 0, 1)), atol=1e-9)


def test_what_is_wrong_with_videos_is_said(tmp_path):
    table, _ = data_set(tmp_path / "set", 2)
    rec = recording(n=30, rate_hz=20.0)
    with pytest.raises(UserError, match="nothing is known of camera 'wrist'"):
        import_video(table, rec, ("all",), {}, tmp_path)
    with pytest.raises(UserError, match="no such video"):
        import_video(table, rec, ("wist",), {}, tmp_path)
    film = next((tmp_path / "set").rglob("episode_000000.mp4"))
    film.write_bytes(film.read_bytes()[:200])
    with pytest.raises(UserError, match="is not a video that can be decoded"):
        import_video(table, rec, ("wrist",), {}, tmp_path)
    with pytest.raises(UserError, match="belongs to no LeRobot data set"):
        import_video(tmp_path / "x.parquet", rec, ("wrist",), {}, tmp_path)


def test_videos_of_another_episode_are_refused(tmp_path):
    """A table begins with episode 5, and a map names no episodes: those that the clock tells would be 0 and 1."""
    table, _ = data_set(tmp_path / "set", 2, first=5)
    (tmp_path / "map.yaml").write_text(MAP.replace("episode: episode_index\n", ""))
    save_cameras(tmp_path / "wrist.yaml", Camera("wrist", 64, 48, 60.0, 60.0, 31.5, 23.5))
    options = {"mapping": tmp_path / "map.yaml", "topics": Topics(images=("wrist",)), "insist": True}
    options |= {"cameras": tmp_path / "wrist.yaml"}
    with pytest.warns(UserWarning, match="stepped back"), pytest.raises(UserError, match="no such episode") as said:
        convert(table, "iiwa14", tmp_path / "rig", **options)
    assert "`episode: episode_index` in the map" in str(said.value) and not (tmp_path / "rig").exists()
