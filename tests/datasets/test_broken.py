"""Every broken dataset ends in findings, or in one line; nothing is left behind, and nothing outside is touched."""

import json
import shutil
from dataclasses import replace
from itertools import islice

import mutations
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rendered import LAYOUT, PLAN, as_before, source

from vispeg.core.errors import UserError
from vispeg.core.marker import MARKER
from vispeg.datasets.check import check
from vispeg.datasets.formats.registry import export
from vispeg.datasets.read import Dataset
from vispeg.datasets.shards.rendering import render
from vispeg.report.dataset.build import write

FEW = ("action", "label.peg", "label.camera.eye", "observation.images.eye", "observation.depth.eye", "label.parts.eye")
KEPT = replace(LAYOUT, features={name: f for name, f in LAYOUT.features.items() if name in (*FEW, "label.hole")})
META, DATA = "meta/episodes/chunk-000/file-000.parquet", "data/chunk-000/file-000.parquet"


EVERY = 7  # of the changes, so that the tests are quick; the slow ones try all


@pytest.fixture(params=[EVERY, pytest.param(1, marks=pytest.mark.slow)], ids=["some", "all"])
def every(request):
    return request.param


@pytest.fixture(params=["now", pytest.param("before", marks=pytest.mark.slow)], scope="module")
def whole(request, tmp_path_factory):
    layout = KEPT if request.param == "now" else as_before(KEPT)
    plan = replace(PLAN, frames=8, shard_frames=8)
    return render(plan, layout, source, tmp_path_factory.mktemp("broken") / "d", workers=0)


@pytest.fixture
def folder(whole, tmp_path):
    """A copy without digests, by which every change would be found."""
    shutil.copytree(whole, tmp_path / "d")
    (tmp_path / "d/meta/render.json").unlink()
    (tmp_path / "d" / MARKER).unlink()  # tells `--overwrite` who wrote the folder; no reader asks for it
    return tmp_path / "d"


def outcomes(changes, folder):
    """How `dataset check` ends on each of the changes, and on a tenth of them `show` and `export`."""
    found, others, out = {}, {}, folder.parent / "out"
    actions = [lambda: write(folder, out, 2), lambda: export(folder, out)]
    for i, what in enumerate(changes):
        found[what] = mutations.tried(lambda: check(folder))
        if i % 10 == 0:
            action = actions[i // 10 % 2]
            others[f"{what}, {i // 10 % 2}"] = ended = mutations.tried(action)
            assert (ended == "fine") == out.exists() and not list(folder.parent.glob(".*")), what
            shutil.rmtree(out, ignore_errors=True)
    assert not mutations.unclear(found | others)
    return found


@pytest.mark.parametrize("name", ["info", "cameras"])
def test_every_change_of_what_describes_the_whole(folder, name, every):
    found = outcomes(mutations.json_files(folder / f"meta/{name}.json", every, most=1), folder)
    assert len(found) > 200 / every
    passed = {what for what, how in found.items() if how == "fine"}
    for what in found:
        assert what not in passed or not what.endswith(("= nan", "= inf", f"= {10**40}"))


def test_every_change_of_how_it_was_made_and_of_statistics(whole, folder, every):
    shutil.copy(whole / "meta/render.json", folder / "meta/render.json")
    outcomes(mutations.json_files(folder / "meta/render.json", every, most=1), folder)
    (folder / "meta/render.json").unlink()
    path = folder / "meta/stats.json"
    path.write_text(json.dumps({"action": json.loads(path.read_text())["action"]}))
    found = outcomes(mutations.json_files(path, every, most=1), folder)
    assert all(how != "fine" for what, how in found.items() if "action.mean =" in what)


def test_every_file_that_is_none(folder):
    names = sorted(f.relative_to(folder).as_posix() for f in folder.rglob("*") if f.is_file())
    found = outcomes(mutations.files(folder, names), folder)
    fine = {what for what, how in found.items() if how == "fine"}
    fine -= {what for what in fine if what.endswith("flipped")}  # in statistics, which only a digest tells
    assert fine == {f"meta/{name}.json missing" for name in ("cameras", "stats")}


def test_with_digests_any_change_is_found(whole, tmp_path):
    folder = tmp_path / "d"
    shutil.copytree(whole, folder)
    names = sorted(json.loads((folder / "meta/render.json").read_text())["files"])
    assert len(names) == sum(f.is_file() for f in folder.rglob("*")) - 2  # render.json and the marker
    for what in mutations.files(folder, names):
        assert mutations.tried(lambda: check(folder)) != "fine", what


CHANGES = {
    "gone": lambda c: None,
    "text": lambda c: pa.array(["x"] * len(c)),
    "nothing": lambda c: pa.nulls(len(c), c.type),
    "some nothing": lambda c: pa.array([None, *c.to_pylist()[1:]], c.type),
    "huge": lambda c: pa.array([10**18] * len(c)),
    "not finite": lambda c: pa.array([np.nan] * len(c)),
    "negative": lambda c: pa.array([-1] * len(c)),
    "lists": lambda c: pa.array([[1.0, 2.0]] * len(c)),
    "uneven": lambda c: pa.array([[[1.0], [2.0, 3.0]]] * len(c)),
    "bytes": lambda c: pa.array([b"\xff"] * len(c)),
    "mapping": lambda c: pa.array([{"bytes": b"x", "path": "y"}] * len(c)),
    "JSON": lambda c: pa.array(['{"a": {"b": NaN}}'] * len(c)),
    "more JSON": lambda c: pa.array(['[{"name": "eye", "width": 1e400}]'] * len(c)),
}


def columns(path, every):
    """Writes each (or every n-th) change of each column of a Parquet file in its place."""
    table = pq.read_table(path)
    with mutations.kept(path):
        for name in [name for name in table.column_names if not name.startswith("stats/")]:
            for what, change in islice(CHANGES.items(), len(name) % every, None, every):
                at, new = table.column_names.index(name), change(table[name])
                changed = table.remove_column(at) if new is None else table.set_column(at, name, new)
                pq.write_table(changed, path)
                yield f"{path.parts[-3]} {name} {what}"
        pq.write_table(table.slice(0, 0), path)
        yield f"{path.parts[-3]} empty"
        pq.write_table(pa.concat_tables([table, table]), path)
        yield f"{path.parts[-3]} twice"


def test_every_change_of_a_column(folder, every):
    for name in (META, DATA, "meta/tasks.parquet"):
        found = outcomes(columns(folder / name, every), folder)
        if name == DATA:
            assert all(how != "fine" for how in found.values())


@pytest.mark.parametrize(
    "path",
    ["../x.parquet", "/etc/passwd", "{chunk_index:>1000000000}", "data/{chunk_index.real}", "{}", "{0}", "x" * 9999],
)
def test_data_files_lie_below_the_folder(folder, path):
    info = json.loads((folder / "meta/info.json").read_text())
    (folder / "meta/info.json").write_text(json.dumps(info | {"data_path": path}))
    with pytest.raises(UserError, match="data_path: does not name the data files; expected a file below the folder"):
        Dataset(folder)


def test_a_camera_that_cannot_be_is_named(folder):
    record = json.loads((folder / "meta/cameras.json").read_text())
    for change, words in (({"fx": float("nan")}, "fx: is not finite"), ({"width": 13}, "another size")):
        changed = record | {"cameras": [record["cameras"][0] | change]}
        (folder / "meta/cameras.json").write_text(json.dumps(changed))
        assert any(words in line for line in check(folder))
