"""The readers agree with what was put in; BOP's poses put known points where the camera sees them."""

import json
import shutil

import cv2
import numpy as np
import pytest
from pyarrow import parquet
from rendered import EYE, LAYOUT, PLAN, frame, source

from vispeg.core.errors import UserError
from vispeg.datasets.codec import decode, encode, to_steps
from vispeg.datasets.describe import CAMERAS
from vispeg.datasets.example import write_dataset
from vispeg.datasets.formats.bop import box, matrix, objects
from vispeg.datasets.formats.registry import export
from vispeg.datasets.layout import COUNTED
from vispeg.datasets.read import Dataset
from vispeg.datasets.shards.rendering import render


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return render(PLAN, LAYOUT, source, tmp_path_factory.mktemp("read") / "d", workers=0)


def test_frames_one_by_one_and_by_episode_are_the_same(folder):
    data = Dataset(folder)
    assert len(data) == PLAN.frames
    for number, e in enumerate(data.episodes):
        whole = data.episode(number)
        for step in range(e["length"]):
            one = data[e["dataset_from_index"] + step]
            want = frame(e["vispeg/seed"], e["vispeg/look"], step)
            assert set(one) == set(LAYOUT.all) == set(whole)
            for name in set(one) - set(COUNTED):
                assert one[name].dtype == LAYOUT.all[name].get("dtype") or LAYOUT.all[name]["dtype"] == "image"
                assert np.array_equal(one[name], np.asarray(want[name]).astype(one[name].dtype))
                assert np.array_equal(one[name], whole[name][step])
    assert np.array_equal(data.numbers("index"), np.arange(PLAN.frames))
    assert np.array_equal(data.numbers("action"), np.stack([f["action"] for f in data]))
    assert np.array_equal(data[-1]["index"], PLAN.frames - 1)
    with pytest.raises(IndexError):
        data[PLAN.frames]


