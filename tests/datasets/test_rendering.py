"""The same bytes come whatever the number of workers, and after a kill; what a user has is never lost."""

import errno
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rendered import LAYOUT, PLAN, always_deadly, content, deadly, source

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.datasets.shards.engine import local
from vispeg.datasets.shards.plan import Plan, shard_frames
from vispeg.datasets.shards.rendering import render
from vispeg.datasets.shards.shard import shard_bytes


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of an undisturbed rendering in this process."""
    out = tmp_path_factory.mktemp("whole") / "d"
    render(PLAN, LAYOUT, source, out, workers=0)
    return content(out)


def test_shards_cover_the_frames_once_and_evenly():
    for frames in (1, 7, 500, 501, 1000, 99_999):
        shards = Plan("w", "h", frames).shards
        assert [s.first for s in shards] == list(np.cumsum([0, *(s.frames for s in shards)])[:-1])
        assert sum(s.frames for s in shards) == frames
        sizes = {s.frames for s in shards}
        assert max(sizes) <= 500 and max(sizes) - min(sizes) <= 1
    assert shard_frames(64 * 64 * 2) == 500 and 8 <= shard_frames(3 * 4096 * 4096) < 20


def test_a_shard_follows_from_its_number_alone():
    third = PLAN.shards[2]
    assert shard_bytes(source, PLAN, LAYOUT, third) == shard_bytes(source, PLAN, LAYOUT, third)
    assert shard_bytes(source, PLAN, LAYOUT, third) != shard_bytes(source, replace(PLAN, seed=4), LAYOUT, third)


def test_two_workers_one_of_them_killed_make_the_same_bytes(tmp_path, whole, monkeypatch):
    monkeypatch.setenv("VISPEG_TEST_MARK", str(tmp_path / "mark"))
    ticks = []
    render(PLAN, LAYOUT, deadly, tmp_path / "d", workers=2, watch=ticks.append)
    assert (tmp_path / "mark").exists()
    assert content(tmp_path / "d") == whole
    assert sum(ticks) >= PLAN.frames  # the frames of the shard that was lost are told again


def test_workers_that_always_die_are_given_up(tmp_path):
    with pytest.raises(UserError, match="die repeatedly"):
        render(PLAN, LAYOUT, always_deadly, tmp_path / "d", workers=1)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2)])
@pytest.mark.parametrize("stop", [0, 1, 2])
def test_stopped_anywhere_it_goes_on_to_the_same_bytes(tmp_path, whole, order, stop):
    made = []

    def engine(shards, *rest):
        by_number = {s.number: s for s in shards}
        for count, number in enumerate(n for n in order if n in by_number):
            if count == stop and not made_once:
                raise KeyboardInterrupt
            made.append(number)
            yield from local([by_number[number]], *rest)

    out, made_once = tmp_path / "d", False
    with pytest.raises(KeyboardInterrupt):
        render(PLAN, LAYOUT, source, out, engine=engine, workers=0)
    assert not out.exists()
    made_once, before = True, []
    render(PLAN, LAYOUT, source, out, engine=engine, workers=0, watch=before.append)
    assert content(out) == whole
    assert sorted(made) == [0, 1, 2]  # nothing was drawn twice
    assert before[0] == sum(PLAN.shards[n].frames for n in order[:stop])
    assert [p.name for p in tmp_path.iterdir()] == ["d"]


def test_leftovers_of_a_killed_writer_are_cleared(tmp_path, whole):
    work = tmp_path / "d.unfinished"

    def engine(shards, *rest):
        yield from local(shards[:1], *rest)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(PLAN, LAYOUT, source, tmp_path / "d", engine=engine, workers=0)
    (work / "data/chunk-000/.file-001.parquet.1234.part").write_bytes(b"half")
    render(PLAN, LAYOUT, source, tmp_path / "d", workers=0)
    assert content(tmp_path / "d") == whole


def test_an_unfinished_rendering_with_other_settings_is_not_mixed(tmp_path):
    def stops(*rest):
        raise KeyboardInterrupt
        yield

    with pytest.raises(KeyboardInterrupt):
        render(PLAN, LAYOUT, source, tmp_path / "d", engine=stops, workers=0)
    with pytest.raises(UserError, match=r"d\.unfinished: seed: .*another setting.*expected 3; got 4"):
        render(replace(PLAN, seed=4), LAYOUT, source, tmp_path / "d", workers=0)


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path):
    out = tmp_path / "d"
    out.mkdir()
    (out / "thesis.tex").write_text("mine")
    with pytest.raises(UserError, match="not empty"):
        render(PLAN, LAYOUT, source, out, workers=0)
    assert [p.name for p in tmp_path.rglob("*")] == ["d", "thesis.tex"]
    other = tmp_path / "e.unfinished"
    other.mkdir()
    (other / "notes").write_text("mine")
    with pytest.raises(UserError, match="is not an unfinished rendering"):
        render(PLAN, LAYOUT, source, tmp_path / "e", workers=0)
    assert (other / "notes").read_text() == "mine"


def test_overwriting_replaces_only_when_the_new_one_is_complete(tmp_path, whole):
    out = tmp_path / "d"
    with new_folder(out, holds="dataset") as folder:
        (folder / "old").write_text("old")

    def stops(*rest):
        assert (out / "old").exists()
        raise KeyboardInterrupt
        yield

    with pytest.raises(KeyboardInterrupt):
        render(PLAN, LAYOUT, source, out, engine=stops, workers=0, overwrite=True)
    assert (out / "old").exists()
    render(PLAN, LAYOUT, source, out, workers=0, overwrite=True)
    assert content(out) == whole


def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path, whole, monkeypatch):
    real, full = Path.write_bytes, []

    def write(self, data):
        if "file-001" in self.name and not full:
            full.append(self)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(self, data)

    monkeypatch.setattr(Path, "write_bytes", write)
    with pytest.raises(UserError, match="file-001.*No space left on device"):
        render(PLAN, LAYOUT, source, tmp_path / "d", workers=0)
    kept = []
    render(PLAN, LAYOUT, source, tmp_path / "d", workers=0, watch=kept.append)
    assert kept[0] == PLAN.shards[0].frames + PLAN.shards[1].frames
    assert content(tmp_path / "d") == whole


@pytest.mark.parametrize(
    "wrong", [{"frames": 0}, {"looks": 0}, {"size": 4}, {"noise": -0.1}, {"noise": float("nan")}, {"seed": -1}]
)
def test_impossible_plans_name_the_key(wrong):
    with pytest.raises(UserError, match=next(iter(wrong))):
        replace(PLAN, **wrong)
