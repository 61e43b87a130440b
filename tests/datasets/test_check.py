"""Every kind of damage to a dataset is found and named; a sound one is not complained about."""

import json
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rendered import LAYOUT, PLAN, as_before, source

from vispeg.core.errors import UserError
from vispeg.datasets.check import check
from vispeg.datasets.read import Dataset
from vispeg.datasets.shards.rendering import render

DATA, META = "data/chunk-000/file-001.parquet", "meta/episodes/chunk-000/file-001.parquet"


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return render(PLAN, LAYOUT, source, tmp_path_factory.mktemp("check") / "d", workers=0)


@pytest.fixture(scope="module")
def before(tmp_path_factory):
    """A dataset as it was written before depth and parts became arrays."""
    return render(PLAN, as_before(LAYOUT), source, tmp_path_factory.mktemp("check") / "d", workers=0)


@pytest.fixture
def copy(sound, tmp_path):
    """A copy without the digests, so that damage is found by what it is."""
    shutil.copytree(sound, tmp_path / "d")
    (tmp_path / "d/meta/render.json").unlink()
    return tmp_path / "d"


def changed(folder, change, name=DATA):
    table = change(pq.read_table(folder / name))
    pq.write_table(table, folder / name)


def with_column(table, name, change):
    at = table.schema.get_field_index(name)
    field = table.schema.field(at)
    return table.set_column(at, field, pa.array(change(table[name].to_pylist()), field.type))


def edit(index, value):
    def change(values):
        values = list(values)
        values[index] = value(values[index]) if callable(value) else value
        return values

    return change


def test_a_sound_dataset_has_nothing_wrong(sound, copy):
    seen = []
    assert check(sound, seen.append) == [] and sum(seen) == PLAN.frames
    assert check(copy) == []


def test_a_dataset_of_before_has_nothing_wrong(before):
    assert check(before) == []


def test_changed_or_missing_files_are_told_by_digest(sound, tmp_path):
    folder = tmp_path / "d"
    shutil.copytree(sound, folder)
    data = bytearray((folder / DATA).read_bytes())
    data[len(data) // 2] ^= 1
    (folder / DATA).write_bytes(data)
    (folder / META).unlink()
    found = check(folder)
    assert len(found) == 2 and "file-001.parquet: was cut short or changed" in found[0] and "is missing" in found[1]


def test_the_episode_of_a_fault_is_named_wherever_the_dataset_lies(copy, tmp_path):
    """The name of a folder is not taken for that of the episode, which is named once."""
    folder = copy.rename(tmp_path / "episode 7 of mine")
    changed(folder, lambda t: with_column(t, "observation.depth.eye", edit(1, None)))
    (fault,) = check(folder)
    assert fault.startswith(f"episode 3: {folder / DATA}: observation.depth.eye: has no value in 1 frame"), fault
    changed(folder, lambda t: with_column(t, "observation.images.eye", edit(1, None)))
    with pytest.raises(UserError, match=r"^episode 3: /[^:]*: observation.depth.eye"):
        Dataset(folder).episode(3)
    with pytest.raises(UserError, match=r"^episode 3, frame 1, observation.images.eye: is not a picture"):
        Dataset(folder, ["observation.images.eye"]).episode(3)


def test_a_file_cut_short_is_named(copy):
    data = (copy / DATA).read_bytes()
    (copy / DATA).write_bytes(data[: len(data) // 2])
    found = check(copy)
    assert len(found) == 1 and DATA in found[0] and "cut short" in found[0]


def test_a_picture_cut_short_is_named(before, tmp_path):
    copy = tmp_path / "d"
    shutil.copytree(before, copy)
    (copy / "meta/render.json").unlink()
    cut = edit(2, lambda v: {"bytes": v["bytes"][:60], "path": None})
    changed(copy, lambda t: with_column(t, "observation.images.eye_depth", cut))
    found = check(copy)
    assert len(found) == 1 and "frame 2, observation.images.eye_depth: is not a picture" in found[0]


def test_repeated_frames_are_named(copy):
    def repeat(table):
        for name in set(LAYOUT.features):
            values = table[name].to_pylist()
            table = with_column(table, name, edit(5, values[1]))
        return table

    changed(copy, repeat)
    first = PLAN.shards[1].first
    assert f"frame {first + 5}: repeats frame {first + 1}" in check(copy)


@pytest.mark.parametrize(
    ("name", "index", "value", "words"),
    [
        ("index", 3, 999, "index is 999"),
        ("frame_index", 1, 5, "frame_index is 5"),
        ("timestamp", 1, 9.0, "timestamp is 9"),
        ("observation.state", 0, [0.0, np.nan, 0.0], "observation.state is not finite"),
        ("action", 0, [50.0, 0.0, 0.0], "of action is not that of the frames"),
    ],
)
def test_contradictions_are_named(copy, name, index, value, words):
    changed(copy, lambda t: with_column(t, name, edit(index, value)))
    found = check(copy)
    assert any(words in line for line in found), found


def test_episodes_that_do_not_follow_one_another_are_named(copy):
    changed(copy, lambda t: with_column(t, "length", edit(0, 99)), META)
    assert any("expected" in line and "lies at" in line for line in check(copy))


def test_missing_rows_are_named(copy):
    changed(copy, lambda t: t.slice(0, len(t) - 1))
    assert any(f"{PLAN.frames - 1} rows; expected {PLAN.frames}" in line for line in check(copy))


def test_an_episode_told_twice_is_named(copy):
    def same(table):
        values = table["vispeg/seed"].to_pylist(), table["vispeg/look"].to_pylist()
        for name, v in zip(("vispeg/seed", "vispeg/look"), values, strict=True):
            table = with_column(table, name, edit(1, v[0]))
        return table

    changed(copy, same, META)
    assert any("repeats episode" in line for line in check(copy))


def test_totals_are_those_of_the_episodes(copy):
    info = json.loads((copy / "meta/info.json").read_text())
    (copy / "meta/info.json").write_text(json.dumps(info | {"total_episodes": 1}))
    assert any("total_episodes is 1" in line for line in check(copy))
