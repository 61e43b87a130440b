"""A log that others' software wrote, of a camera that its user named: converted, checked, compared and diagnosed."""

from __future__ import annotations

import json

import pytest
import yaml

from vispeg.api.recording.look import cameras_of, look_of, scene_of
from vispeg.api.recording.record import record as recorded
from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.recordings.cell import CellBelief
from vispeg.render.cameras.camera_files import save_cameras
from vispeg.worlds.world import World

CELL = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
SCENE = scene_of(CELL)
(HAND,) = (c.moved(name="hand") for c in cameras_of(["wrist_wide"], SCENE, (160, 120)))
NANO = 1_000_000_000


def bag(path, rec) -> None:
    """Writes joint states and the pictures of a recording as a bag, by the library that ROS users have."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types

    def header(at: int):
        stamp = types["builtin_interfaces/msg/Time"](sec=at // NANO, nanosec=at % NANO)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="hand")

    def joints(at: int, q, dq, tau):
        return types["sensor_msgs/msg/JointState"](header(at), list(rec.joints), q, dq, tau)

    def picture(at: int, rgb):
        height, width = rgb.shape[:2]
        return types["sensor_msgs/msg/Image"](header(at), height, width, "rgb8", 0, 3 * width, rgb.ravel())

    sent = [(t, "/joint_states", joints, row) for t, *row in zip(rec.time, rec.q, rec.dq, rec.tau, strict=True)]
    sent += [(frame.time, "/hand/image_raw", picture, [frame.rgb]) for frame in rec.frames]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {"/joint_states": "sensor_msgs/msg/JointState", "/hand/image_raw": "sensor_msgs/msg/Image"}
        links = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
        for time, topic, make, values in sorted(sent, key=lambda s: s[0]):
            at = 1_700_000_000 * NANO + round(time * NANO)
            writer.write(links[topic], at, store.serialize_cdr(make(at, *values), kinds[topic]))


@pytest.mark.slow
def test_from_a_bag_to_the_camera_s_offset(tmp_path, capsys, monkeypatch):
    pytest.importorskip("rosbags")
    monkeypatch.chdir(tmp_path)
    save_cameras("hand.yaml", HAND)
    hidden = EffectInstance.of("camera_offset", "hand", x=0.004)
    for seed, name in ((61, "a"), (62, "b")):
        world = CELL.add(*look_of(f"S/{seed}", SCENE), hidden)
        rec = recorded(world, "look", cameras="hand.yaml", fps=0.7, rate_hz=100.0, seed=seed).recording
        bag(tmp_path / f"{name}-log", rec)
        stated = {"cell": "nominal", "tool": rec.tool}
        (tmp_path / "map.yaml").write_text(yaml.safe_dump({"recording": stated}))
        read = ["--images", "all", "--cameras", "hand.yaml", "--torque-sensor", "joint", "--map", "map.yaml"]
        assert main(["convert", f"{name}-log", "--robot", "iiwa14", *read, "--out", name]) == 0
    assert main(["check", "a", "--out", "checked"]) == 0
    excited = json.loads((tmp_path / "checked/check.json").read_text())["recordings"][0]["excited"]
    assert {x["where"] for x in excited if x["effect"] == "camera_offset"} == {"hand"}
    assert main(["diagnose", "peg-cell", "--recording", "a", "--validate", "b", "--out", "found"]) == 0
    record = json.loads((tmp_path / "found/diagnosis.json").read_text())
    (named,) = record["effects"]
    assert (named["effect"], named["where"]) == ("camera_offset", "hand")
    assert abs(named["params"]["x"]["value"] - 0.004) < 3e-4
    off = []
    for model in ("peg-cell", "found/model.yaml"):
        assert main(["compare", model, "--recording", "b", "--out", "off", "--overwrite"]) == 0
        (camera,) = json.loads((tmp_path / "off/compare.json").read_text())["pictures"]["cameras"]
        assert camera["camera"] == "hand"
        off.append(camera["border_median_px"])
    assert off[1] < 0.3 and 3 * off[1] < off[0]
    capsys.readouterr()