def test_row_groups_that_are_as_many_as_the_episodes_but_end_elsewhere_are_not_taken_for_them(folder, tmp_path):
    """As another program writes them: groups of one size, and episodes of several."""
    copy = shutil.copytree(folder, tmp_path / "d")
    data, there = Dataset(copy), Dataset(folder)
    odd = 0
    for path in data.data_files:
        lengths = [e["length"] for e in data.episodes if data._data_file(e) == path]
        whole = parquet.read_table(path)
        parquet.write_table(whole, path, row_group_size=-(-len(whole) // len(lengths)))
        groups = parquet.ParquetFile(path).metadata
        odd += groups.num_row_groups == len(lengths) and groups.row_group(0).num_rows != lengths[0]
    assert odd
    for number in range(len(data.episodes)):
        assert np.array_equal(data.episode(number)["index"], there.episode(number)["index"])


def test_a_reader_of_some_features_reads_those(folder):
    data = Dataset(folder, ["action"])
    assert set(data[5]) == {"action"}
    with pytest.raises(UserError, match="no such feature.*did you mean 'action'"):
        Dataset(folder, ["actoin"])


def test_what_is_no_dataset_is_told_so(tmp_path, folder):
    with pytest.raises(UserError, match="is not a dataset"):
        Dataset(tmp_path)
    (tmp_path / "d.unfinished").mkdir()
    with pytest.raises(UserError, match="is an unfinished rendering"):
        Dataset(tmp_path / "d")
    (tmp_path / "x/meta").mkdir(parents=True)
    (tmp_path / "x/meta/info.json").write_text('{"codebase_version": "v2.1"}')
    with pytest.raises(UserError, match="codebase_version.*expected v3.0.*v2.1"):
        Dataset(tmp_path / "x")


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_pictures_come_back_bit_for_bit(dtype):
    rng = np.random.default_rng(0)
    for shape in ((1, 1), (5, 300), (7, 3, 3)):
        if len(shape) == 3 and dtype != "uint8":
            continue
        image = (rng.uniform(0, 255, shape)).astype(dtype)
        assert np.array_equal(decode(encode(image)), image) and decode(encode(image)).dtype == image.dtype
    for broken in (b"", b"PNG", encode(np.zeros((4, 4), np.uint8))[:40]):
        with pytest.raises(UserError, match="frame 3.*not a picture"):
            decode(broken, "frame 3")


def test_sixteen_bit_depth_is_right_to_half_a_step():
    depth = np.array([0.0, np.nan, 4e-5, 0.1, 1.23456, 6.5535, 6.6], np.float32)
    assert to_steps(depth).tolist() == [0, 0, 0, 1000, 12346, 65535, 0]


def test_bop_poses_project_to_where_the_camera_sees(folder, tmp_path):
    export(folder, tmp_path / "bop", "bop")
    with pytest.raises(UserError, match="is a dataset in BOP's layout, .* expected one in LeRobot's layout"):
        export(tmp_path / "bop", tmp_path / "again", "bop")
    assert not (tmp_path / "again").exists()
    data, scenes = Dataset(folder), sorted((tmp_path / "bop/train").iterdir())
    assert len(scenes) == len(data.episodes)
    for number in (0, 3):
        cameras = json.loads((scenes[number] / "scene_camera.json").read_text())
        truth = json.loads((scenes[number] / "scene_gt.json").read_text())
        extents = json.loads((scenes[number] / "scene_gt_info.json").read_text())
        frames = data.episode(number)
        assert len(cameras) == len(truth) == data.episodes[number]["length"]
        for i, peg in enumerate(frames["label.peg"]):
            one = truth[str(i)][0]
            local = np.array([3.0, -2.0, 40.0])  # mm, any point of the peg
            seen = np.reshape(one["cam_R_m2c"], (3, 3)) @ local + one["cam_t_m2c"]
            pixel = np.reshape(cameras[str(i)]["cam_K"], (3, 3)) @ seen
            world = matrix(peg) @ np.append(local / 1000, 1)
            in_camera = np.linalg.inv(matrix(frames["label.camera.eye"][i])) @ world
            assert one["obj_id"] == 1
            assert np.allclose(pixel[:2] / pixel[2], EYE.project(in_camera[:3]), atol=1e-3)
            depth = cv2.imread(str(scenes[number] / f"depth/{i:06d}.png"), cv2.IMREAD_UNCHANGED)
            assert depth.dtype == np.uint16
            metres = depth * cameras[str(i)]["depth_scale"] / 1000
            assert np.abs(metres - frames["observation.depth.eye"][i]).max() <= 0.5001e-4
            mask = cv2.imread(str(scenes[number] / f"mask_visib/{i:06d}_000000.png"), cv2.IMREAD_UNCHANGED) > 0
            assert np.array_equal(mask, frames["label.parts.eye"][i] == 2)
            assert extents[str(i)][0]["px_count_visib"] == mask.sum()


def test_every_object_of_bop_has_its_entry_of_extents_also_one_that_no_picture_labels(folder, tmp_path):
    """`scene_gt` and `scene_gt_info` are read side by side; the goal's pose comes first, its part is not labelled."""
    copy = shutil.copytree(folder, tmp_path / "d")
    info = json.loads((copy / "meta/info.json").read_text())
    features = info["features"]
    info["features"] = {"label.hole": features.pop("label.hole")} | features
    (copy / "meta/info.json").write_text(json.dumps(info))
    cameras = (copy / CAMERAS).read_text()
    assert cameras.count('"fixture"') == 1
    (copy / CAMERAS).write_text(cameras.replace('"fixture"', '"socket"'))
    export(copy, tmp_path / "bop", "bop")
    for scene in (tmp_path / "bop/train").iterdir():
        truth, extents = (json.loads((scene / f"scene_gt{end}.json").read_text()) for end in ("", "_info"))
        named = json.loads((tmp_path / "bop/dataset_info.json").read_text())["objects"]
        for i, seen in truth.items():
            assert [named[str(o["obj_id"])]["name"] for o in seen] == ["fixture", "peg"]
            unlabelled, peg = extents[i]
            mask = cv2.imread(str(scene / f"mask_visib/{int(i):06d}_000001.png"), cv2.IMREAD_UNCHANGED) > 0
            assert unlabelled == {} and peg["px_count_visib"] == mask.sum()


def test_box_is_the_smallest():
    mask = np.zeros((9, 11), bool)
    assert box(mask) == [-1, -1, -1, -1]
    mask[2:5, 3:9] = True
    assert box(mask) == [3, 2, 6, 3]


def test_a_layout_that_there_is_not_is_refused(folder, tmp_path):
    with pytest.raises(UserError, match="choices: bop"):
        export(folder, tmp_path / "x", "bopp")


def test_torch_items_are_the_frames(folder):
    pytest.importorskip("torch")
    import pickle

    from vispeg.learn.experience.dataset import Frames

    frames, data = Frames(folder), Dataset(folder)
    item = pickle.loads(pickle.dumps(frames))[7]  # as a loader's worker gets it
    want = data[7]
    assert item["observation.images.eye"].shape == (3, 8, 12) and item["observation.depth.eye"].shape == (
        1,
        8,
        12,
    )
    assert np.array_equal(np.moveaxis(item["observation.images.eye"].numpy(), 0, -1), want["observation.images.eye"])
    assert np.array_equal(item["observation.depth.eye"][0].numpy(), want["observation.depth.eye"])
    named = Frames(folder, ["observation.images.eye", "observation.depth.eye", "action"], task_names=True)[7]
    assert set(named) == {"rgb_eye", "depth_eye", "action"}


def test_objects_of_bop_are_what_a_dataset_has_poses_of(folder, tmp_path):
    assert objects(Dataset(folder)) == {1: ("peg", "peg"), 2: ("fixture", "hole")}
    other = write_dataset(tmp_path)  # of another task, with other names
    assert objects(Dataset(other)) == {1: ("tool", "tool"), 2: ("fixture", "goal")}
    with pytest.raises(UserError, match="no pose of an object"):
        objects(Dataset(other, ["action", "label.camera.eye"]))


@pytest.mark.parametrize("kind", ["float64", "int32", "bool"])
def test_a_picture_of_another_type_is_refused_not_rounded(kind):
    with pytest.raises(ValueError, match=f"a picture of {kind}; it must be uint8, uint16, float32"):
        encode(np.ones((4, 4), kind))
