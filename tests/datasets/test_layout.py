"""A dataset read back as its published specification says, with pyarrow and OpenCV alone, holds what was put in.

The specification: LeRobotDataset v3.0, huggingface.co/docs/lerobot/lerobot-dataset-v3.
"""

import json

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rendered import EYE, LAYOUT, PLAN, frame, source

from vispeg.datasets.layout import column, picture, schema
from vispeg.datasets.shards.rendering import render


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("layout") / "d"
    return render(PLAN, LAYOUT, source, out, workers=0)


@pytest.fixture(scope="module")
def info(folder):
    return json.loads((folder / "meta/info.json").read_text())


@pytest.fixture(scope="module")
def episodes(folder):
    files = sorted((folder / "meta/episodes").glob("chunk-*/file-*.parquet"))
    return [row for file in files for row in pq.read_table(file).to_pylist()]


def expected(plan):
    """(seed, look, step) of every frame."""
    for shard in plan.shards:
        left, number = shard.frames, 0
        while left:
            seed, number = plan.episode_seed(shard.number, number), number + 1
            for look in range(plan.looks):
                for step in range(length := min(left, 4 + seed % 3)):
                    yield seed, look, step
                left -= length


def test_info_states_version_paths_totals_and_features(folder, info, episodes):
    assert info["codebase_version"] == "v3.0" and info["fps"] == 6.25 and info["video_path"] is None
    assert info["total_frames"] == PLAN.frames and info["total_episodes"] == len(episodes) and info["total_tasks"] == 1
    assert info["splits"] == {"train": f"0:{len(episodes)}"}
    assert info["data_path"] == "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    assert {"timestamp", "frame_index", "episode_index", "index", "task_index"} < set(info["features"])
    depth = info["features"]["observation.depth.eye"]
    assert depth["shape"] == [8, 12] and depth["dtype"] == "float32" and depth["info"] == {"depth_unit": "m"}
    assert [k for k, f in info["features"].items() if f["dtype"] == "image"] == ["observation.images.eye"]
    tasks = pq.read_table(folder / "meta/tasks.parquet").to_pylist()
    assert tasks == [{"task_index": 0, "task": "Do it."}]


def test_every_frame_comes_back_bit_for_bit(folder, info, episodes):
    truth = iter(expected(PLAN))
    count = 0
    for e in episodes:
        path = info["data_path"].format(chunk_index=e["data/chunk_index"], file_index=e["data/file_index"])
        table = pq.read_table(folder / path)
        assert table.column_names == list(info["features"])
        rows = [r for r in table.to_pylist() if e["dataset_from_index"] <= r["index"] < e["dataset_to_index"]]
        assert len(rows) == e["length"]
        for i, row in enumerate(rows):
            seed, look, step = next(truth)
            want = frame(seed, look, step)
            assert (e["vispeg/seed"], e["vispeg/look"]) == (seed, look) and row["frame_index"] == i == step
            assert row["episode_index"] == e["episode_index"] and row["index"] == count and row["task_index"] == 0
            assert row["timestamp"] == np.float32(i / 6.25)
            for name in ("observation.state", "action", "label.peg"):
                assert np.array_equal(np.float32(row[name]), want[name].astype(np.float32))
            colour = cv2.imdecode(np.frombuffer(row["observation.images.eye"]["bytes"], np.uint8), -1)[..., ::-1]
            assert np.array_equal(colour, want["observation.images.eye"])
            assert np.array_equal(np.float32(row["observation.depth.eye"]), want["observation.depth.eye"])
            assert np.array_equal(row["label.parts.eye"], want["label.parts.eye"])
            count += 1
    assert count == PLAN.frames and next(truth, None) is None


def test_looks_share_their_states(episodes, folder):
    by = {}
    for e in episodes:
        by.setdefault(e["vispeg/seed"], []).append(e)
    pairs = [p for p in by.values() if len(p) == 2 and p[0]["length"] == p[1]["length"]]
    assert pairs
    for a, b in pairs:
        assert a["stats/observation.state/mean"] == b["stats/observation.state/mean"]
        assert a["stats/observation.images.eye/mean"] != b["stats/observation.images.eye/mean"]


def test_statistics_are_those_of_all_values(folder):
    stats = json.loads((folder / "meta/stats.json").read_text())
    frames = [frame(*key) for key in expected(PLAN)]
    for name, scale in (("observation.state", 1), ("observation.images.eye", 255), ("observation.depth.eye", 1)):
        axes = (0,) if name == "observation.state" else (0, 1, 2)
        values = np.stack([np.asarray(f[name], float) for f in frames]) / scale
        values = values[..., None] if "depth" in name else values
        for key, want in (("min", values.min(axes)), ("max", values.max(axes)), ("mean", values.mean(axes))):
            assert np.allclose(np.ravel(stats[name][key]), want, atol=1e-6)
        assert np.allclose(np.ravel(stats[name]["std"]), values.std(axes), atol=1e-6)
        assert stats[name]["count"] == [PLAN.frames]
    assert np.shape(stats["observation.images.eye"]["mean"]) == (3, 1, 1)
    middle = np.ravel(stats["observation.images.eye"]["q50"])
    assert np.allclose(middle, 0.5, atol=0.05)  # uniform bytes


def test_cameras_and_hugging_face_note(folder):
    cameras = json.loads((folder / "meta/cameras.json").read_text())
    assert cameras["cameras"][0]["fx"] == EYE.fx and cameras["parts"] == ["arm", "peg", "fixture"]
    note = json.loads(pq.read_schema(folder / "data/chunk-000/file-000.parquet").metadata[b"huggingface"])
    assert note["info"]["features"]["observation.images.eye"] == {"_type": "Image"}
    pandas = pytest.importorskip("pandas")
    tasks = pandas.read_parquet(folder / "meta/tasks.parquet")
    assert list(tasks.index) == ["Do it."] and tasks.index.name == "task" and tasks.loc["Do it."].task_index == 0


def test_hugging_face_knows_arrays(folder):
    note = json.loads(pq.read_schema(folder / "data/chunk-000/file-000.parquet").metadata[b"huggingface"])
    features = note["info"]["features"]
    assert features["observation.depth.eye"] == {"shape": [8, 12], "dtype": "float32", "_type": "Array2D"}
    assert features["label.parts.eye"] == {"shape": [8, 12], "dtype": "uint8", "_type": "Array2D"}


@pytest.mark.parametrize("shape", [(1,), (3,), (2, 3)])
@pytest.mark.parametrize("dtype", ["bool", "uint8", "int64", "float32", "float64"])
def test_a_column_is_what_pyarrow_makes_of_its_values(dtype, shape):
    values = np.arange(7 * np.prod(shape)).reshape(7, *shape).astype(dtype)
    feature = {"dtype": dtype, "shape": list(shape), "names": None}
    made = column(feature, values)
    assert made.type == schema({"x": feature}).field("x").type
    assert made.to_pylist() == (values[:, 0] if shape == (1,) else values).tolist()


def test_pictures_are_bytes_without_a_path():
    made = column(picture(EYE), [b"one", b"", b"three"])
    assert made.equals(pa.array([{"bytes": b, "path": None} for b in (b"one", b"", b"three")], made.type))
    assert made.field("path").null_count == 3
